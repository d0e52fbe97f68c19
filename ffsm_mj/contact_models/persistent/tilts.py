"""Tilts of rims and lines that carry force, which bound a step: contact points travel at their relative rate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.contact.features.gap_function import GapFunction
from ffsm_mj.contact_models.persistent.rows import ContactPoint

_TILT_SHARE = 0.2
"""A step ends early where the tilt of a rim over a face has changed by this share: forces grow as its inverse, and the steps
of a disc that falls flat must shrink with it. RK4 then errs by about 0.2^5 / 120 of them."""


class Tilts:
    """Tilts at the start of a step, and what is left of the changes that it may bring."""

    def __init__(self, data: Any) -> None:
        """Start without contact points; ``data`` is that of the logged system."""
        self._data = data
        self._rims: list[ContactPoint] = []
        self._starts: list[tuple[ContactPoint, Vector, float]] = []

    def set_points(self, pressing: Sequence[ContactPoint]) -> None:
        """Set the contact points that carry force."""
        self._rims = [contact for contact in pressing if type(contact.feature).tilt is not GapFunction.tilt]

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

    def least_left(self) -> float:
        """Least change of a tilt that this step may still bring; infinite without any."""
        return min([left for _, left, _ in self._left()], default=math.inf)

    def pairs_at_limit(self) -> list[UnilateralConstraint]:
        """Pairs with a rim whose tilt has changed to the limit of a step."""
        return [contact.pair for contact, left, most in self._left() if left < 0.01 * most]
