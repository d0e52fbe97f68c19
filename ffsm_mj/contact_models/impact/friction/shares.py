"""Shares of an impact among contacts whose rows depend on each other: of all with the same velocities after, the least norm.

Where bodies are squeezed between others, or a contact has a single relative motion, many impulses satisfy Coulomb's
conditions with the same velocities after. Which one an iteration finds is decided by rounding; the least norm is one
function of the state.
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, violation_of
from ffsm_mj.contact_models.impact.friction.result import clip_to_cone
from ffsm_mj.contact_models.impact.least_norm import least_norm_in, of_points, on_cones
from ffsm_mj.tolerances import APPROACHING, RANK

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
    mu, least, given = contacts.mu[closed], contacts.least[closed] / unit, impulses[closed] / unit
    slips = after[closed, 1:]
    speeds = np.hypot(slips[:, 0], slips[:, 1])
    slides = (speeds > APPROACHING * contacts.speed) & (mu > 0.0)
    rays = np.column_stack((np.ones(len(mu)), -mu[:, None] * slips / np.where(slides, speeds, 1.0)[:, None]))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    D = _directions(slides, mu, rays)
    along, sizes, _ = np.linalg.svd(D.T @ A.reshape(len(closed), 3, -1)[closed].reshape(3 * len(mu), -1))
    rank = int(np.count_nonzero(sizes > RANK * sizes.max(initial=0.0)))
    if rank == D.shape[1]:
        return impulses
    U = D @ along[:, :rank]

    def projected(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return of_points(*_projected(x.reshape(-1, 3), mu, least, slides, rays))

    found = least_norm_in(projected, U, U.T @ given.ravel())
    if found is None:
        return impulses
    result = impulses.copy()
    result[closed] = [clip_to_cone(p, limit) for p, limit in zip(unit * found.reshape(-1, 3), mu, strict=True)]
    return result if np.abs(violation_of(contacts, result)[0]).max() <= APPROACHING else impulses


def _directions(slides: BoolArray, mu: FloatArray, rays: FloatArray) -> FloatArray:
    """Orthonormal impulses that contacts can have: three that stick, one that slides or is without friction, (3k, m)."""
    columns: list[FloatArray] = []
    for i in range(len(mu)):
        own = rays[i : i + 1] if slides[i] else np.eye(3)[: 3 if mu[i] > 0.0 else 1]
        columns.extend(np.pad(each, (3 * i, 3 * (len(mu) - i - 1))) for each in own)
    return np.column_stack(columns)


def _projected(
    given: FloatArray, mu: FloatArray, least: FloatArray, slides: BoolArray, rays: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Nearest impulses inside cones above the least normal ones, on rays for contacts that slide, and derivatives."""
    moved = np.zeros_like(given)
    moved[:, 0] = np.where(mu > 0.0, _ROOM / np.where(mu > 0.0, mu, 1.0), 0.0)
    lam, slope = on_cones(given, mu, moved)
    length = np.sum(given * rays, axis=1)
    lam[slides] = (length[:, None] * rays)[slides]
    slope[slides] = (rays[:, :, None] * rays[:, None, :])[slides]
    for i in np.flatnonzero(lam[:, 0] < least):
        # The nearest point is in the plane of the least normal impulse: on the ray, or in the disc of friction.
        radius, across = mu[i] * least[i] + _ROOM, given[i, 1:]
        size = float(np.hypot(*across))
        if slides[i]:
            lam[i], slope[i] = rays[i] * (least[i] / rays[i, 0]), 0.0
            continue
        turned = np.array([-across[1], across[0]]) / size if size > radius else np.zeros(2)
        share = min(1.0, radius / size) if size > 0.0 else 1.0
        lam[i], slope[i] = (least[i], *(share * across)), 0.0
        slope[i, 1:, 1:] = np.eye(2) if size <= radius else share * np.outer(turned, turned)
    return lam, slope
