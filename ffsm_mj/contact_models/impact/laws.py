"""Laws for several frictionless contacts at one instant, in mass-weighted velocities.

With M = L L^T, w = L^T qdot and A = J L^-T (one row per touching contact) the kinetic energy is |w|^2 / 2, the normal
velocities are A w, and an impulse lambda >= 0 gives w+ = w + A^T lambda.

``blend`` mixes the plastic solution with generalised reflections (Smith, Kaufman, Vouga, Tamstorf, Grinspun, ACM TOG
31(4), 2012): kinetic energy never grows, e = 1 conserves it, every post-impact normal velocity and every normal impulse is
non-negative, and symmetric scenes stay symmetric. ``poisson`` never gains energy either and dissipates more. ``newton`` is
the textbook law, allowed only where it is consistent. For one contact all three are the closed form of :func:`reflect`,
-(1 + e) u / (J M^-1 J^T). Several contacts have no unique physical answer: the law is a modelling choice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.tolerances import APPROACHING, CANCELLED, EPSILON, SOLVED

IMMOVABLE = "neither body can move along the contact normal"
"""Message for a contact whose J M^-1 J^T is zero."""
_VELOCITY_ROUNDING = 1e-13
"""Rounding of a contact velocity, relative to the norm of the mass-weighted velocity: some hundred EPSILON."""
_MAX_REFLECTIONS = 300
"""Reflections after which bodies count as squeezed without clearance: those between two that cannot part never end."""
_MAX_SWEEPS = 20_000
"""Largest number of sweeps: they converge linearly, and slowly where rows almost depend on each other."""


@dataclass(frozen=True)
class LawResult:
    """Outcome of a law.

    Attributes:
        impulses: Normal impulses, (m,), >= 0; of least norm if contacts are redundant.
        w: Mass-weighted velocity after, (n,).
        jammed: Whether no elastic solution was found, because bodies are squeezed without clearance: energy is lost.
    """

    impulses: FloatArray
    w: FloatArray
    jammed: bool = False


def impulse_of_one(u: float, inverse_mass: float, restitution: float) -> float:
    """Closed form for one contact, -(1 + e) u / (J M^-1 J^T), N s: takes the normal velocity from u to -e u.

    Args:
        u: Normal velocity before, m/s.
        inverse_mass: J M^-1 J^T, 1/kg.
        restitution: Coefficient e.
    """
    return -(1.0 + restitution) * u / inverse_mass


def reflect(M: FloatArray, J_n: FloatArray, qvel: FloatArray, restitution: float = 1.0) -> tuple[FloatArray, float]:
    """Single-contact map, applied whether the contact approaches or not: (qvel after, impulse in N s).

    For e = 1 it is a reflection in the metric of M: applied twice, it returns the initial velocity.

    Raises:
        ValueError: Neither body can move along the normal (J_n = 0).
    """
    response = np.linalg.solve(M, J_n)
    inverse_mass = float(J_n @ response)
    if inverse_mass <= 0.0:
        raise ValueError(IMMOVABLE)
    impulse = impulse_of_one(float(J_n @ qvel), inverse_mass, restitution)
    return qvel + response * impulse, impulse


def blend(A: FloatArray, w: FloatArray, e: FloatArray) -> LawResult:
    """Plastic solution and generalised reflections, mixed by restitution per contact.

    With equal e: (1 - e) plastic + e elastic. With different e, each contact gets at least its own mix and at most that of
    the largest e; a plastic step then makes all post-impact normal velocities non-negative.
    """
    plastic = project(A, w)
    if not np.any(e > 0.0):
        return _result(A, w, plastic)
    elastic, jammed = _reflections(A, w)
    if np.ptp(e) == 0.0:
        mixed = plastic + e * (elastic - plastic)
    else:
        # Four corners of a box may share an impulse in many ways: each mixes its part of the shortest, or rounding decides.
        plastic, elastic = least_norm(A, plastic), least_norm(A, elastic)
        mixed = plastic + np.minimum(e * (elastic - plastic), e.max() * (elastic - plastic))
    # Shares of different e need not leave every contact separating: one that keeps approaching would be hit again at once.
    rest = project(A, w + A.T @ mixed)
    return _result(A, w, mixed + rest, jammed=jammed)


def poisson(A: FloatArray, w: FloatArray, e: FloatArray) -> LawResult:
    """Compression to rest, then expansion with at least e times the compression impulse at each contact."""
    compression = project(A, w)
    if np.ptp(e) > 0.0:
        compression = least_norm(A, compression)  # for the same reason as in blend
    least = (1.0 + e) * compression
    return _result(A, w, least + project(A, w + A.T @ least))


def newton(A: FloatArray, w: FloatArray, e: FloatArray) -> LawResult:
    """Newton's law: 0 <= lambda, u+ + e u- >= 0, complementary.

    Raises:
        UnsupportedContactError: Restitutions differ, or a contact already separates: the law could then gain energy or leave
            contacts approaching.
    """
    speeds = A @ w
    if np.ptp(e) > 0.0 or np.any(speeds > APPROACHING * np.abs(speeds).max()):
        raise UnsupportedContactError("'newton' needs equal restitution and no contact that separates; use 'poisson'")
    return _result(A, w, (1.0 + e) * project(A, w))


FRICTIONLESS: dict[str, Callable[[FloatArray, FloatArray, FloatArray], LawResult]] = {
    "blend": blend,
    "poisson": poisson,
    "newton": newton,
}
"""Solvers (A, w, e) by the name of the built-in law that uses them for several contacts."""


def project(A: FloatArray, w: FloatArray) -> FloatArray:
    """Impulse lambda >= 0 that minimises |w + A^T lambda|: the plastic solution, unique in velocity.

    Non-negative least squares needs no inverse of A A^T, so redundant contacts need no special case; a row of zeros, of a
    contact whose gap no motion changes, gets no impulse. The optimality
    conditions, 0 <= lambda and A (w + A^T lambda) >= 0, complementary, are verified: otherwise a solution could create
    energy.
    """
    speeds = A @ w
    if not np.any(speeds < 0.0):
        return np.zeros(len(A))
    if len(A) == 1:
        return np.array([impulse_of_one(float(speeds[0]), float(A[0] @ A[0]), 0.0)])
    from scipy.optimize import nnls  # takes a second to import: only impacts with several contacts pay

    lengths = np.linalg.norm(A, axis=1)
    lengths[lengths == 0.0] = 1.0
    rows = A / lengths[:, None]
    try:
        scaled = np.asarray(nnls(rows.T, -w)[0])
    except RuntimeError:  # its iteration limit
        scaled = np.zeros(len(A))
    if not _optimal(rows, w, scaled):
        scaled = _sweeps(rows, w, scaled)
    return np.asarray(scaled / lengths)


def _optimal(rows: FloatArray, w: FloatArray, impulses: FloatArray) -> bool:
    after = rows @ (w + rows.T @ impulses)
    # Relative to the approach, but not below the rounding of the whole velocity, nor below that of the impulses: a sum of
    # products of k impulses with unit rows has a rounding error of k EPSILON times their sum. For a light body between
    # heavy ones the rows almost cancel, and the impulses are much larger than the velocities that they change.
    tolerance = SOLVED * float(np.abs(rows @ w).max()) + _VELOCITY_ROUNDING * float(np.linalg.norm(w))
    tolerance += len(rows) * EPSILON * float(impulses.sum())
    return bool(after.min() >= -tolerance and np.abs(after * (impulses > 0.0)).max() <= tolerance)


def _sweeps(rows: FloatArray, w: FloatArray, impulses: FloatArray) -> FloatArray:
    """Hildreth's cyclic projections: slow, but they always converge."""
    impulses = impulses.copy()
    velocity = w + rows.T @ impulses
    for _ in range(_MAX_SWEEPS):
        for i, row in enumerate(rows):
            change = max(-float(row @ velocity), -impulses[i])
            impulses[i] += change
            velocity += change * row
        if _optimal(rows, w, impulses):
            break
    return impulses


