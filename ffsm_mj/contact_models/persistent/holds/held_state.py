"""Contact points that are all held, at one state: where they are, and whether each of them carries force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.acceleration import CLEARLY
from ffsm_mj.contact_models.persistent.exchange import TwistStage
from ffsm_mj.contact_models.persistent.friction.point_modes import PointModes
from ffsm_mj.contact_models.persistent.holds.face_hold import FaceHold
from ffsm_mj.contact_models.persistent.holds.held_points import HeldPoints, PointForce
from ffsm_mj.contact_models.persistent.holds.held_twists import HeldTwists
from ffsm_mj.contact_models.persistent.point_rows import Extremes
from ffsm_mj.contact_models.persistent.rows import ContactPoint, point_runs
from ffsm_mj.contact_models.persistent.steady_columns import PairLoad
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2


class HeldState:
    """Evaluates states at the ends of steps.

    Attributes:
        extremes: Extremes of the gaps.
        points: The points, m, (k, 3).
        largest_speed: Largest relative speed of the material points at a contact point, m/s: no point slips faster. Zero
            without friction.
    """

    extremes: Extremes
    points: FloatArray
    largest_speed: float

    def __init__(self, twists: HeldTwists, pairs: Sequence[HeldPoints]) -> None:
        """Store the holds and their points."""
        self._twists, self._pairs, self._begun = twists, pairs, False
        self._rubs = any(not isinstance(hold, FaceHold) for hold in twists.holds)
        self._forces: FloatArray
        self._shared: list[list[PointForce]] | None = None

    @classmethod
    def of(
        cls, motion: Motion, data: Any, contact_points: Sequence[ContactPoint], modes: PointModes | None
    ) -> HeldState | None:
        """All points of a motion, of which none slides; None where not all of them are held over faces.

        Args:
            motion: The motion.
            data: Data of the logged system.
            contact_points: The points.
            modes: Their modes; None without friction.
        """
        twists = HeldTwists.of(motion, data, contact_points, modes)
        if twists is None or not all(isinstance(each.feature, PointOnFace) for each in contact_points):
            return None
        pairs = []
        for run, hold in zip(point_runs(contact_points), twists.holds, strict=True):
            features = [each.feature for each in contact_points[run] if isinstance(each.feature, PointOnFace)]
            pairs.append(HeldPoints(hold, features, contact_points[run.start].pair.mu, data))
        return cls(twists, pairs)

    def move(self) -> None:
        """Set the attributes for the current state; mass matrix factored."""
        twists, pairs = self._twists, self._pairs
        twists.find_twists()
        for pair, twist in zip(pairs, twists.twists, strict=True):
            pair.move_to(twist)
        self.points = pairs[0].points if len(pairs) == 1 else np.concatenate([pair.points for pair in pairs])
        self.extremes = merged([pair.extremes for pair in pairs])
        self.largest_speed = max([pair.largest_speed() for pair in pairs]) if self._rubs else 0.0
        if not self._begun:
            self._begun = twists.begin(self.points)
        if self._begun:
            twists.find_rows()
            self._largest_response = float(np.abs(twists.responses).max())

    def carries(self, force: FloatArray) -> bool:
        """Whether each point carries force by more than rounding, inside its friction cone; sets the forces.

        Args:
            force: Generalised forces without the contact forces, less the bias, (nv,).
        """
        if not self._begun:
            return False
        twists = self._twists
        self._forces, self._shared = twists.forces(force), None
        if self._rubs:
            return min([pair.depth(shared) for pair, shared in zip(self._pairs, self._shares(), strict=True)]) > 0.0
        largest = max(self._largest_response * max(map(abs, force.tolist())), *map(abs, twists.bias.tolist()))
        return all(self._pushes(pair, part, largest) for pair, part in zip(self._pairs, twists.parts, strict=True))

    def _pushes(self, pair: HeldPoints, part: slice, largest: float) -> bool:
        """Whether each point of a pair without friction pushes by more than its rounding, of which this is a bound."""
        hold = pair.hold
        if not isinstance(hold, FaceHold):
            return False
        rounding = ACCELERATION_M_S2 + ACCELERATION * max(hold.count * largest, pair.scale)
        accelerations = hold.accelerations(self._twists.G[part, part], self._forces[part])
        return min(accelerations) > CLEARLY * rounding

    def stage(self) -> tuple[TwistStage, FloatArray]:
        """The stage with the forces found last, and the generalised forces, (nv,)."""
        return self._twists.stage_of(self._forces)

    def loads(self) -> list[PairLoad]:
        """Loads of the pairs with these forces."""
        return [pair.load(shared) for pair, shared in zip(self._pairs, self._shares(), strict=True)]

    def _shares(self) -> list[list[PointForce]]:
        """These forces at the points of each pair."""
        if self._shared is None:
            parts = zip(self._pairs, self._twists.parts, strict=True)
            self._shared = [pair.share(self._forces[part]) for pair, part in parts]
        return self._shared


def merged(each: Sequence[Extremes]) -> Extremes:
    """Extremes over several groups of points."""
    if len(each) == 1:
        return each[0]
    inside, gap, rate, lowest = zip(*each, strict=True)
    return Extremes(min(inside), max(gap), max(rate), min(lowest))
