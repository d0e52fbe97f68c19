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

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ffsm_mj._core.forces import ActiveForces
from ffsm_mj._core.stages import Slide
from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.cones import solved
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, unit_slips
from ffsm_mj.dynamics.implicit_stages import ImplicitStep
from ffsm_mj.tolerances import CANCELLED, EPSILON, RANK

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import ContactEvaluation

NONE: IntArray = np.zeros(0, dtype=np.intp)
"""No indices."""
ForcesByModes: TypeAlias = dict[tuple[bytes, bytes], ActiveForces]
"""Linear problems of the same points at one state, by the modes and the rows held."""


@dataclass(frozen=True, eq=False)
class ActiveRows:
    """The rows held by points in given modes; it stays the same for a step.

    Attributes:
        count: Number of all rows, 3k.
        rows: Indices of those held, ascending, (r,).
        sliding_points: Indices of sliding points with friction, (m,).
        mu: Coefficients of friction of all points, (k,).
    """

    count: int
    rows: IntArray
    sliding_points: IntArray
    mu: FloatArray

    @classmethod
    def of(cls, problem: FrictionProblem, kinds: IntArray) -> ActiveRows:
        """Determine the rows in a problem."""
        rows = problem.active_rows(kinds)
        # Where no normal force acts, friction in proportion to it is none.
        sliding = ((kinds == SLIDE) & (problem.mu > 0.0) & problem.movable_normals).nonzero()[0] if SLIDE in kinds else NONE
        return cls(3 * len(kinds), rows, sliding, problem.mu)

    @cached_property
    def key(self) -> bytes:
        """What tells the rows held apart from others of the same points in the same modes."""
        return self.rows.tobytes()

    @cached_property
    def columns(self) -> IntArray:
        """Columns of the normal forces of the sliding points, (m,)."""
        return np.searchsorted(self.rows, 3 * self.sliding_points)


