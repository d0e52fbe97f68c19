"""Forces of least norm in convex sets, of all that have the same effect, by Newton's method on the dual problem.

    minimise |lam|^2   subject to   U^T lam = effect,   lam in K

The columns of U span all forces that have an effect. The dual problem is smooth and has few unknowns y: lam is the
projection of U y onto K, and y follows from U^T lam = effect by Newton's method with a line search (Qi & Sun, *A nonsmooth
version of Newton's method*, 1993). The answer is unique: it does not depend on which of the forces was found first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ffsm_mj.arrays import FloatArray

Projection: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Nearest forces in K to given ones, (n,), and their derivatives by these, (n, n)."""
_ACCURACY, _ROUNDING = 1e-13, 1e-15
"""Residual of the effect at which iterations end, for forces up to one, and its rounding as a share of the largest unknown,
which is large where K leaves little room."""
_SOLVED = 1e-10
"""Residual at which the answer is accepted."""
_ITERATIONS, _HALVINGS = 200, 30
_REACH = 10.0
"""Largest step in units of the largest unknown: where some points carry no force the derivative is singular, and the step
without a bound so long that the dual function is rounding there."""
_DAMPING = 1e-10
"""Part of the identity in the derivative, which is singular where few points carry force, over the residual."""


def least_norm_in(projected: Projection, U: FloatArray, effect: FloatArray) -> FloatArray | None:
    """Forces of least norm in a convex set K with a given effect, (n,); None if there are none, or K leaves no room.

    Args:
        projected: Projects forces onto K.
        U: Orthonormal columns, (n, m).
        effect: The effect U^T lam, (m,), of forces whose largest component is about one.
    """
    y: FloatArray = effect.copy()
    for _ in range(_ITERATIONS):
        lam, slope = projected(U @ y)
        miss = effect - U.T @ lam
        if float(np.abs(miss).max()) <= max(_ACCURACY, _ROUNDING * float(np.abs(y).max())):
            break
        damped = U.T @ slope @ U + _DAMPING * float(np.abs(miss).max()) * np.eye(len(y))
        step: FloatArray = np.asarray(np.linalg.lstsq(damped, miss, rcond=None)[0], dtype=np.float64)
        reach = _REACH * (1.0 + float(np.abs(y).max())) / max(float(np.abs(step).max()), np.finfo(float).tiny)
        y = _searched(projected, U, y, step * min(1.0, reach), effect)
    return lam if float(np.abs(miss).max()) <= _SOLVED else None


def _searched(projected: Projection, U: FloatArray, y: FloatArray, step: FloatArray, effect: FloatArray) -> FloatArray:
    """The y along a step at which the dual function, which is convex, has decreased enough."""

    def value(y: FloatArray) -> tuple[float, FloatArray]:
        # The dual function is (|x|^2 - |x - lam|^2) / 2 - effect . y with x = U y, for any convex K.
        x = U @ y
        lam = projected(x)[0]
        return float(lam @ x - 0.5 * (lam @ lam) - effect @ y), lam

    here, lam = value(y)
    slope = float((U.T @ lam - effect) @ step)
    share = 1.0
    for _ in range(_HALVINGS):
        # To rounding of the value any step near the solution is good.
        if value(y + share * step)[0] <= here + 1e-4 * share * slope + 1e-15 * (1.0 + abs(here)):
            break
        share *= 0.5
    return np.asarray(y + share * step)


def on_cones(given: FloatArray, mu: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest forces inside cones with tips at ``-moved``, (k, 3), and derivatives by each given one, (k, 3, 3)."""
    forces = given + moved
    n, t = forces[:, 0], np.hypot(forces[:, 1], forces[:, 2])
    inside, tip = t <= mu * n, mu * t <= -n
    onto = (n + mu * t) / (1.0 + mu * mu)
    e = forces[:, 1:] / np.where(t > 0.0, t, 1.0)[:, None]
    side = np.column_stack((onto, (mu * onto)[:, None] * e))
    lam = np.where(inside[:, None], forces, np.where(tip[:, None], 0.0, side))
    ray = np.column_stack((np.ones(len(mu)), mu[:, None] * e)) / np.sqrt(1.0 + mu * mu)[:, None]
    across = np.column_stack((np.zeros(len(mu)), -e[:, 1], e[:, 0]))
    turn = mu * onto / np.where(t > 0.0, t, 1.0)
    slope = ray[:, :, None] * ray[:, None, :] + turn[:, None, None] * across[:, :, None] * across[:, None, :]
    slope = np.where(inside[:, None, None], np.eye(3), np.where(tip[:, None, None], 0.0, slope))
    return lam - moved, slope


def of_points(lam: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces of k points, (k, 3), with derivatives of each by its own, (k, 3, 3), as one vector, (3k,), and matrix."""
    count = len(lam)
    whole = np.zeros((count, 3, count, 3))
    whole[np.arange(count), :, np.arange(count)] = slope
    return lam.ravel(), whole.reshape(3 * count, -1)
