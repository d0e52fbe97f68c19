"""Tilts of rims and lines that carry force, which bound a step: contact points travel at their relative rate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.body_motion import Vector, cross
from ffsm_mj.contact.features.gap_function import GapFunction
from ffsm_mj.contact.features.round_gaps import RoundOnFace
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.tolerances import FLAT_M

_TILT_SHARE = 0.2
"""A step ends early where the tilt of a rim over a face has changed by this share: forces grow as its inverse, and the steps
of a disc that falls flat must shrink with it. RK4 then errs by about 0.2^5 / 120 of them."""

_TURN = 0.02
"""Angle in rad by which the contact point of a rim travels round it in one step, where it would travel by more than 1 rad in
the time step: the force is then an impulse, which leaves an error of 1e-10 of its energy. A tilt that falls straight to zero
leaves the force as it is, and slower turns are left to the time step or its control."""


class Tilts:
    """Tilts at the start of a step, and what is left of the changes that it may bring."""

    def __init__(self, data: Any) -> None:
        """Start without contact points; ``data`` is that of the logged system."""
        self._data = data
        self._rims: list[ContactPoint] = []
        self._caps: list[RoundOnFace] = []
        self._starts: list[tuple[ContactPoint, Vector, float]] = []

    def set_closed(self, contact_points: Sequence[ContactPoint]) -> None:
        """Set the contact points of all closed pairs."""
        self._caps = [contact.feature for contact in contact_points if isinstance(contact.feature, RoundOnFace)]

    def set_points(self, pressing: Sequence[ContactPoint]) -> None:
        """Set the contact points that carry force."""
        self._rims = [contact for contact in pressing if type(contact.feature).tilt is not GapFunction.tilt]

    @property
    def bound_steps(self) -> bool:
        """Whether there are any."""
        return bool(self._rims or self._caps)

    def begin_step(self) -> None:
        """Start at the state in ``data``."""
        tilts = ((contact, contact.feature.tilt(self._data)) for contact in self._rims)
        self._starts = [(contact, tilt, _TILT_SHARE * math.hypot(*tilt)) for contact, tilt in tilts if tilt is not None]

    def _left(self) -> Iterator[tuple[ContactPoint, float, float]]:
        """Rims with what their tilt may still change in this step and may change in one step."""
        for contact, start, most in self._starts:
            now = contact.feature.tilt(self._data)
            assert now is not None
            yield contact, most - math.dist(now, start), most

    def margins(self) -> tuple[float, float]:
        """Least change of a tilt that this step may still bring, and :meth:`least_rise`; infinite without any."""
        return min([left for _, left, _ in self._left()], default=math.inf), self.least_rise()

    def least_rise(self) -> float:
        """Least rise of a rim above FLAT_M, m: negative where a cap lies flat; infinite without any."""
        return min([feature.rise(self._data) for feature in self._caps], default=math.inf) - FLAT_M

    def step_limit(self, left_s: float) -> float:
        """Longest step of caps that roll on their rims, s, given the remaining time of the grid step.

        The stages of a step past the state in which a cap is flat would have forces at opposite points of its rim.
        """
        return min([self._limit_of(cap, left_s) for cap in self._caps], default=math.inf)

    def _limit_of(self, cap: RoundOnFace, left_s: float) -> float:
        tilt, rate = cap.tilt(self._data), cap.tilt_rate(self._data)
        if tilt is None or rate is None or not any(rate):
            return math.inf
        size = math.hypot(*tilt)
        limit, turn = 2.0 * _TILT_SHARE * size / math.hypot(*rate), math.hypot(*cross(tilt, rate))
        return min(limit, _TURN * size * size / turn) if turn * left_s > size * size else limit

    def pairs_at_limit(self) -> list[UnilateralConstraint]:
        """Pairs with a rim whose tilt has changed to the limit of a step."""
        return [contact.pair for contact, left, most in self._left() if left < 0.01 * most]
