"""Impulses and forces of least norm, of all that have the same effect and lie in convex sets such as friction cones.

    minimise |lam|^2   subject to   U^T lam = effect,   lam in K

The columns of U span all forces that have an effect. The dual problem is smooth and has few unknowns y: lam is the
projection of U y onto K, and y follows from U^T lam = effect by Newton's method with a line search (Qi & Sun, *A nonsmooth
version of Newton's method*, 1993). The answer is unique: it does not depend on which of the forces was found first.

Shares of an impact among contacts whose rows depend on each other: of all with the same velocities after, the least norm.

Where bodies are squeezed between others, or a contact has a single relative motion, many impulses satisfy Coulomb's
conditions with the same velocities after. Which one an iteration finds is decided by rounding; the least norm is one
function of the state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, violation_of
from ffsm_mj.contact_models.impact.friction.result import clip_to_cone
from ffsm_mj.tolerances import APPROACHING, RANK

Projection: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Nearest forces in K to given ones, (n,), and their derivatives by these, (n, n)."""
_ACCURACY, _ROUNDING = 1e-13, 1e-15
"""Residual of the effect at which iterations end, for forces up to one, and its rounding as a share of the largest unknown,
which is large where K leaves little room."""
_SOLVED = 1e-10
"""Residual at which the answer is accepted."""
_ITERATIONS, _HALVINGS = 200, 30
"""Largest numbers of Newton's steps, and of halvings of one of them.

In the tests sets that leave room take up to 28 steps; where K leaves none, no number suffices. Half to the power of 30 is a
step of 1e-9, whose change of the dual function is its rounding.
"""
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
    # The point of K of least norm with the effect is the projection of x = U y onto K, where y solves the dual problem,
    # which has no constraints. At y = effect x is the solution without K.
    y: FloatArray = effect.copy()
    for _ in range(_ITERATIONS):
        lam, slope = projected(U @ y)
        miss = effect - U.T @ lam
        if float(np.abs(miss).max()) <= max(_ACCURACY, _ROUNDING * float(np.abs(y).max())):
            break
        # The damping vanishes with the residual, so that it does not slow the last steps.
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

    dual, lam = value(y)
    slope = float((U.T @ lam - effect) @ step)
    share = 1.0
    for _ in range(_HALVINGS):
        # To rounding of the value any step near the solution is good.
        if value(y + share * step)[0] <= dual + 1e-4 * share * slope + 1e-15 * (1.0 + abs(dual)):
            break
        share *= 0.5
    return np.asarray(y + share * step)


