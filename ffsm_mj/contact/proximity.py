"""Two geoms at one instant: gap, normal, contact points and gap rates."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ffsm_mj.arrays import FloatArray

_PENETRATING, _EXACT = 1e3, 1e-3
"""A gap below minus the first times its rounding is penetration; the rate tolerance is then multiplied by the second."""


@dataclass(frozen=True)
class Proximity:
    """Gap, normal, contact points and gap rates of a pair at one instant, in world axes.

    Attributes:
        gap: Signed distance in m, negative when overlapping.
        normal: Unit normal from a to b, (3,).
        points: Contact points, or nearest points if the pair is apart: one point, or the extreme points of an edge or a
            face, (k, 3), m.
        rates: Gap rate at each point in m/s, negative when approaching, (k,).
        rate_tolerance: Gap rates within this of zero, in m/s, are rounding: the point neither approaches nor separates.
        rounding: Rounding of the gap, m.
    """

    gap: float
    normal: FloatArray
    points: FloatArray
    rates: FloatArray
    rate_tolerance: float
    rounding: float

    @property
    def rate(self) -> float:
        """Least gap rate of the points, m/s."""
        return float(self.rates.min())

    @property
    def approaches(self) -> bool:
        """Whether a point approaches by more than rounding."""
        # A pair that already penetrates by more than rounding must not rest on a tolerance: a slow approach deepens it.
        penetrates = self.gap <= -_PENETRATING * self.rounding
        return self.rate < (-_EXACT * self.rate_tolerance if penetrates else -self.rate_tolerance)

    def point_at(self, place: FloatArray, offset_m: float) -> FloatArray:
        """The nearest of its points, which impacts act on, if it is within an offset of a place; else the place itself."""
        nearest = min(self.points, key=lambda point: math.dist(point, place))
        return nearest if math.dist(nearest, place) <= offset_m else place
