"""Slip velocities and friction that depend on each other, as in an implicit stage.

A stage of an implicit method ends at velocities that its own accelerations lead to, so the slips u of the points that slide
satisfy

    u = p + c f(d),   d = u / |u|

with the slip acceleration f under friction against the directions d, normal forces N(d) and those of sticking points
included. Onset and end of slip make it hard: friction damps a turn of the slip at the rate mu N / |u|, without bound, and
next to the limit of friction the direction of an estimate says nothing of that of the slip: Newton's method on angles fails.
The unknown is therefore z = u + k d, the slip and what friction takes of it, with k near c mu N G_tt: d = z / |z| stays
regular as the slip vanishes, and where |z| < k friction stops the point and d = z / k is the share of it that does so. This
is the projection of Alart & Curnier (Comput. Methods Appl. Mech. Eng. 92, 1991), whose equations Newton's method solves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.persistent.friction.linear_systems import solved
from ffsm_mj.tolerances import EPSILON

if TYPE_CHECKING:
    from ffsm_mj.contact_models.persistent.friction.held_rows import HeldForces
    from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_STEPS, _HALVINGS = 40, 12
"""Largest number of Newton steps, and of halvings of one: as many as reduce the residual, which most steps square."""
_ROUNDING_M_S = 1e-16
"""Residual of the slips, besides 2 EPSILON of their terms, at which Newton's method ends."""
_LEAST_LOAD = 0.1
"""Least normal force over the largest one in k; the solution does not depend on it, the way there does."""
_CANCELS = 64.0
"""A residual that no longer falls is rounding within this factor: sums over the 3k forces, of which many cancel."""


@dataclass(frozen=True)
class OwnVelocity:
    """Velocities at the contact points that depend on the forces sought: force_free + step_s * G lambda.

    Attributes:
        force_free: Velocity (n, t1, t2) at each point without contact forces, m/s, (3k,).
        step_s: Time for which the contact forces act: for a stage of an implicit method its duration times the diagonal
            coefficient of the method, s.
        free: Sliding points whose direction of slip follows from this velocity; that of the others is given.
    """

    force_free: FloatArray
    step_s: float
    free: IntArray


class StageEquation:
    """The equation for the slips of some points, in given modes at one state."""

    def __init__(self, problem: FrictionProblem, held: HeldForces, velocity: OwnVelocity) -> None:
        """Bind to a problem.

        Args:
            problem: The contact problem.
            held: The linear problem of the forces in the given modes.
            velocity: The velocities.
        """
        self._problem, self._held, self._velocity = problem, held, velocity
        self._across = 3 * velocity.free[:, None] + np.array((1, 2))
        terms = velocity.step_s * np.abs(problem.b).max(initial=0.0) + np.abs(velocity.force_free).max(initial=0.0)
        self._rounding = 2.0 * EPSILON * terms + _ROUNDING_M_S

    def solve(self, directions: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Forces (n, t1, t2), N, (k, 3), and directions of slip, (k, 2); None where a point stops before the stage's end.

        Args:
            directions: Directions of slip, a first estimate for free points, (k, 2).
        """
        # Where several points slow each other down a bad estimate may lead nowhere; none at all does better there.
        found = self._from(directions.copy())
        if found is not None:
            return found
        nowhere = directions.copy()
        nowhere[self._velocity.free] = 0.0
        return self._from(nowhere)

    def _from(self, s: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The same by Newton's method from an estimate, which changes."""
        problem, velocity, free = self._problem, self._velocity, self._velocity.free
        forces, reached = self._slips(s)
        limits = problem.mu[free] * np.maximum(forces[free, 0], _LEAST_LOAD * np.abs(forces[:, 0]).max())
        taken = velocity.step_s * limits * problem.tangent_inverse_mass[free]
        z, step = reached + taken[:, None] * s[free], np.zeros_like(reached)
        before, halved = math.inf, 0
        for _ in range(_STEPS + _HALVINGS):
            size = np.hypot(z[:, 0], z[:, 1])
            slides, bound = size > taken, np.maximum(size, taken)[:, None]
            along = s[free] = z / bound
            forces, reached = self._slips(s)
            residual = reached + taken[:, None] * along - z
            error = float(np.abs(residual).max())
            if error <= self._rounding or (error >= 0.5 * before and error <= _CANCELS * self._rounding):
                return (forces, s) if slides.all() else None
            if error >= before and halved < _HALVINGS:
                step, halved = 0.5 * step, halved + 1
                z = z - step
                continue
            halved, before = 0, error
            # Of a point that friction stops d is linear in z.
            slope = self._slope(forces, np.where(slides[:, None], along, 0.0), bound, taken)
            step = solved(np.eye(slope.shape[0]) - slope, residual.ravel()).reshape(-1, 2)
            z = z + step
        return None

    def _slope(self, forces: FloatArray, unit: FloatArray, bound: FloatArray, taken: FloatArray) -> FloatArray:
        """Derivative of u + k d by z, (2m, 2m), where that of d is (1 - unit unit^T) / bound."""
        m, points = len(unit), np.repeat(self._velocity.free, 2)
        changes = self._held.responses_to_turns(points, np.tile(np.eye(2), (m, 1)), forces[points, 0])
        slope = self._velocity.step_s * self._problem.G[self._across.ravel()].dot(changes)
        slope += np.diag(np.repeat(taken, 2))
        slope = slope.reshape(2 * m, m, 2)
        slope = (slope - np.sum(slope * unit, axis=2)[:, :, None] * unit) / bound
        return np.asarray(slope.reshape(2 * m, 2 * m))

    def _slips(self, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces under friction against some directions, N, (k, 3), and the slips of free points that follow, (m, 2)."""
        forces, velocity = self._held.forces(self._problem.b, directions), self._velocity
        found = velocity.force_free[self._across] + velocity.step_s * self._problem.G[self._across].dot(forces.ravel())
        return forces, found
