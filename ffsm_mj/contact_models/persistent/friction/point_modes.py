"""Friction modes of some contact points in one (sub-)step: closed without force, sliding, sticking."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.constraint import UnilateralConstraint

TOGETHER = 100.0
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


@dataclass(frozen=True, eq=False)
class PointModes:
    """Modes of k points in the current (sub-)step.

    Attributes:
        mu: Coefficients of friction, (k,).
        kinds: Modes, UNKNOWN for points without one, (k,).
        slides: Points that slide with friction, (k,).
        directions: Directions of slip at the start of the step, world axes, (k, 3); zero for points that do not slide.
        stop_speeds: Slips below which points that slide stop, m/s, (k,).
        straight: Points so close to their stop that their direction of slip is kept until then, (k,).
        directed_at: Slips at which these directions were determined, m/s, (k,); infinite for points that are not straight.
        drifts: Points whose slip is drift: those that stick, begin to slide, or replace others that stick, (k,).
        structures: Rows held in modes of the step, by the modes; see ``HeldRows``.
        pairs: Pairs with friction and their points, which are consecutive.
    """

    mu: FloatArray
    kinds: IntArray
    slides: BoolArray
    directions: FloatArray
    stop_speeds: FloatArray
    straight: BoolArray
    directed_at: FloatArray
    drifts: BoolArray
    structures: dict[bytes, Any]
    pairs: list[tuple[UnilateralConstraint, slice]]

    @cached_property
    def no_slips(self) -> FloatArray:
        """Directions of slip of points that do not slide, (k, 2)."""
        return np.zeros((len(self.kinds), 2))

    @cached_property
    def key(self) -> bytes:
        """The modes as a key."""
        return self.kinds.tobytes()

    @cached_property
    def all_stick(self) -> bool:
        """Whether all points stick."""
        return bool((self.kinds == STICK).all())

    @cached_property
    def all_slide(self) -> bool:
        """Whether all points slide with friction, and none goes straight on to its stop."""
        return bool(self.slides.all()) and not self.any_straight

    @cached_property
    def none_slide(self) -> bool:
        """Whether no point slides, with friction or without."""
        return not bool((self.kinds == SLIDE).any())

    @cached_property
    def drift_m_s(self) -> float:
        """Speed up to which no point slips, if all stick; negative if one does not."""
        return 2.0 * TOGETHER * float(self.stop_speeds.min()) if self.all_stick else -1.0

    @cached_property
    def any_slides(self) -> bool:
        """Whether any point slides with friction."""
        return bool(self.slides.any())

    @cached_property
    def any_straight(self) -> bool:
        """Whether any point goes straight on to its stop."""
        return bool(self.straight.any())

    @cached_property
    def nowhere(self) -> BoolArray:
        """False for each point, (k,)."""
        return np.zeros(len(self.kinds), dtype=np.bool_)

    @cached_property
    def _directed(self) -> bool:
        return bool(self.directions.any())

    def start_directions(self, axes: FloatArray) -> FloatArray:
        """Directions of slip at the start of the step along the tangents, (k, 2).

        Args:
            axes: Normal and tangents of each point, (k, 3, 3).
        """
        if not self._directed:
            return self.no_slips
        return unit_slips(np.einsum("kij,kj->ki", axes[:, 1:], self.directions))


def unit_slips(velocities: FloatArray) -> FloatArray:
    """Unit vectors along slip velocities, (k, 2); zero where there is none."""
    sizes = np.hypot(velocities[:, 0], velocities[:, 1])
    return np.asarray(velocities / np.where(sizes > 0.0, sizes, 1.0)[:, None])