def on_cones(points: FloatArray, mu: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest forces inside cones with tips at ``-moved``, (k, 3), and derivatives by each given one, (k, 3, 3)."""
    forces = points + moved
    n, t = forces[:, 0], np.hypot(forces[:, 1], forces[:, 2])
    # Projection on a circular cone: itself inside, the tip in the polar cone, else a point of the mantle.
    inside, tip = t <= mu * n, mu * t <= -n
    onto = (n + mu * t) / (1.0 + mu * mu)
    e = forces[:, 1:] / np.where(t > 0.0, t, 1.0)[:, None]
    side = np.column_stack((onto, (mu * onto)[:, None] * e))
    lam = np.where(inside[:, None], forces, np.where(tip[:, None], 0.0, side))
    ray = np.column_stack((np.ones(len(mu)), mu[:, None] * e)) / np.sqrt(1.0 + mu * mu)[:, None]
    across = np.column_stack((np.zeros(len(mu)), -e[:, 1], e[:, 0]))
    turn = mu * onto / np.where(t > 0.0, t, 1.0)
    # On the mantle: unity along its ray, the ratio of the distances from the axis around it, zero across it.
    slope = ray[:, :, None] * ray[:, None, :] + turn[:, None, None] * across[:, :, None] * across[:, None, :]
    slope = np.where(inside[:, None, None], np.eye(3), np.where(tip[:, None, None], 0.0, slope))
    return lam - moved, slope


def of_points(lam: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces of k points, (k, 3), with derivatives of each by its own, (k, 3, 3), as one vector, (3k,), and matrix."""
    count = len(lam)
    whole = np.zeros((count, 3, count, 3))
    whole[np.arange(count), :, np.arange(count)] = slope
    return lam.ravel(), whole.reshape(3 * count, -1)


_ROOM = 1e-11
"""Cones are larger by this share of the largest impulse: otherwise contacts about to slip leave no room. Impulses are
clipped to the cones afterwards, so it is below APPROACHING, to which the conditions must hold then."""


def shared(contacts: CoulombProblem, A: FloatArray, impulses: FloatArray) -> FloatArray:
    """The impulses of least norm, (k, 3), that satisfy the conditions with the velocities after of given ones.

    Contacts that separate keep their least impulse, those that slide its direction. The given impulses are returned bit for
    bit where they are the only ones, and where the cones leave no room for others.

    Args:
        contacts: The contacts.
        A: Mass-weighted rows of them, (3k, n).
        impulses: A solution, (k, 3).
    """
    after = contacts.after(impulses)
    closed = after[:, 0] <= APPROACHING * contacts.speed
    unit = float(np.abs(impulses[closed]).max(initial=0.0))
    if unit == 0.0:
        return impulses
    mu, least, inside = contacts.mu[closed], contacts.least[closed] / unit, impulses[closed] / unit
    slips = after[closed, 1:]
    speeds = np.hypot(slips[:, 0], slips[:, 1])
    slides = (speeds > APPROACHING * contacts.speed) & (mu > 0.0)
    rays = np.column_stack((np.ones(len(mu)), -mu[:, None] * slips / np.where(slides, speeds, 1.0)[:, None]))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    D = _directions(slides, mu, rays)
    along, sizes, _ = np.linalg.svd(D.T @ A.reshape(len(closed), 3, -1)[closed].reshape(3 * len(mu), -1))
    rank = int(np.count_nonzero(sizes > RANK * sizes.max(initial=0.0)))
    # Velocities determine impulses along independent columns: there are no others to choose from.
    if rank == D.shape[1]:
        return impulses
    U = D @ along[:, :rank]

    def projected(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return of_points(*_projected(x.reshape(-1, 3), mu, least, slides, rays))

    nearest = least_norm_in(projected, U, U.T @ inside.ravel())
    if nearest is None:
        return impulses
    result = impulses.copy()
    result[closed] = [clip_to_cone(p, limit) for p, limit in zip(unit * nearest.reshape(-1, 3), mu, strict=True)]
    # The clipping has moved impulses by up to _ROOM: the conditions are tested on what is returned.
    return result if np.abs(violation_of(contacts, result)[0]).max() <= APPROACHING else impulses


def _directions(slides: BoolArray, mu: FloatArray, rays: FloatArray) -> FloatArray:
    """Orthonormal impulses that contacts can have: three that stick, one that slides or is without friction, (3k, m)."""
    columns: list[FloatArray] = []
    for i in range(len(mu)):
        basis = rays[i : i + 1] if slides[i] else np.eye(3)[: 3 if mu[i] > 0.0 else 1]
        columns.extend(np.pad(ray, (3 * i, 3 * (len(mu) - i - 1))) for ray in basis)
    return np.column_stack(columns)


def _projected(
    impulses: FloatArray, mu: FloatArray, least: FloatArray, slides: BoolArray, rays: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Nearest impulses inside cones above the least normal ones, on rays for contacts that slide, and derivatives."""
    moved = np.zeros_like(impulses)
    moved[:, 0] = np.where(mu > 0.0, _ROOM / np.where(mu > 0.0, mu, 1.0), 0.0)
    lam, slope = on_cones(impulses, mu, moved)
    length = np.sum(impulses * rays, axis=1)
    lam[slides] = (length[:, None] * rays)[slides]
    slope[slides] = (rays[:, :, None] * rays[:, None, :])[slides]
    for i in np.flatnonzero(lam[:, 0] < least):
        # The nearest point is in the plane of the least normal impulse: on the ray, or in the disc of friction.
        radius, across = mu[i] * least[i] + _ROOM, impulses[i, 1:]
        size = float(np.hypot(*across))
        if slides[i]:
            lam[i], slope[i] = rays[i] * (least[i] / rays[i, 0]), 0.0
            continue
        turned = np.array([-across[1], across[0]]) / size if size > radius else np.zeros(2)
        share = min(1.0, radius / size) if size > 0.0 else 1.0
        lam[i], slope[i] = (least[i], *(share * across)), 0.0
        slope[i, 1:, 1:] = np.eye(2) if size <= radius else share * np.outer(turned, turned)
    return lam, slope
