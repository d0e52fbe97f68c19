"""Rows that points hold in given modes, and the forces that hold them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.compiled import fastest
from ffsm_mj.contact_models.persistent.friction.linear_systems import range_basis, solved
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE
from ffsm_mj.tolerances import RANK

if TYPE_CHECKING:
    from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem


_NONE: IntArray = np.zeros(0, dtype=np.intp)
"""No indices."""


@dataclass(frozen=True, eq=False)
class HeldRows:
    """The rows held by points in given modes; it stays the same for a step.

    Attributes:
        count: Number of all rows, 3k.
        rows: Indices of those held, ascending, (r,).
        slides: Indices of sliding points with friction, (m,).
        problem: Class of the linear problem for their forces; compiled where no point slides with friction.
    """

    count: int
    rows: IntArray
    slides: IntArray
    problem: type[HeldForces]

    @classmethod
    def of(cls, problem: FrictionProblem, kinds: IntArray) -> HeldRows:
        """Determine the rows in a problem."""
        rows = problem.held_rows(kinds)
        slides = ((kinds == SLIDE) & (problem.mu > 0.0) & problem.movable_normals).nonzero()[0] if SLIDE in kinds else _NONE
        return cls(3 * len(kinds), rows, slides, HeldForces if len(slides) else fastest(HeldForces))

    @cached_property
    def key(self) -> bytes:
        """What tells the rows held apart from others of the same points in the same modes."""
        return self.rows.tobytes()

    @cached_property
    def along(self) -> FloatArray:
        """Directions along which the forces of the rows act, (3k, r); without friction of sliding points."""
        along = np.zeros((self.count, len(self.rows)))
        along[self.rows, np.arange(len(self.rows))] = 1.0
        return along

    @cached_property
    def columns(self) -> IntArray:
        """Columns of the normal forces of the sliding points, (m,)."""
        return np.searchsorted(self.rows, 3 * self.slides)


Structures: TypeAlias = dict[bytes, HeldRows]
"""Rows held by the same points in several modes, by the modes."""


class HeldForces:
    """The linear problem for the forces of held rows, at one state; under several efforts there."""

    def __init__(self, problem: FrictionProblem, structure: HeldRows) -> None:
        """Take the matrix of a problem, and the rows."""
        self._mu, self._structure = problem.mu, structure
        self._held_G = problem.G[structure.rows]
        self._range = range_basis(self._held_G[:, structure.rows])
        self._along = structure.along if len(structure.slides) else None

    @property
    def redundant(self) -> bool:
        """Whether rows depend on each other."""
        return self._range is not None

    def springs(self, rows: FloatArray, forces: FloatArray) -> FloatArray:
        """Forces of springs along other rows, under the displacement that gives the held ones theirs, N, (m,).

        Args:
            rows: Elements of G for the other rows and the held ones, 1/kg, (m, r).
            forces: Forces (n, t1, t2) of all points, N, (k, 3).
        """
        along, system = self._independent(rows)
        held = forces.ravel()[self._structure.rows]
        return along @ solved(system, held if self._range is None else self._range.T @ held)

    def decide(self, rows: FloatArray, inverse_masses: FloatArray) -> BoolArray:
        """Whether the held rows decide how each of some other rows moves, as it depends on them, (m,).

        Args:
            rows: Elements of G for the other rows and the held ones, 1/kg, (m, r).
            inverse_masses: Those along the other rows, 1/kg, (m,): none is left for motions that move no held row.
        """
        along, system = self._independent(rows)
        return np.asarray(np.sum(along.T * solved(system, along.T), axis=0) >= (1.0 - RANK) * inverse_masses)

    def _independent(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Elements of G for other rows and independent combinations of the held ones, and for these, 1/kg."""
        system, U = self._held_G[:, self._structure.rows], self._range
        return (rows, system) if U is None else (rows @ U, U.T @ system @ U)

    def is_regular(self, slips: FloatArray) -> bool:
        """Whether the determinant of the linear problem has the sign that it has without sliding friction."""
        self.turn_to(slips)
        system, U = self._system, self._range
        return bool(np.linalg.slogdet(system if U is None else U.T.dot(system).dot(U))[0] > 0.0)

    def turn_to(self, slips: FloatArray) -> None:
        """Set the directions of slip, (k, 2)."""
        structure = self._structure
        if self._along is None:  # forces act along the rows themselves
            return
        slides, columns = structure.slides, structure.columns
        self._along = structure.along.copy()
        friction = -self._mu[slides, None] * slips[slides]
        self._along[3 * slides + 1, columns], self._along[3 * slides + 2, columns] = friction[:, 0], friction[:, 1]

    def forces(self, b: FloatArray, slips: FloatArray) -> FloatArray:
        """Forces (n, t1, t2) of each point for given directions of slip, N, (k, 3).

        Args:
            b: Accelerations without contact forces, m/s^2, (3k,).
            slips: The directions, (k, 2).
        """
        structure = self._structure
        self.turn_to(slips)
        held = self._solve(-b[structure.rows])
        if self._along is not None:
            forces: FloatArray = self._along.dot(held)
            return forces.reshape(-1, 3)
        plain = np.zeros(structure.count)
        plain[structure.rows] = held
        return plain.reshape(-1, 3)

    @property
    def _system(self) -> FloatArray:
        """Accelerations of the held rows per unit forces of these, (r, r)."""
        held: FloatArray = self._held_G
        return held[:, self._structure.rows] if self._along is None else held.dot(self._along)

    def _solve(self, right: FloatArray) -> FloatArray:
        if not len(right):
            return right
        if self._range is None:
            return solved(self._system, right)
        U = self._range
        return np.asarray(U.dot(solved(U.T.dot(self._system).dot(U), U.T.dot(right))))

    def responses_to_turns(self, points: IntArray, across: FloatArray, normal_forces: FloatArray) -> FloatArray:
        """Changes of all forces per rad by which the directions of slip of some points turn, (3k, m).

        Args:
            points: The points, (m,).
            across: Unit vectors into which their directions turn, (m, 2).
            normal_forces: Their normal forces, N, (m,).
        """
        along = self._structure.along if self._along is None else self._along
        turned, columns = np.zeros((len(along), len(points))), np.arange(len(points))
        friction = -(self._mu[points] * normal_forces)[:, None] * across
        turned[3 * points + 1, columns], turned[3 * points + 2, columns] = friction[:, 0], friction[:, 1]
        return np.asarray(turned + along.dot(self._solve(-self._held_G.dot(turned))))


HeldProblems: TypeAlias = dict[tuple[bytes, bytes], HeldForces]
"""Linear problems of the same points at one state, by the modes and the rows held."""
