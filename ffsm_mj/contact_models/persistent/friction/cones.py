"""Friction cones of sticking contacts: how far forces are inside them, and how far forces with a required effect can be.

    margin = max m   subject to   lam = given + freedom y,   |lam_t,i| <= mu_i lam_n,i - m   for every contact i

The margin is signed: a set of contacts can stick if and only if it is not negative. It is a second-order cone program in a
few unknowns, solved by a primal-dual interior-point method with the scaling of Nesterov and Todd (Vandenberghe, *The CVXOPT
linear and quadratic cone program solvers*, 2010).

Small dense linear systems are solved by the functions of LAPACK that NumPy calls too, at several times their cost.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import EPSILON

ON_CONE = 1e-13
"""Rounding of the margin to a friction cone, as a share of the largest force."""
_MIRROR = np.array((1.0, -1.0, -1.0))
"""Reflection in the axis of a cone: an element of it, reflected, is its inverse up to a factor."""
_ACCURACY = 1e-14
"""Duality gap and residual at which iterations end, in units of the largest force."""
_ITERATIONS = 60
"""Twice what solvable problems take with room to spare: those of the tests end within 21, others have no solution."""
_CONVERGED, _DIVERGED = 1e-10, 10.0
"""Once below the first, the error falls until rounding stops it: iterations end where it is the second times its least."""
_LARGEST = 1e12
"""Unknowns, in units of the largest force given, beside which rounding leaves 1e-4 of it: they have no solution of use."""
_INSIDE = 1e-3
"""Least depth of the first estimate in all cones, in units of the largest force: on a boundary the scaling is singular."""
_STEP = 0.99
"""Share of the step to the boundary of the cones that is taken."""
_CAP = 10.0
"""Bound on the margin in units of the largest force: internal forces of a wedge have no other."""


def solved(system: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of linear equations; large where they are singular, as at the limit of Painleve's paradox."""
    if not len(system):  # nothing is held: bilateral rows hold every point already
        return right.copy()
    solution: FloatArray
    _, _, solution, singular = _lapack().dgesv(system, right)
    if singular:
        return np.asarray(np.linalg.lstsq(system, right, rcond=EPSILON)[0])
    return solution


