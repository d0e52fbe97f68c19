"""Contact forces in a stage inside a step from the relative twists that the points hold."""

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
from ffsm_mj.contact_models.persistent.friction.linear_systems import least_norm_forces
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE, STICK, PointModes
from ffsm_mj.contact_models.persistent.holds.face_hold import FaceHold
from ffsm_mj.contact_models.persistent.holds.hold import Hold
from ffsm_mj.contact_models.persistent.holds.stuck_patch import StuckPatch
from ffsm_mj.contact_models.persistent.holds.stuck_point import StuckPoint
from ffsm_mj.contact_models.persistent.point_rows import PointRows
from ffsm_mj.contact_models.persistent.rows import ContactPoint, point_runs
from ffsm_mj.contact_models.persistent.wrench_rows import WrenchRows
from ffsm_mj.dynamics.body_twists import BodyTwists, PairTwist, PairTwistRows
from ffsm_mj.dynamics.motion import Motion


class HeldTwists:
    """Evaluates the forces of some holds, state by state."""

    def __init__(
        self, motion: Motion, runs: Sequence[slice], bodies: Sequence[tuple[int, int]], holds: Sequence[Hold]
    ) -> None:
        """Store the holds, with the contact points and the bodies (b, a) of each in the model of the motion."""
        model, data = motion.model, motion.data
        self._model, self._data, self._runs, self._qvel = model, data, runs, data.qvel
        ends = [0, *accumulate(hold.count for hold in holds)]
        self._parts = [slice(start, end) for start, end in pairwise(ends)]
        self._rows, self._bias = np.zeros((ends[-1], 6)), np.empty(ends[-1])
        self._J, self._responses = np.empty((2, ends[-1], model.nv))
        of_pairs = np.empty((6 * len(holds), model.nv))
        self._twist_rows = PairTwistRows(model, data, bodies, of_pairs)
        every = list(dict.fromkeys(body for both in bodies for body in both))
        self._twists = BodyTwists(model, data, every)
        self._holds = [
            (hold, every.index(b), every.index(a), self._rows[part], self._bias[part], own, self._J[part])
            for hold, (b, a), part, own in zip(holds, bodies, self._parts, of_pairs.reshape(-1, 6, model.nv), strict=True)
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
        runs = point_runs(contact_points)
        pairs = [contact_points[run.start].pair for run in runs]
        if motion.loops is not None or len(set(pairs)) < len(pairs):
            return None
        holds = []
        for run in runs:
            hold = _hold(data, contact_points[run], None if modes is None else modes.kinds[run].tolist())
            if hold is None:
                return None
            holds.append(hold)
        return cls(motion, runs, [(motion.bodies[pair.body_b], motion.bodies[pair.body_a]) for pair in pairs], holds)

    def begin(self, rows: PointRows) -> bool:
        """Begin a step at the current state, with the rows of the points there; returns whether the holds are right."""
        return all(each[0].begin(rows.points[run]) for each, run in zip(self._holds, self._runs, strict=True))

    def stage(self, force: FloatArray) -> tuple[TwistStage, FloatArray]:
        """The stage at the current state, and the generalised contact forces, (nv,); mass matrix factored.

        Args:
            force: Generalised forces without the contact forces, less the bias, (nv,).
        """
        twists, centres = self._twists.at_state(), []
        self._twist_rows.write()
        for hold, b, a, rows, bias, own, J in self._holds:
            twist = PairTwist.of(twists[b], twists[a])
            hold.write(twist, rows, bias)
            np.dot(rows, own, out=J)
            centres.append(twist.b.centre)
        J, responses = self._J, self._responses
        mujoco.mj_solveM(self._model, self._data, responses, J)
        forces = least_norm_forces(responses.dot(J.T), responses.dot(force) + self._bias)
        generalised = forces.dot(J)
        wrenches = WrenchRows(self._rows, self._parts, centres).resultants(forces)
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
