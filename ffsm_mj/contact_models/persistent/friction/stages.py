"""Points that slide in a step: forces in its stages, slips at the nodes of an implicit one, and how long it may be.

Friction turns the slip u at the rate (k + |f|) / |u|, with k = mu N times the inverse mass and the slip acceleration f. A
slip in a wrong direction, as rounding, an impact or a jump of the efforts leaves it, is thus turned within a layer of some
|u| / k, within which steps must follow it. The component across the direction to which it turns, the deviation, falls with
exp(-integral of k / |u| dt). Behind the layer, where none is left, the slip is as smooth as the forces, and only explicit
stages would have to follow the rate.

At the nodes of an implicit step slips and friction depend on each other. The velocities there are those that the
accelerations there lead to, so the slips u of the points that slide satisfy

    u_i = p_i + sum_j W_ij f_j(d_j),   d = u / |u|

with the slip acceleration f under friction against the directions d, normal forces N(d) and those of sticking points
included. Onset and end of slip make it hard: friction damps a turn of the slip at the rate mu N / |u|, without bound, and
next to the limit of friction the direction of an estimate says nothing of that of the slip: Newton's method on angles
fails. The unknown is therefore z = u + k d, the slip and what friction takes of it, with k near W_ii mu N G_tt: d = z / |z|
stays regular as the slip vanishes, and where |z| < k friction stops the point and d = z / k is the share of it that does
so. This is the projection of Alart & Curnier (Comput. Methods Appl. Mech. Eng. 92, 1991), whose equations Newton's method
solves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ffsm_mj._core.stages import Slide
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.cones import solved
from ffsm_mj.contact_models.persistent.friction.problem import slip_directions
from ffsm_mj.dynamics.implicit_stages import ImplicitStep
from ffsm_mj.tolerances import EPSILON

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import ContactEvaluation
    from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_STEPS, _HALVINGS = 40, 12
"""Largest number of Newton steps, and of halvings of one: as many as reduce the residual, which most steps square."""
_ROUNDING_M_S = 1e-16
"""Residual of the slips, besides 2 EPSILON of their terms, at which Newton's method ends."""
_LEAST_LOAD = 0.1
"""Least normal force over the largest one in k; the solution does not depend on it, the way there does."""
_CANCELS = 64.0
"""A residual that no longer falls is rounding within this factor: sums over the 3k forces, of which many cancel."""


class StageEquation:
    """The equations for the slips of m points at n nodes, in given modes."""

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
        self._held = [problem.held_in(kinds) for problem in problems]
        self._across = 3 * free[:, None] + np.array((1, 2))
        largest = max(float(np.abs(problem.b).max(initial=0.0)) for problem in problems)
        terms = float(np.abs(weights).max()) * largest + float(np.abs(p).max(initial=0.0))
        self._rounding = 2.0 * EPSILON * terms + _ROUNDING_M_S

    def solve(self, directions: FloatArray) -> tuple[list[FloatArray], FloatArray] | None:
        """Forces (n, t1, t2) at each node, N, (k, 3), and directions of slip, (n, k, 2); None where a point stops.

        Args:
            directions: Directions of slip, a first estimate for free points, (n, k, 2).
        """
        # Where several points slow each other down a bad estimate may lead nowhere; none at all does better there.
        found = self._from(directions.copy())
        if found is not None:
            return found
        nowhere = directions.copy()
        nowhere[:, self._free] = 0.0
        return self._from(nowhere)

    def _from(self, s: FloatArray) -> tuple[list[FloatArray], FloatArray] | None:
        """The same by Newton's method from an estimate, which changes."""
        forces, reached = self._slips(s)
        taken = self._taken(forces)
        z, step = reached + taken[:, :, None] * s[:, self._free], np.zeros_like(reached)
        before, halved = math.inf, 0
        for _ in range(_STEPS + _HALVINGS):
            size = np.hypot(z[..., 0], z[..., 1])
            slides, bound = size > taken, np.maximum(size, taken)[..., None]
            along = s[:, self._free] = z / bound
            forces, reached = self._slips(s)
            residual = reached + taken[..., None] * along - z
            error = float(np.abs(residual).max())
            if error <= self._rounding or (error >= 0.5 * before and error <= _CANCELS * self._rounding):
                return (forces, s) if slides.all() else None
            if error >= before and halved < _HALVINGS:
                step, halved = 0.5 * step, halved + 1
                z = z - step
                continue
            halved, before = 0, error
            # Of a point that friction stops d is linear in z.
            slope = self._slope(forces, np.where(slides[..., None], along, 0.0), bound, taken)
            step = solved(np.eye(len(slope)) - slope, residual.ravel()).reshape(z.shape)
            z = z + step
        return None

    def _taken(self, forces: list[FloatArray]) -> FloatArray:
        """The factors k, m/s, (n, m)."""
        found, free = [], self._free
        for weight, problem, at in zip(self._weights.diagonal(), self._problems, forces, strict=True):
            normal = np.maximum(at[free, 0], _LEAST_LOAD * np.abs(at[:, 0]).max())
            found.append(weight * problem.mu[free] * normal * problem.tangent_inverse_mass[free])
        return np.array(found)

    def _slope(self, forces: list[FloatArray], unit: FloatArray, bound: FloatArray, taken: FloatArray) -> FloatArray:
        """Derivative of u + k d by z, (2nm, 2nm), where that of d is (1 - unit unit^T) / bound."""
        n, m, points = len(self._problems), len(self._free), np.repeat(self._free, 2)
        axes, size = np.tile(np.eye(2), (m, 1)), 2 * m
        slope = np.zeros((n * size, n, m, 2))
        for j, (problem, held, at) in enumerate(zip(self._problems, self._held, forces, strict=True)):
            changes = problem.G[self._across.ravel()].dot(held.responses_to_turns(points, axes, at[points, 0]))
            slope[:, j] = np.kron(self._weights[:, j : j + 1], changes).reshape(-1, m, 2)
        slope.reshape(n * size, n * size)[np.diag_indices(n * size)] += np.repeat(taken, 2)
        slope = (slope - np.sum(slope * unit, axis=3)[..., None] * unit) / bound
        return np.asarray(slope.reshape(n * size, n * size))

    def _slips(self, directions: FloatArray) -> tuple[list[FloatArray], FloatArray]:
        """Forces under friction against some directions, N, (k, 3), and the slips of free points that follow, (n, m, 2)."""
        forces, rates = [], []
        for problem, held, s in zip(self._problems, self._held, directions, strict=True):
            forces.append(held.forces(problem.b, s))
            rates.append(problem.b[self._across] + problem.G[self._across].dot(forces[-1].ravel()))
        return forces, self._p + np.tensordot(self._weights, np.array(rates), 1)