def _reflections(A: FloatArray, w: FloatArray) -> tuple[FloatArray, bool]:
    """Generalised reflections: reflect across the projection onto violated contacts until none is violated, else jammed."""
    impulses = np.zeros(len(A))
    velocity = w.copy()
    limit = -APPROACHING * float(np.abs(A @ w).max())
    for _ in range(_MAX_REFLECTIONS):
        violated = A @ velocity < limit
        if not violated.any():
            return impulses, False
        # At the plastic velocity the impulse does no work (complementarity), so twice of it keeps |w|: each reflection
        # conserves energy, and e = 1 does (Smith et al. 2012).
        step = 2.0 * project(A[violated], velocity)
        impulses[violated] += step
        velocity += A[violated].T @ step
    # Between walls without clearance every reflection is undone by the next. The plastic step stops that, and loses energy.
    return impulses + project(A, velocity), True


def _result(A: FloatArray, w: FloatArray, impulses: FloatArray, *, jammed: bool = False) -> LawResult:
    return LawResult(least_norm(A, impulses), w + A.T @ impulses, jammed)


def least_norm(A: FloatArray, impulses: FloatArray) -> FloatArray:
    """The shortest non-negative impulse with the same effect: four corners of a face share its load evenly."""
    along, sizes, _ = np.linalg.svd(A, full_matrices=True)
    rank = int(np.count_nonzero(sizes > CANCELLED * sizes[0]))
    scale = float(np.abs(impulses).max())
    # Independent rows determine the impulses; only redundant contacts, such as four corners of a box, have a choice.
    if rank == len(A) or scale == 0.0:
        return impulses
    idle = along[:, rank:]  # columns: changes of the impulses without effect on the velocity
    shortest = impulses / scale
    shortest = shortest - idle @ (idle.T @ shortest)
    # Shares of zero are negative by rounding, of as many terms as there are contacts: no change of that size can be found.
    if shortest.min() < -len(A) * EPSILON:
        change = _least_change(idle, -shortest)
        if change is None:
            return impulses  # valid, though not the shortest
        shortest = shortest + idle @ change
    return np.asarray(scale * np.maximum(shortest, 0.0))


def _least_change(G: FloatArray, h: FloatArray) -> FloatArray | None:
    """The shortest x with G x >= h, by non-negative least squares (Lawson and Hanson, chapter 23); None if it fails."""
    from scipy.optimize import nnls

    stacked, wanted = np.vstack((G.T, h)), np.zeros(G.shape[1] + 1)
    wanted[-1] = 1.0
    try:
        left = stacked @ nnls(stacked, wanted)[0] - wanted
    except RuntimeError:  # its iteration limit
        return None
    x = np.asarray(-left[:-1] / left[-1])
    return x if (G @ x - h).min() >= -SOLVED else None
