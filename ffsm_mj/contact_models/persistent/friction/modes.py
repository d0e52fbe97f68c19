"""Friction modes of contact points, which are kept from step to step: closed without force, sliding, sticking."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.tolerances import CLOSED_RATE, RATE

_STOPPED = 1e-9
"""A point stops where its slip is below this share of its largest slip since it last began to slide."""
_LEAST_SLIP_M_S = 1e-3
"""Smallest value of that largest slip, m/s."""

_TOGETHER = 100.0
"""Points whose slip is within this factor of the speed at which another one stops, stop with it."""


class Mode(IntEnum):
    """Mode of a closed contact point. A point without friction that carries force slides."""

    CLOSED = 0
    SLIDE = 1
    STICK = 2


CLOSED, SLIDE, STICK = map(int, Mode)
"""The modes as plain numbers, which numpy compares faster."""
UNKNOWN = -1
"""In place of the mode of a point that has none yet."""


class FrictionModes:
    """Modes of the contact points in the current (sub-)step, and what the choice of the next ones depends on.

    Attributes:
        released: Whether sticking points have reached the limit of friction at the current state: those there slide.
        structures: Rows held in modes of the current step, for all closed points; see ``HeldRows``.
        pressing_structures: The same for the points that press.
    """

    def __init__(self) -> None:
        """Start without modes."""
        self.released = False
        self.structures: dict[bytes, Any] = {}
        self.pressing_structures: dict[bytes, Any] = {}
        self._kinds: dict[ContactPoint, int] = {}
        self._directions: dict[ContactPoint, FloatArray] = {}
        self._largest_slip: dict[ContactPoint, float] = {}

    def kinds(self, contact_points: Sequence[ContactPoint]) -> IntArray:
        """Modes of some points, UNKNOWN for those without, (k,)."""
        return np.array([self._kinds.get(contact, UNKNOWN) for contact in contact_points], dtype=np.int64)

    def directions(self, contact_points: Sequence[ContactPoint]) -> FloatArray:
        """Directions of slip at the start of the step, world axes, (k, 3); zero for points that do not slide."""
        nothing = np.zeros(3)
        return np.array([self._directions.get(contact, nothing) for contact in contact_points]).reshape(-1, 3)

    def stop_speeds(self, contact_points: Sequence[ContactPoint]) -> FloatArray:
        """Slips below which points that slide stop, m/s, (k,)."""
        largest = [self._largest_slip.get(contact, 0.0) for contact in contact_points]
        return np.asarray(_STOPPED * np.maximum(largest, _LEAST_SLIP_M_S))

    def set(
        self, contact_points: Sequence[ContactPoint], kinds: IntArray, directions: FloatArray, slips: FloatArray
    ) -> None:
        """Set the modes of all closed points for the next step.

        Args:
            contact_points: All closed contact points.
            kinds: Their modes, (k,).
            directions: Directions of slip, world axes, (k, 3).
            slips: Slip speeds, m/s, (k,).
        """
        before, held = self._largest_slip, self._kinds
        self.released = False
        self.forget_structures()
        self._largest_slip = {
            contact: max(before.get(contact, 0.0) if held.get(contact) == SLIDE else 0.0, slip)
            for contact, slip, kind in zip(contact_points, slips.tolist(), kinds.tolist(), strict=True)
            if kind == SLIDE or held.get(contact) == SLIDE  # a point that has just stopped
        }
        self._kinds = dict(zip(contact_points, kinds.tolist(), strict=True))
        self._directions = dict(zip(contact_points, directions, strict=True))

    def assume(self, contact_points: Sequence[ContactPoint], *, sticks: bool) -> None:
        """Make the points that slide or stick do what they did before an event: stick, or slide."""
        before, after = (STICK, SLIDE) if sticks else (SLIDE, STICK)
        for contact in contact_points:
            if self._kinds.get(contact) == after:
                self._kinds[contact] = before

    def forget_structures(self) -> None:
        """Discard the rows held: the contact points or the motion have changed."""
        self.structures, self.pressing_structures = {}, {}

    def fingerprint(self, contact_points: Sequence[ContactPoint]) -> tuple[bytes, bytes, bool]:
        """What a choice of modes of some points depends on, for exact comparison."""
        return self.kinds(contact_points).tobytes(), self.directions(contact_points).tobytes(), self.released


def sliding(slips: FloatArray, kinds: IntArray, stop_speeds: FloatArray, rounding: FloatArray) -> BoolArray:
    """Points that slip, (k,).

    Points of a body that stop at one instant reach the speed at which one stops within rounding of each other: those close
    to it stop with it. The velocity of sticking points drifts, until it is projected out.

    Args:
        slips: Slip speeds, m/s, (k,).
        kinds: Present modes, (k,).
        stop_speeds: Slips below which sliding points stop, m/s, (k,).
        rounding: Rounding of the speeds, m/s, (k,).
    """
    least = np.maximum(stop_speeds, rounding)
    stops = (kinds == SLIDE) & (slips <= least)
    together = _TOGETHER if stops.any() else 1.0
    drift = np.maximum(2.0 * _TOGETHER * least, CLOSED_RATE / RATE * rounding)
    return np.asarray(slips > np.where(kinds == STICK, drift, np.where(kinds == SLIDE, together * least, least)))
