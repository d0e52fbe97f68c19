"""Rows that points hold in given modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ffsm_mj._core.forces import HeldForces
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE

if TYPE_CHECKING:
    from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem


NONE: IntArray = np.zeros(0, dtype=np.intp)
"""No indices."""


@dataclass(frozen=True, eq=False)
class HeldRows:
    """The rows held by points in given modes; it stays the same for a step.

    Attributes:
        count: Number of all rows, 3k.
        rows: Indices of those held, ascending, (r,).
        slides: Indices of sliding points with friction, (m,).
        mu: Coefficients of friction of all points, (k,).
    """

    count: int
    rows: IntArray
    slides: IntArray
    mu: FloatArray

    @classmethod
    def of(cls, problem: FrictionProblem, kinds: IntArray) -> HeldRows:
        """Determine the rows in a problem."""
        rows = problem.held_rows(kinds)
        slides = ((kinds == SLIDE) & (problem.mu > 0.0) & problem.movable_normals).nonzero()[0] if SLIDE in kinds else NONE
        return cls(3 * len(kinds), rows, slides, problem.mu)

    @cached_property
    def key(self) -> bytes:
        """What tells the rows held apart from others of the same points in the same modes."""
        return self.rows.tobytes()

    @cached_property
    def columns(self) -> IntArray:
        """Columns of the normal forces of the sliding points, (m,)."""
        return np.searchsorted(self.rows, 3 * self.slides)


Structures: TypeAlias = dict[bytes, HeldRows]
"""Rows held by the same points in several modes, by the modes."""


HeldProblems: TypeAlias = dict[tuple[bytes, bytes], HeldForces]
"""Linear problems of the same points at one state, by the modes and the rows held."""