Structures: TypeAlias = dict[bytes, ActiveRows]
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
        active: ForcesByModes | None = None,
    ) -> None:
        """Set up the problem.

        Args:
            G: See the attributes.
            b: See the attributes.
            mu: See the attributes.
            structures: Structures of modes found before in the same (sub-)step, for the same points; more are added.
            active: Linear problems found before with the same G; more are added.
        """
        self.G, self.b, self.mu = G, b, mu
        self._structures: Structures = {} if structures is None else structures
        self._active: ForcesByModes = {} if active is None else active
        self._forces: dict[tuple[bytes, bytes], FloatArray] = {}
        self.inverse_mass: FloatArray = G.diagonal()[::3]

    @cached_property
    def _movable(self) -> BoolArray:
        """Rows along which a force can move anything, (k, 3)."""
        # Where inverse masses cancel to rounding no force changes the rate of a row: holding it would divide by that
        # rounding.
        diagonal = self.G.diagonal().reshape(-1, 3)
        return np.asarray(diagonal > CANCELLED * max(1.0, float(diagonal.max(initial=0.0))))

    @property
    def movable_normals(self) -> BoolArray:
        """Points at which a normal force can move anything, (k,)."""
        return np.asarray(self._movable[:, 0])

    def active_rows(self, kinds: IntArray) -> IntArray:
        """Rows held by points in given modes; rows along which nothing can move are left out."""
        if set(kinds.tolist()) == {STICK}:
            return np.asarray(self._movable.ravel().nonzero()[0])
        active = np.zeros((len(kinds), 3), dtype=np.bool_)
        active[:, 0] = kinds != CLOSED
        active[:, 1:] = (kinds == STICK)[:, None]
        return np.asarray((active & self._movable).ravel().nonzero()[0])

    def structure(self, kinds: IntArray) -> ActiveRows:
        """The rows held in given modes."""
        key = kinds.tobytes()
        known = self._structures.get(key)
        if known is None:
            known = self._structures[key] = ActiveRows.of(self, kinds)
        return known

    def active_forces(self, kinds: IntArray) -> ActiveForces:
        """The linear problem in given modes."""
        structure = self.structure(kinds)
        key = kinds.tobytes(), structure.key
        active = self._active.get(key)
        if active is None:
            active = self._active[key] = ActiveForces(self, structure)
        return active

    def redundant(self, kinds: IntArray) -> bool:
        """Whether the rows held in given modes depend on each other."""
        return self.active_forces(kinds).redundant

    def forces(self, kinds: IntArray, slips: FloatArray) -> FloatArray:
        """Forces (n, t1, t2) of each point in given modes, N, (k, 3).

        Args:
            kinds: Modes, (k,).
            slips: Unit direction of slip of each sliding point along (t1, t2), (k, 2); zero without friction.
        """
        key = kinds.tobytes(), slips.tobytes()
        known = self._forces.get(key)
        if known is None:
            known = self._forces[key] = self.active_forces(kinds).forces(self.b, slips)
        return known

    def is_regular(self, kinds: IntArray, slips: FloatArray) -> bool:
        """Whether normal forces push apart what slides: not beyond Painleve's paradox, where D = G_nn - mu G_nt s <= 0."""
        # Without sliding friction the matrix is R M^-1 R^T, positive definite on its range: there is no paradox.
        return not len(self.structure(kinds).sliding_points) or self.active_forces(kinds).is_regular(slips)

    def responses_to_turns(self, kinds: IntArray, slips: FloatArray, points: IntArray, forces: FloatArray) -> FloatArray:
        """Changes of forces per rad by which the directions of slip of some points turn, N, (k, 3, m).

        Args:
            kinds: Modes, (k,).
            slips: Directions of slip, (k, 2).
            points: The points that turn, (m,).
            forces: Forces in these modes, N, (k, 3).
        """
        active = self.active_forces(kinds)
        active.turn_to(slips)
        across = np.stack((-slips[points, 1], slips[points, 0]), axis=1)
        return active.responses_to_turns(points, across, forces[points, 0]).reshape(-1, 3, len(points))

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
        # The determinant over the square of the larger eigenvalue is the ratio of both: tangents are known to RANK.
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
        decided_points = np.zeros(len(kinds), dtype=np.bool_)
        if STICK not in kinds or not len((structure := self.structure(kinds)).sliding_points):
            return decided_points
        across = (3 * structure.sliding_points[:, None] + np.array((1, 2))).ravel()
        decided = self.active_forces(kinds).decide(self.G[np.ix_(across, structure.rows)], self.G.diagonal()[across])
        decided_points[structure.sliding_points] = decided.reshape(-1, 2).all(axis=1)
        return decided_points

    def virtual_shares(self, kinds: IntArray, forces: FloatArray) -> FloatArray:
        """Normal forces of springs like those of the held points, at points without force, N, (k,).

        They are defined where the held points decide how such a point moves, as its row depends on theirs; zero elsewhere.
        """
        closed, shares = np.flatnonzero(kinds == CLOSED), np.zeros(len(kinds))
        if len(closed) and len(self.structure(kinds).rows):
            rows = self.G[np.ix_(3 * closed, self.structure(kinds).rows)]
            active = self.active_forces(kinds)
            decided = active.decide(rows, self.inverse_mass[closed])
            shares[closed] = np.where(decided, active.springs(rows, forces), 0.0)
        return shares


def slip_directions(
    problem: FrictionProblem, slips: FloatArray, at_start: FloatArray, sliding: BoolArray, straight: BoolArray
) -> tuple[FloatArray, float]:
    """Directions of slip within a step: along the slip, with the sense that it had at the start of the step.

    Its compiled twin is ``directions_of_slip`` in ``_core/contacts.pyx``.

    A stage beyond the time at which a point stops then keeps the sense of its friction, and the slip along the direction at
    the start passes through zero smoothly.

    Args:
        problem: The contact problem, which knows the points that can slip along a line only.
        slips: Slip velocities along (t1, t2), m/s, (k, 2).
        at_start: Directions at the start of the step, (k, 2).
        sliding: Points that slide, (k,).
        straight: Points that keep the direction, (k,).

    Returns:
        Unit directions, (k, 2), and the least slip along the direction at the start, m/s.
    """
    directions = np.zeros_like(slips)
    if not sliding.any():
        return directions, np.inf
    forward = np.sum(slips * at_start, axis=1)
    unit = unit_slips(slips) * np.where(forward < 0.0, -1.0, 1.0)[:, None]
    # A slip of exactly zero, as at the start of a slide, has no direction of its own.
    unit = np.where((straight | ~np.any(unit != 0.0, axis=1))[:, None], at_start, unit)
    # On a line the joints give the direction. That of a small slip has rounding across the line, which no force can turn.
    if problem.lines.any():
        axes = problem.line_directions()
        forth = axes * np.where(np.sum(axes * at_start, axis=1) < 0.0, -1.0, 1.0)[:, None]
        unit = np.where(problem.lines[:, None], forth, unit)
    directions[sliding] = unit[sliding]
    return directions, float(forward[sliding].min())