def stage_of(here: ContactEvaluation, directions: FloatArray | None = None) -> tuple[Stage, FloatArray]:
    """Contact forces in a stage.

    Args:
        here: The points that slide or stick, at the state of the stage.
        directions: Directions of slip along the tangents, (k, 2); None for those of the slips at the state.

    Returns:
        The stage, and the generalised contact forces, (nv,).
    """
    rows, modes = here.rows, here.modes
    if directions is None or not modes.any_slides:
        return here.stage_here()
    forces, u = here.problem.forces(modes.kinds, directions), rows.slips
    along = forces.reshape(-1)
    generalised = along.dot(rows.J)
    heat = -np.sum(forces[:, 1:] * u, axis=1) * modes.slides
    slip_speeds = np.hypot(u[:, 0], u[:, 1]) * modes.slides
    return Stage(rows, along, generalised * rows.qvel, Slide(heat, slip_speeds)), generalised


def _directions_at(here: ContactEvaluation) -> tuple[FloatArray, FloatArray]:
    """Directions of slip at a state, and at the start of the step, along the tangents, (k, 2)."""
    rows, modes = here.rows, here.modes
    at_start = modes.start_directions(rows.axes)
    return slip_directions(here.problem, rows.slips, at_start, modes.slides, modes.straight)[0], at_start


class _Node(NamedTuple):
    """The points at a node, the directions of slip assumed there, (k, 2), and the forces (n, t1, t2), N, (k, 3)."""

    here: ContactEvaluation
    directions: FloatArray
    forces: FloatArray


class ImplicitSlips:
    """Slips of the points that slide at the nodes of an implicit step.

    See :class:`~ffsm_mj.dynamics.implicit_stages.StiffForces`.
    """

    def __init__(self, here: ContactEvaluation) -> None:
        """Begin at the first evaluation of the first node."""
        modes, self._first = here.modes, here
        self._free: IntArray = np.flatnonzero(modes.slides & ~here.problem.lines & ~modes.straight)
        self._nodes: dict[int, _Node] = {}

    def stage_of(self, here: ContactEvaluation, node: int) -> tuple[Stage, FloatArray]:
        """Contact forces in a node, with the directions of slip that were found last; see :func:`stage_of`."""
        known, (directions, at_start) = self._nodes.get(node), _directions_at(here)
        # Slip at the start of a slide is rounding without direction; that of its start is the estimate.
        directions[self._free] = (at_start if known is None else known.directions)[self._free]
        stage, generalised = stage_of(here, directions)
        if len(self._free):
            self._nodes[node] = _Node(here, directions, stage.along.reshape(-1, 3))
        return stage, generalised

    def held(self) -> tuple[FloatArray, FloatArray]:
        """Rows that are held at the first evaluation, and accelerations by forces along them without, (n, nv) each."""
        here = self._first
        which = here.problem.held_rows(here.modes.kinds)
        return here.rows.J[which], here.rows.response[which]

    def corrections(self, step: ImplicitStep, accelerations: FloatArray) -> FloatArray | None:
        """Changes of the accelerations with the directions of slip that solve the equations of the step."""
        nodes, free = [node for _, node in sorted(self._nodes.items())], self._free
        if not len(free):
            return np.zeros_like(accelerations)
        velocities, m = step.start_rates + step.weights.dot(accelerations), len(free)
        across = (3 * free[:, None] + np.array((1, 2))).ravel()
        slips = np.array([node.here.rows.J[across].dot(qvel) for node, qvel in zip(nodes, velocities, strict=True)])
        problems = [node.here.problem for node in nodes]
        rates = [
            problem.b[across] + problem.G[across].dot(node.forces.ravel())
            for problem, node in zip(problems, nodes, strict=True)
        ]
        p = (slips - step.weights.dot(np.array(rates))).reshape(-1, m, 2)
        equation = StageEquation(problems, nodes[0].here.modes.kinds, free, p, step.weights)
        found = equation.solve(np.array([node.directions for node in nodes]))
        if found is None:
            return None
        changes = []
        for i, (node, forces, directions) in enumerate(zip(nodes, *found, strict=True)):
            self._nodes[i] = node._replace(directions=directions)
            changes.append((forces - node.forces).ravel().dot(node.here.rows.response))
        return np.array(changes)
