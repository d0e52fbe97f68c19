"""Contact forces with Coulomb friction in given modes, at the level of accelerations.

With rows (n, t1, t2) of k contact points, M the mass matrix and f all forces except those of the contacts,

    a = b + G lambda,   G = J M^-1 J^T,   b = J M^-1 f + gamma

is the relative acceleration of the two bodies at each point, in the normal row the second rate of the gap. A sticking point
has a = 0 in its three rows; a sliding one has a_n = 0 and lambda_t = -mu lambda_n s with the direction of slip s. With R the
rows that are held and D those along which forces act, the conditions R are linear in the forces (Pfeiffer & Glocker,
*Multibody Dynamics with Unilateral Contacts*).

Rows of redundant points are dependent. Forces are then those of equal springs at all points: they lie in the range of R M^-1
R^T, which is the least norm without friction and for points that stick. The rank of this matrix belongs to a state, not to
the modes: a patch that slides over the edge of a face shrinks to a line or to a point within a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from ffsm_mj._core.forces import HeldForces
from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, unit_slips
from ffsm_mj.tolerances import CANCELLED, RANK

NONE: IntArray = np.zeros(0, dtype=np.intp)
"""No indices."""
HeldProblems: TypeAlias = dict[tuple[bytes, bytes], HeldForces]
"""Linear problems of the same points at one state, by the modes and the rows held."""


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


class Solution(NamedTuple):
    """Forces in given modes at one state.

    Attributes:
        kinds: Modes, (k,).
        directions: Directions of slip along (t1, t2), (k, 2).
        forces: Forces (n, t1, t2), N, (k, 3).
        accelerations: Relative accelerations (n, t1, t2), m/s^2, (k, 3).
        validity: Least margin of all conditions, m/s^2; negative if one is violated.
        exact: The same without the excess over the limit of friction up to which points stick: zero at the limit.
        releases: Whether the condition violated most is that limit.
    """

    kinds: IntArray
    directions: FloatArray
    forces: FloatArray
    accelerations: FloatArray
    validity: float
    exact: float
    releases: bool

    @property
    def valid(self) -> bool:
        """Whether all conditions hold."""
        return self.validity >= 0.0


class FrictionProblem:
    """The contact problem of k points at one state.

    Attributes:
        G: Delassus matrix of rows (n, t1, t2) of each point, 1/kg, (3k, 3k).
        b: Accelerations without contact forces, m/s^2, (3k,).
        mu: Coefficients of friction, (k,).
        inverse_mass: Inverse mass along each normal, 1/kg, (k,).
        movable_normals: Points at which a normal force can move anything, (k,).
    """

    def __init__(
        self,
        G: FloatArray,
        b: FloatArray,
        mu: FloatArray,
        structures: Structures | None = None,
        held: HeldProblems | None = None,
    ) -> None:
        """Set up the problem.

        Args:
            G: See the attributes.
            b: See the attributes.
            mu: See the attributes.
            structures: Structures of modes found before in the same (sub-)step, for the same points; more are added.
            held: Linear problems found before with the same G; more are added.
        """
        self.G, self.b, self.mu = G, b, mu
        self._structures: Structures = {} if structures is None else structures
        self._held: HeldProblems = {} if held is None else held
        self._forces: dict[tuple[bytes, bytes], FloatArray] = {}
        self.inverse_mass: FloatArray = G.diagonal()[::3]

    @cached_property
    def _movable(self) -> BoolArray:
        """Rows along which a force can move anything, (k, 3)."""
        diagonal = self.G.diagonal().reshape(-1, 3)
        return np.asarray(diagonal > CANCELLED * max(1.0, float(diagonal.max(initial=0.0))))

    @property
    def movable_normals(self) -> BoolArray:
        """Points at which a normal force can move anything, (k,)."""
        return np.asarray(self._movable[:, 0])

    def held_rows(self, kinds: IntArray) -> IntArray:
        """Rows held by points in given modes; rows along which nothing can move are left out."""
        if set(kinds.tolist()) == {STICK}:
            return np.asarray(self._movable.ravel().nonzero()[0])
        held = np.zeros((len(kinds), 3), dtype=np.bool_)
        held[:, 0] = kinds != CLOSED
        held[:, 1:] = (kinds == STICK)[:, None]
        return np.asarray((held & self._movable).ravel().nonzero()[0])

    def structure(self, kinds: IntArray) -> HeldRows:
        """The rows held in given modes."""
        key = kinds.tobytes()
        found = self._structures.get(key)
        if found is None:
            found = self._structures[key] = HeldRows.of(self, kinds)
        return found

    def held_in(self, kinds: IntArray) -> HeldForces:
        """The linear problem in given modes."""
        structure = self.structure(kinds)
        key = kinds.tobytes(), structure.key
        found = self._held.get(key)
        if found is None:
            found = self._held[key] = HeldForces(self, structure)
        return found

    def redundant(self, kinds: IntArray) -> bool:
        """Whether the rows held in given modes depend on each other."""
        return self.held_in(kinds).redundant

    def forces(self, kinds: IntArray, slips: FloatArray) -> FloatArray:
        """Forces (n, t1, t2) of each point in given modes, N, (k, 3).

        Args:
            kinds: Modes, (k,).
            slips: Unit direction of slip of each sliding point along (t1, t2), (k, 2); zero without friction.
        """
        key = kinds.tobytes(), slips.tobytes()
        found = self._forces.get(key)
        if found is None:
            found = self._forces[key] = self.held_in(kinds).forces(self.b, slips)
        return found

    def is_regular(self, kinds: IntArray, slips: FloatArray) -> bool:
        """Whether normal forces push apart what slides: not beyond Painleve's paradox, where D = G_nn - mu G_nt s <= 0."""
        return not len(self.structure(kinds).slides) or self.held_in(kinds).is_regular(slips)

    def responses_to_turns(self, kinds: IntArray, slips: FloatArray, points: IntArray, forces: FloatArray) -> FloatArray:
        """Changes of forces per rad by which the directions of slip of some points turn, N, (k, 3, m).

        Args:
            kinds: Modes, (k,).
            slips: Directions of slip, (k, 2).
            points: The points that turn, (m,).
            forces: Forces in these modes, N, (k, 3).
        """
        held = self.held_in(kinds)
        held.turn_to(slips)
        across = np.stack((-slips[points, 1], slips[points, 0]), axis=1)
        return held.responses_to_turns(points, across, forces[points, 0]).reshape(-1, 3, len(points))

    @cached_property
    def _tangent_blocks(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Elements (1, 1), (1, 2) and (2, 2) of the tangent rows of G of each point, 1/kg, (k,) each."""
        G = self.G
        return G.diagonal()[1::3], G.diagonal(1)[1::3], G.diagonal()[2::3]

    @cached_property
    def tangent_inverse_mass(self) -> FloatArray:
        """Largest eigenvalue of the two tangent rows of G of each point, 1/kg, (k,)."""
        a, b, c = self._tangent_blocks
        return np.asarray(0.5 * (a + c) + np.hypot(0.5 * (a - c), b))

    @cached_property
    def lines(self) -> BoolArray:
        """Points that can slip along one line only, (k,).

        Their two tangent rows of G have rank one, as in a planar mechanism.
        """
        a, b, c = self._tangent_blocks
        return np.asarray(a * c - b * b <= RANK * self.tangent_inverse_mass**2)

    def line_directions(self) -> FloatArray:
        """Unit vectors along which these points slip, (k, 2); arbitrary for the others."""
        a, b, c = self._tangent_blocks
        angles = 0.5 * np.arctan2(2.0 * b, a - c)
        return np.stack((np.cos(angles), np.sin(angles)), axis=1)

    def pinned(self, kinds: IntArray) -> BoolArray:
        """Sliding points that cannot slip, as the rows held by the others decide how they move along both tangents, (k,).

        So it is where two points of a body stick and the load of a third one, which is redundant, is at its limit.
        """
        found = np.zeros(len(kinds), dtype=np.bool_)
        if STICK not in kinds or not len((structure := self.structure(kinds)).slides):
            return found
        across = (3 * structure.slides[:, None] + np.array((1, 2))).ravel()
        decided = self.held_in(kinds).decide(self.G[np.ix_(across, structure.rows)], self.G.diagonal()[across])
        found[structure.slides] = decided.reshape(-1, 2).all(axis=1)
        return found

    def virtual_shares(self, kinds: IntArray, forces: FloatArray) -> FloatArray:
        """Normal forces of springs like those of the held points, at points without force, N, (k,).

        They are defined where the held points decide how such a point moves, as its row depends on theirs; zero elsewhere.
        """
        closed, shares = np.flatnonzero(kinds == CLOSED), np.zeros(len(kinds))
        if len(closed) and len(self.structure(kinds).rows):
            rows = self.G[np.ix_(3 * closed, self.structure(kinds).rows)]
            held = self.held_in(kinds)
            decided = held.decide(rows, self.inverse_mass[closed])
            shares[closed] = np.where(decided, held.springs(rows, forces), 0.0)
        return shares


def slip_directions(
    problem: FrictionProblem, slips: FloatArray, at_start: FloatArray, slides: BoolArray, straight: BoolArray
) -> tuple[FloatArray, float]:
    """Directions of slip within a step: along the slip, with the sense that it had at the start of the step.

    A stage beyond the time at which a point stops then keeps the sense of its friction, and the slip along the direction at
    the start passes through zero smoothly.

    Args:
        problem: The contact problem, which knows the points that can slip along a line only.
        slips: Slip velocities along (t1, t2), m/s, (k, 2).
        at_start: Directions at the start of the step, (k, 2).
        slides: Points that slide, (k,).
        straight: Points that keep the direction, (k,).

    Returns:
        Unit directions, (k, 2), and the least slip along the direction at the start, m/s.
    """
    directions = np.zeros_like(slips)
    if not slides.any():
        return directions, np.inf
    forward = np.sum(slips * at_start, axis=1)
    unit = unit_slips(slips) * np.where(forward < 0.0, -1.0, 1.0)[:, None]
    unit = np.where((straight | ~np.any(unit != 0.0, axis=1))[:, None], at_start, unit)
    if problem.lines.any():
        axes = problem.line_directions()
        forth = axes * np.where(np.sum(axes * at_start, axis=1) < 0.0, -1.0, 1.0)[:, None]
        unit = np.where(problem.lines[:, None], forth, unit)
    directions[slides] = unit[slides]
    return directions, float(forward[slides].min())