_STEPS, _HALVINGS = 40, 12
"""Largest number of Newton steps, and of halvings of one.

99 % of the equations of the tests take 9 steps or fewer, the others cross several kinks. Twelve halvings leave 2e-4 of a
step.
"""
_ROUNDING_M_S = 1e-16
"""Residual of the slips, besides 2 EPSILON of their terms, at which Newton's method ends."""
_LEAST_LOAD = 0.1
"""Least normal force over the largest one in k; the solution does not depend on it, the way there does."""
_CANCELS = 64.0
"""A residual that no longer falls is rounding within this factor: sums over the 3k forces, of which many cancel."""


class StageEquation:
    """The equations for the slips of m points at n nodes, in given modes.

    At the nodes of an implicit step slips and friction depend on each other. The velocities there are those that the
    accelerations there lead to, so the slips u of the points that slide satisfy

        u_i = p_i + sum_j W_ij f_j(d_j),   d = u / |u|

    with the slip acceleration f under friction against the directions d, normal forces N(d) and those of sticking points
    included. Onset and end of slip make it hard: friction damps a turn of the slip at the rate mu N / |u|, without bound,
    and next to the limit of friction the direction of an estimate says nothing of that of the slip: Newton's method on
    angles fails. The unknown is therefore z = u + k d, the slip and what friction takes of it, with k near W_ii mu N G_tt: d
    = z / |z| stays regular as the slip vanishes, and where |z| < k friction stops the point and d = z / k is the share of it
    that does so. This is the projection of Alart & Curnier (Comput. Methods Appl. Mech. Eng. 92, 1991), whose equations
    Newton's method solves.
    """

    def __init__(
        self, problems: Sequence[FrictionProblem], kinds: IntArray, free: IntArray, p: FloatArray, weights: FloatArray
    ) -> None:
        """Set up the equations.

        Args:
            problems: The contact problem at each node.
            kinds: Modes, (k,).
            free: Sliding points whose directions of slip are sought, (m,); those of others are given.
            p: Slips without the slip accelerations, m/s, (n, m, 2).
            weights: Coefficients W, s, (n, n).
        """
        self._problems, self._free, self._p, self._weights = problems, free, p, weights
        self._active = [problem.active_forces(kinds) for problem in problems]
        self._across = 3 * free[:, None] + np.array((1, 2))
        largest = max(float(np.abs(problem.b).max(initial=0.0)) for problem in problems)
        terms = float(np.abs(weights).max()) * largest + float(np.abs(p).max(initial=0.0))
        # The slips are sums of such terms, which cancel: below their rounding the residual cannot fall.
        self._rounding = 2.0 * EPSILON * terms + _ROUNDING_M_S

    def solve(self, directions: FloatArray) -> tuple[list[FloatArray], FloatArray] | None:
        """Forces (n, t1, t2) at each node, N, (k, 3), and directions of slip, (n, k, 2); None where a point stops.

        Args:
            directions: Directions of slip, a first estimate for free points, (n, k, 2).
        """
        # Where several points slow each other down a bad estimate may lead nowhere; none at all does better there.
        solution = self._from(directions.copy())
        if solution is not None:
            return solution
        nowhere = directions.copy()
        nowhere[:, self._free] = 0.0
        return self._from(nowhere)

    def _from(self, s: FloatArray) -> tuple[list[FloatArray], FloatArray] | None:
        """The same by Newton's method from an estimate, which changes."""
        forces, reached = self._slips(s)
        factors = self._factors(forces)
        z, step = reached + factors[:, :, None] * s[:, self._free], np.zeros_like(reached)
        before, halved = math.inf, 0
        for _ in range(_STEPS + _HALVINGS):
            # z = u + k d has slip and direction in one unknown: d = z / |z| where |z| > k, and z / k inside that disc, where
            # the point is stopped. So the equation is not singular at u = 0, as it would be in the slips.
            size = np.hypot(z[..., 0], z[..., 1])
            slides, bound = size > factors, np.maximum(size, factors)[..., None]
            along = s[:, self._free] = z / bound
            forces, reached = self._slips(s)
            residual = reached + factors[..., None] * along - z
            error = float(np.abs(residual).max())
            if error <= self._rounding or (error >= 0.5 * before and error <= _CANCELS * self._rounding):
                return (forces, s) if slides.all() else None
            # The last step went too far, over a kink at |z| = k: halve it, back from where it ended.
            if error >= before and halved < _HALVINGS:
                step, halved = 0.5 * step, halved + 1
                z = z - step
                continue
            halved, before = 0, error
            # Of a point that friction stops d is linear in z.
            slope = self._slope(forces, np.where(slides[..., None], along, 0.0), bound, factors)
            step = solved(np.eye(len(slope)) - slope, residual.ravel()).reshape(z.shape)
            z = z + step
        return None

    def _factors(self, forces: list[FloatArray]) -> FloatArray:
        """The factors k, m/s, (n, m)."""
        factors, free = [], self._free
        for weight, problem, at in zip(self._weights.diagonal(), self._problems, forces, strict=True):
            # At k = 0 the unknown z would be the slip itself, and the equation singular where that is zero.
            normal = np.maximum(at[free, 0], _LEAST_LOAD * np.abs(at[:, 0]).max())
            factors.append(weight * problem.mu[free] * normal * problem.tangent_inverse_mass[free])
        return np.array(factors)

    def _slope(self, forces: list[FloatArray], unit: FloatArray, bound: FloatArray, factors: FloatArray) -> FloatArray:
        """Derivative of u + k d by z, (2nm, 2nm), where that of d is (1 - unit unit^T) / bound."""
        n, m, points = len(self._problems), len(self._free), np.repeat(self._free, 2)
        axes, size = np.tile(np.eye(2), (m, 1)), 2 * m
        slope = np.zeros((n * size, n, m, 2))
        for j, (problem, active, at) in enumerate(zip(self._problems, self._active, forces, strict=True)):
            changes = problem.G[self._across.ravel()].dot(active.responses_to_turns(points, axes, at[points, 0]))
            slope[:, j] = np.kron(self._weights[:, j : j + 1], changes).reshape(-1, m, 2)
        # k d depends on the direction of the same point and node only.
        slope.reshape(n * size, n * size)[np.diag_indices(n * size)] += np.repeat(factors, 2)
        # A unit direction turns only across itself; one of a stopped point has unit = 0 here and is linear in z.
        slope = (slope - np.sum(slope * unit, axis=3)[..., None] * unit) / bound
        return np.asarray(slope.reshape(n * size, n * size))

    def _slips(self, directions: FloatArray) -> tuple[list[FloatArray], FloatArray]:
        """Forces under friction against some directions, N, (k, 3), and the slips of free points that follow, (n, m, 2)."""
        forces, rates = [], []
        for problem, active, s in zip(self._problems, self._active, directions, strict=True):
            forces.append(active.forces(problem.b, s))
            rates.append(problem.b[self._across] + problem.G[self._across].dot(forces[-1].ravel()))
        return forces, self._p + np.tensordot(self._weights, np.array(rates), 1)


