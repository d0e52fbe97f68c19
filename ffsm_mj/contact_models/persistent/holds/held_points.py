"""Points of one hold at one state: how they lie on their face, how they slip, and how they share the forces of the hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, scaled, shifted
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.face_group import FaceGroup
from ffsm_mj.contact_models.persistent.friction.internal_forces import FRICTION_ROUNDING
from ffsm_mj.contact_models.persistent.holds.face_point import FacePoint
from ffsm_mj.contact_models.persistent.holds.hold import Hold
from ffsm_mj.contact_models.persistent.point_rows import Extremes
from ffsm_mj.contact_models.persistent.steady_columns import PairLoad
from ffsm_mj.dynamics.body_twists import PairTwist

PointForce: TypeAlias = tuple[Vector, Vector, float, float]
"""A contact point, m, its force on geom b, N, and the normal and tangential part of this, N."""


class HeldPoints:
    """Points of one body over a face of another, which are held.

    Attributes:
        hold: Their hold.
        points: The points at the current state, m, (k, 3).
        extremes: Extremes of their gaps.
        scale: Largest curvature term of the second rates of their gaps, m/s^2; without friction.
    """

    points: FloatArray
    extremes: Extremes
    scale: float

    def __init__(self, hold: Hold, features: Sequence[PointOnFace], mu: float, data: Any) -> None:
        """Store the points; ``data`` is that of the logged system."""
        self.hold, self._mu, self._data = hold, mu, data
        self._group = FaceGroup(features, in_patch=False)
        self._one = FacePoint(features[0], data, features[0].point.centre) if len(features) == 1 else None

    def move_to(self, twist: PairTwist) -> None:
        """Set the attributes for the current state, with the twists of both bodies there."""
        self._twist = twist
        if self._one is not None:
            self._move_one(self._one, twist)
            return
        state = self._group.at_state(self._data, twist)
        gaps = state.gaps
        self.extremes = Extremes(min(state.insides), max(map(abs, gaps)), max(map(abs, state.rates)), min(gaps))
        self.points, self._normal = state.points, state.normal
        self.scale = max(state.scales) if self._mu == 0.0 else 0.0
        self._places: list[Vector] = [(x, y, z) for x, y, z in self.points.tolist()]

    def _move_one(self, at: FacePoint, twist: PairTwist) -> None:
        """The same for a single point."""
        at.move_to(twist)
        gap, velocity = at.gap(), shifted(twist.velocity, 1.0, cross(twist.omega, at.arm))
        self.extremes = Extremes(at.inside(), abs(gap), abs(dot(at.normal, velocity)), gap)
        self.scale, self._normal = 2.0 * abs(dot(at.turning, velocity)), at.normal
        self._places = [at.contact_point()]
        self.points = np.array(self._places)

    def largest_speed(self) -> float:
        """Largest relative speed of the material points at the contact points, m/s: no point slips faster."""
        twist = self._twist
        arms = (minus(point, twist.b.centre) for point in self._places)
        return max([math.hypot(*shifted(twist.velocity, 1.0, cross(twist.omega, arm))) for arm in arms])

    def share(self, forces: FloatArray) -> list[PointForce]:
        """Forces of the points, from those along the rows of the hold, N, (m,)."""
        normal, found = self._normal, []
        for point, force in zip(self._places, self.hold.forces_at(self._places, forces), strict=True):
            along = dot(force, normal)
            found.append((point, force, along, math.hypot(*shifted(force, -along, normal))))
        return found

    def depth(self, shared: Sequence[PointForce]) -> float:
        """Least of mu lam_n - |lam_t|, N."""
        return min([self._mu * normal - tangential for _, _, normal, tangential in shared])

    def load(self, shared: Sequence[PointForce]) -> PairLoad:
        """Resultant of the forces of points that push, and share of the friction limit that they use."""
        x = y = z = u = v = w = total = use = 0.0
        for (i, j, k), (a, b, c), normal, tangential in shared:
            x, y, z, total = x + a, y + b, z + c, total + normal
            u, v, w = u + normal * i, v + normal * j, w + normal * k
            if tangential > FRICTION_ROUNDING * normal:
                use = max(use, tangential / (self._mu * normal))
        friction = shifted((x, y, z), -total, self._normal) if self._mu > 0.0 else (0.0, 0.0, 0.0)
        return PairLoad((x, y, z), scaled(1.0 / total, (u, v, w)), friction, use)
