"""Contact forces from the relative twists that the points hold."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.persistent.exchange import TwistStage
from ffsm_mj.contact_models.persistent.friction.linear_systems import least_norm_forces, least_norm_solution
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE, STICK, PointModes
from ffsm_mj.contact_models.persistent.holds.face_hold import FaceHold
from ffsm_mj.contact_models.persistent.holds.hold import Hold
from ffsm_mj.contact_models.persistent.holds.stuck_patch import StuckPatch
from ffsm_mj.contact_models.persistent.holds.stuck_point import StuckPoint
from ffsm_mj.contact_models.persistent.rows import ContactPoint, point_runs
from ffsm_mj.contact_models.persistent.wrench_rows import WrenchRows
from ffsm_mj.dynamics.body_twists import BodyTwists, PairTwist, PairTwistRows
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import RANK


class HeldTwists:
    """Evaluates the forces of some holds, state by state.

    Attributes:
        holds: The holds.
        parts: Rows of each.
        twists: Twists of the bodies of each, at the state evaluated last.
        bias: Accelerations along the rows at zero joint accelerations there, (m,).
        responses: J M^-1 of the rows there, (m, nv).
        G: Their Delassus matrix J M^-1 J^T, 1/kg, (m, m).
    """

    twists: list[PairTwist]
    G: FloatArray

    def __init__(
        self, motion: Motion, runs: Sequence[slice], bodies: Sequence[tuple[int, int]], holds: Sequence[Hold]
    ) -> None:
        """Store the holds, with the contact points and the bodies (b, a) of each in the model of the motion."""
        model, data = motion.model, motion.data
        self._model, self._data, self._runs, self._qvel, self.holds = model, data, runs, data.qvel, tuple(holds)
        ends = [0, *accumulate(hold.count for hold in holds)]
        self.parts = [slice(start, end) for start, end in pairwise(ends)]
        self._rows, self.bias = np.zeros((ends[-1], 6)), np.empty(ends[-1])
        self._J, self.responses = np.empty((2, ends[-1], model.nv))
        self._are_redundant: bool | None = None
        of_pairs = np.empty((len(holds), 6, model.nv))
        self._twist_rows = PairTwistRows(model, data, bodies, of_pairs.reshape(-1, model.nv))
        every = list(dict.fromkeys(body for both in bodies for body in both))
        self._bodies, self._pairs = BodyTwists(model, data, every), [(every.index(b), every.index(a)) for b, a in bodies]
        self._places = [
            (hold, self._rows[part], self.bias[part], own, self._J[part])
            for hold, part, own in zip(holds, self.parts, of_pairs, strict=True)
        ]

    @classmethod
    def of(
        cls, motion: Motion, data: Any, contact_points: Sequence[ContactPoint], modes: PointModes | None
    ) -> HeldTwists | None:
        """The holds of some points in given modes; None where not all points are in one, or loops are closed.

        Args:
            motion: The motion.
            data: Data of the logged system.
            contact_points: Points that carry force.
            modes: Their modes; None without friction.
        """
        if motion.loops is not None or (modes is not None and modes.any_slides):
            return None
        runs = point_runs(contact_points)
        pairs = [contact_points[run.start].pair for run in runs]
        if len(set(pairs)) < len(pairs):
            return None
        holds = []
        for run in runs:
            hold = _hold(data, contact_points[run], None if modes is None else modes.kinds[run].tolist())
            if hold is None:
                return None
            holds.append(hold)
        return cls(motion, runs, [(motion.bodies[pair.body_b], motion.bodies[pair.body_a]) for pair in pairs], holds)

    def begin(self, points: FloatArray) -> bool:
        """Begin a step at the current state, with the points there, m, (k, 3); returns whether the holds are right."""
        return all(hold.begin(points[run]) for hold, run in zip(self.holds, self._runs, strict=True))

    def stage(self, force: FloatArray) -> tuple[TwistStage, FloatArray]:
        """The stage at the current state, and the generalised contact forces, (nv,); mass matrix factored.

        Args:
            force: Generalised forces without the contact forces, less the bias, (nv,).
        """
        self.find_twists()
        self.find_rows()
        return self.stage_of(self.forces(force))

    def find_twists(self) -> None:
        """Set the twists for the current state."""
        twists = self._bodies.at_state()
        self.twists = [PairTwist.of(twists[b], twists[a]) for b, a in self._pairs]

    def find_rows(self) -> None:
        """Set the other attributes for this state; mass matrix factored."""
        self._twist_rows.write()
        for twist, (hold, rows, bias, own, J) in zip(self.twists, self._places, strict=True):
            hold.write(twist, rows, bias)
            np.dot(rows, own, out=J)
        mujoco.mj_solveM(self._model, self._data, self.responses, self._J)
        self.G = self.responses.dot(self._J.T)

    def forces(self, force: FloatArray) -> FloatArray:
        """Forces along the rows that hold the points, N, (m,), under the other forces, (nv,); see :meth:`stage`."""
        accelerations = self.responses.dot(force) + self.bias
        if self._are_redundant is None:
            self._are_redundant = bool(np.linalg.matrix_rank(self.G, rtol=RANK, hermitian=True) < len(self.G))
        if self._are_redundant:  # as a rule they remain so; this takes less time than to find it out, and holds in any case
            return least_norm_solution(self.G, -accelerations)
        return least_norm_forces(self.G, accelerations)

    def stage_of(self, forces: FloatArray) -> tuple[TwistStage, FloatArray]:
        """The stage with some forces along the rows, N, (m,), and the generalised forces, (nv,)."""
        generalised = forces.dot(self._J)
        wrenches = WrenchRows(self._rows, self.parts, [twist.b.centre for twist in self.twists]).resultants(forces)
        return TwistStage(generalised * self._qvel, wrenches), generalised


def _hold(data: Any, contact_points: Sequence[ContactPoint], kinds: Sequence[int] | None) -> Hold | None:
    """The hold of some points of one pair in given modes."""
    pair, features = contact_points[0].pair, [each.feature for each in contact_points]
    over_face = [feature for feature in features if isinstance(feature, PointOnFace)]
    if isinstance(pair, JointLimit) or (kinds is not None and set(kinds) != {STICK if pair.mu > 0.0 else SLIDE}):
        return None
    if kinds is not None and pair.mu > 0.0 and len(features) > 2:
        return StuckPatch(pair.body_b, data)
    if len(over_face) < len(features):
        return None
    if kinds is None or pair.mu == 0.0:
        return FaceHold(over_face, data)
    return StuckPoint(over_face[0], data) if len(over_face) == 1 else None