def stage_of(evaluation: ContactEvaluation, directions: FloatArray | None = None) -> tuple[Stage, FloatArray]:
    """Contact forces in a stage.

    Args:
        evaluation: The points that slide or stick, at the state of the stage.
        directions: Directions of slip along the tangents, (k, 2); None for those of the slips at the state.

    Returns:
        The stage, and the generalised contact forces, (nv,).
    """
    rows, modes = evaluation.rows, evaluation.modes
    if directions is None or not modes.any_sliding:
        return evaluation.present_stage()
    forces, u = evaluation.problem.forces(modes.kinds, directions), rows.slips
    along = forces.reshape(-1)
    generalised = along.dot(rows.J)
    # Slip of a sticking point is drift: its power is not heat, and has either sign.
    heat = -np.sum(forces[:, 1:] * u, axis=1) * modes.sliding
    slip_speeds = np.hypot(u[:, 0], u[:, 1]) * modes.sliding
    return Stage(rows, along, generalised * rows.qvel, Slide(heat, slip_speeds)), generalised


def _directions_at(evaluation: ContactEvaluation) -> tuple[FloatArray, FloatArray]:
    """Directions of slip at a state, and at the start of the step, along the tangents, (k, 2)."""
    rows, modes = evaluation.rows, evaluation.modes
    at_start = modes.start_directions(rows.axes)
    return slip_directions(evaluation.problem, rows.slips, at_start, modes.sliding, modes.straight)[0], at_start