def triangular_solution(R: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Solution of R x = right, or of R^T x = right, with an upper triangular R; the least one where R is singular."""
    sizes = np.abs(R.diagonal())
    if sizes.min() <= EPSILON * sizes.max():
        return np.asarray(np.linalg.lstsq(R.T if transposed else R, right, rcond=None)[0])
    solution: FloatArray = _lapack().dtrtrs(R, right, trans=int(transposed))[0]
    return solution


@cache
def _lapack() -> Any:
    from scipy.linalg import lapack  # a third of a second to import

    return lapack


def cone_depth(forces: FloatArray, mu: FloatArray) -> float:
    """Least of mu lam_n - |lam_t| of some points, N."""
    points = zip(mu.tolist(), forces.tolist(), strict=True)  # plain floats: of few numbers, these are faster than arrays
    return float(min([limit * normal - math.hypot(*across) for limit, (normal, *across) in points]))


def cone_margin(forces: FloatArray, freedom: FloatArray, mu: FloatArray) -> float:
    """Largest margin to the friction cones, N; at most ten times the largest given force.

    Args:
        forces: Forces (normal, t1, t2) of each contact with the required effect, N, (k, 3).
        freedom: Orthonormal forces without effect, as columns, (3k, d).
        mu: Coefficient of friction of each contact, (k,); a contact with mu = 0 only needs a normal force >= 0.
    """
    return largest_margin(forces, freedom, mu)[0]


def largest_margin(
    forces: FloatArray, freedom: FloatArray, mu: FloatArray, weights: FloatArray | None = None
) -> tuple[float, FloatArray]:
    """The same, and forces that have it, N, (k, 3); with weights, (k,), each contact keeps the margin times its weight."""
    unit = float(np.abs(forces).max())
    if unit == 0.0:
        return 0.0, forces
    # s = h - A x in second-order cones, x = (y, m); the last cone bounds m.
    k, d = len(mu), freedom.shape[1]
    # mu lam_n - m >= |lam_t| is a second-order cone once the normal row is scaled by mu. With mu = 0 only lam_n >= 0 is
    # left, which the margin leaves alone.
    scale = np.ones((k, 3))
    scale[:, 0] = np.where(mu > 0.0, mu, 1.0)
    A = np.zeros((k + 1, 3, d + 1))
    A[:k, :, :d] = -(scale[:, :, None] * freedom.reshape(k, 3, d))
    A[:k, 0, d] = np.where(mu > 0.0, 1.0 if weights is None else weights, 0.0)
    # The half-line m <= _CAP: the program of a wedge would be unbounded without it.
    A[k, 0, d] = 1.0
    h = np.zeros((k + 1, 3))
    h[:k] = scale * forces / unit
    h[k, 0] = _CAP
    x = _largest(A.reshape(-1, d + 1), h)
    return unit * float(x[-1]), forces + unit * (freedom @ x[:-1]).reshape(k, 3)


def _largest(A: FloatArray, h: FloatArray) -> FloatArray:
    """The x of the largest last unknown with h - A x in all cones; cones (k, 3)."""
    c = np.zeros(A.shape[1])
    c[-1] = -1.0
    x = np.asarray(np.linalg.lstsq(A, h.ravel(), rcond=None)[0], dtype=np.float64)
    # The start need not solve the equations, which the iteration restores; but only inside the cones the scaling exists.
    s = _interior(h - (A @ x).reshape(h.shape))
    dual = np.asarray(np.linalg.lstsq(A.T, -c, rcond=None)[0], dtype=np.float64)
    z = _interior(dual.reshape(h.shape))
    best, least = x, math.inf
    for _ in range(_ITERATIONS):
        r_x, r_z = c + A.T @ z.ravel(), s + (A @ x).reshape(h.shape) - h
        gap = float(np.sum(s * z)) / len(s)
        error = max(gap, float(np.abs(r_z).max()))
        if error < least:
            best, least = x, error
        # Rounding of the unknowns bounds the error from below. Where internal forces of any size are inside the cones, the
        # iteration then goes on along them, and leaves the solution again.
        lost = max(float(np.abs(s).max()), float(np.abs(z).max())) > _LARGEST
        if error < _ACCURACY or lost or (least < _CONVERGED and error > _DIVERGED * least):
            break
        W, W_inverse = _scaling(s, z)
        scaled = _ScaledRows(A, W_inverse)
        lam = np.einsum("kij,kj->ki", W, z)
        target = -_product(lam, lam)
        # Predictor: how far a step that aims at a gap of zero gets before the boundary says how much centring is needed.
        dx, ds, dz = scaled.direction(lam, r_x, r_z, target)
        step = min(1.0, _to_boundary(s, ds), _to_boundary(z, dz))
        centring = (1.0 - step) ** 3
        # Corrector (Mehrotra): the second-order term of the complementarity, as the predictor would leave it.
        both = _product(np.einsum("kij,kj->ki", W_inverse, ds), np.einsum("kij,kj->ki", W, dz))
        target = target - both + centring * gap * np.array((1.0, 0.0, 0.0))
        dx, ds, dz = scaled.direction(lam, (1.0 - centring) * r_x, (1.0 - centring) * r_z, target)
        # Both sides move by one step: on the boundary itself the scaling of the next iteration would be singular.
        step = min(1.0, _STEP * _to_boundary(s, ds), _STEP * _to_boundary(z, dz))
        if not math.isfinite(step) or step < _ACCURACY:
            break
        if _depth(s + step * ds) <= 0.0 or _depth(z + step * dz) <= 0.0:  # the last digits
            break
        x, s, z = x + step * dx, s + step * ds, z + step * dz
    return best


class _ScaledRows:
    """The rows A in the scaling of one iteration, factored once for both of its Newton directions."""

    def __init__(self, A: FloatArray, W_inverse: FloatArray) -> None:
        """Factor W^-1 A by the method of Householder, which squares no condition number."""
        self._A, self._W_inverse, shape = A, W_inverse, (*W_inverse.shape[:2], -1)
        self._Q, self._R = np.linalg.qr(np.einsum("kij,kjd->kid", W_inverse, A.reshape(shape)).reshape(A.shape))

    def direction(
        self, lam: FloatArray, r_x: FloatArray, r_z: FloatArray, target: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Newton direction (dx, ds, dz) with lam o (W dz + W^-1 ds) = target."""
        scaled = _divide(lam, target)
        # W dz = scaled - W^-1 ds and ds = -r_z - A dx give A^T W^-2 A dx = -r_x - A^T W^-1 (scaled + W^-1 r_z).
        right = scaled + np.einsum("kij,kj->ki", self._W_inverse, r_z)
        inner = triangular_solution(self._R, -r_x, transposed=True)
        dx = triangular_solution(self._R, inner - right.ravel() @ self._Q)
        ds = -r_z - (self._A @ dx).reshape(r_z.shape)
        dz = np.einsum("kij,kj->ki", self._W_inverse, scaled - np.einsum("kij,kj->ki", self._W_inverse, ds))
        return dx, ds, dz


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Jordan product of elements of second-order cones, (k, 3)."""
    across = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]
    return np.column_stack((np.sum(a * b, axis=1), across))


def _divide(a: FloatArray, b: FloatArray) -> FloatArray:
    """The element x with a o x = b, (k, 3)."""
    first, rest = a[:, 0], a[:, 1:]
    size = first * first - np.sum(rest * rest, axis=1)
    along = np.sum(rest * b[:, 1:], axis=1)
    head = (first * b[:, 0] - along) / size
    return np.column_stack((head, (b[:, 1:] - head[:, None] * rest) / first[:, None]))


def _scaling(s: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Scaling W of Nesterov and Todd with W z = W^-1 s for each cone, and its inverse, (k, 3, 3) each."""
    s_size, z_size = (np.sqrt(_determinant(vector)) for vector in (s, z))
    s_unit, z_unit = s / s_size[:, None], z / z_size[:, None]
    gamma = np.sqrt(0.5 * (1.0 + np.sum(s_unit * z_unit, axis=1)))
    w = (s_unit + _MIRROR * z_unit) / (2.0 * gamma[:, None])
    v = w + np.array((1.0, 0.0, 0.0))
    v /= np.sqrt(2.0 * (w[:, :1] + 1.0))
    beta = np.sqrt(s_size / z_size)[:, None, None]
    W = beta * (2.0 * v[:, :, None] * v[:, None, :] - np.diag(_MIRROR))
    mirrored = _MIRROR * v
    inverse = (2.0 * mirrored[:, :, None] * mirrored[:, None, :] - np.diag(_MIRROR)) / beta
    return W, inverse


def _determinant(s: FloatArray) -> FloatArray:
    """First component squared less the rest squared, positive inside a cone, (k,)."""
    # As a product: the difference of squares would lose what is left near the boundary, where all solutions end.
    size = np.hypot(s[:, 1], s[:, 2])
    return np.asarray(np.maximum((s[:, 0] - size) * (s[:, 0] + size), 1e-300))


def _interior(s: FloatArray) -> FloatArray:
    """The same point, moved along the axes of the cones until all are well inside."""
    least = _depth(s)
    shift = 0.0 if least > _INSIDE else 1.0 - least
    return s + shift * np.array((1.0, 0.0, 0.0))


def _depth(s: FloatArray) -> float:
    """Least distance of a point inside all cones from their boundaries, along the axis."""
    return float((s[:, 0] - np.hypot(s[:, 1], s[:, 2])).min())


def _to_boundary(s: FloatArray, step: FloatArray) -> float:
    """Largest share of a step that stays inside all cones."""
    best = math.inf
    for (a, b, c), (p, q, r) in zip(s.tolist(), step.tolist(), strict=True):
        # a + t p = hypot(b + t q, c + t r): the first positive root of a quadratic.
        square, linear, constant = p * p - q * q - r * r, a * p - b * q - c * r, a * a - b * b - c * c
        if p < 0.0:  # the tip of the cone, a double root
            best = min(best, -a / p)
        inside = linear * linear - square * constant
        if inside >= 0.0:
            root = math.sqrt(inside)
            # Neither root subtracts nearly equal numbers: one is constant / divisor, the other divisor / square.
            divisor = -linear + root if linear < 0.0 else -(linear + root)
            for t in ((constant / divisor if divisor else math.inf), (divisor / square if square else math.inf)):
                if 0.0 < t < best and a + t * p >= 0.0:
                    best = t
    return best