class _Node(NamedTuple):
    """The points at a node, the directions of slip assumed there, (k, 2), and the forces (n, t1, t2), N, (k, 3)."""

    evaluation: ContactEvaluation
    directions: FloatArray
    forces: FloatArray


class ImplicitSlips:
    """Slips of the points that slide at the nodes of an implicit step.

    See :class:`~ffsm_mj.dynamics.implicit_stages.StiffForces`.
    """

    def __init__(self, evaluation: ContactEvaluation) -> None:
        """Begin at the first evaluation of the first node."""
        modes, self._first = evaluation.modes, evaluation
        # Only directions that can turn are unknowns: on a line, or straight on to a stop, they are known.
        self._free: IntArray = np.flatnonzero(modes.sliding & ~evaluation.problem.lines & ~modes.straight)
        self._nodes: dict[int, _Node] = {}

    def stage_of(self, evaluation: ContactEvaluation, node: int) -> tuple[Stage, FloatArray]:
        """Contact forces in a node, with the directions of slip that were found last; see :func:`stage_of`."""
        known, (directions, at_start) = self._nodes.get(node), _directions_at(evaluation)
        # Slip at the start of a slide is rounding without direction; that of its start is the estimate.
        directions[self._free] = (at_start if known is None else known.directions)[self._free]
        stage, generalised = stage_of(evaluation, directions)
        if len(self._free):
            self._nodes[node] = _Node(evaluation, directions, stage.along.reshape(-1, 3))
        return stage, generalised

    def active_rows(self) -> tuple[FloatArray, FloatArray]:
        """Rows that are held at the first evaluation, and accelerations by forces along them without, (n, nv) each."""
        evaluation = self._first
        which = evaluation.problem.active_rows(evaluation.modes.kinds)
        return evaluation.rows.J[which], evaluation.rows.response[which]

    def corrections(self, step: ImplicitStep, accelerations: FloatArray) -> FloatArray | None:
        """Changes of the accelerations with the directions of slip that solve the equations of the step."""
        nodes, free = [node for _, node in sorted(self._nodes.items())], self._free
        # Stiff servos alone make such steps implicit too: the contact forces then follow from each state.
        if not len(free):
            return np.zeros_like(accelerations)
        velocities, m = step.start_rates + step.weights.dot(accelerations), len(free)
        across = (3 * free[:, None] + np.array((1, 2))).ravel()
        slips = np.array([node.evaluation.rows.J[across].dot(qvel) for node, qvel in zip(nodes, velocities, strict=True)])
        problems = [node.evaluation.problem for node in nodes]
        rates = [
            problem.b[across] + problem.G[across].dot(node.forces.ravel())
            for problem, node in zip(problems, nodes, strict=True)
        ]
        # All but friction and what it changes stays as in the last pass: the outer iteration of the step corrects that.
        p = (slips - step.weights.dot(np.array(rates))).reshape(-1, m, 2)
        equation = StageEquation(problems, nodes[0].evaluation.modes.kinds, free, p, step.weights)
        solution = equation.solve(np.array([node.directions for node in nodes]))
        # A point stops within the step, in which its mode is fixed: the integrator divides the step.
        if solution is None:
            return None
        changes = []
        for i, (node, forces, directions) in enumerate(zip(nodes, *solution, strict=True)):
            self._nodes[i] = node._replace(directions=directions)
            changes.append((forces - node.forces).ravel().dot(node.evaluation.rows.response))
        return np.array(changes)
