"""Discrete Coulomb friction of several contacts at one instant, by Newton's method on the function of Alart and Curnier.

With u = u0 + G lambda after, G = A A^T, and an impulse (lambda_n, lambda_t) of each contact,

    0 <= lambda_n - least, u_n >= 0, complementary;  |lambda_t| <= mu lambda_n;  lambda_t . u_t = -mu lambda_n |u_t|

holds if F = 0, where F_n = lambda_n - a, F_t = lambda_t less the projection of lambda_t - r_t u_t on the disc of radius
mu a, and a = max(least, lambda_n - r_n u_n) (Alart & Curnier 1991). A solution exists for every G = A A^T and u0 = A w; it
dissipates if ``least`` is zero. Steps of least norm need no special case for redundant contacts. If Newton's method stalls,
for example with slip so slow that the Jacobian is nearly singular, damped steps (Levenberg, Marquardt) continue; if these
stall, Lemke's method on friction pyramids gives both another start.

Several contacts with friction pyramids instead of cones: Lemke's method on the problem of Stewart and Trinkle (1996).

The friction impulse of a contact is a sum of beta_j >= 0 along nd directions d_j. With the normal impulse nu above the least
one, the slip speed sigma, the normals and directions B, and the matrix E that assigns directions to contacts,

    0 <= (nu, beta, sigma)  _|_  (B^T u, with sigma added along each direction;  mu (least + nu) - E^T beta) >= 0.

The lexicographic ratio test prevents cycling in degenerate problems, such as symmetric scenes.

Coulomb friction at the level of accelerations: forces of contacts of which some slide already.

Friction of a sliding contact follows its normal force along a given direction, -mu lambda_n u_t / |u_t|; that of the others
is opposed to their tangential acceleration, as that of an impulse is to the slip after it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.impact.friction.result import clip_to_cone
from ffsm_mj.tolerances import CANCELLED, EPSILON, RANK, SOLVED

_PIVOTS_PER_ROW = 20
"""Lemke's method is given up after so many pivots per row: a solution is found within a few, and it does not cycle."""
_ZERO = 1e-11
"""Entries of a column below this are rounding, not pivots: entries are of the order of 1, after hundreds of pivots."""


def pyramid_impulses(
    G: FloatArray, u: FloatArray, mu: FloatArray, least: FloatArray, speed: float, facets: int, first: FloatArray
) -> FloatArray:
    """Impulses (k, 3) with friction inside pyramids; the last iterate if the method ends without a solution.

    Args:
        G: A A^T, (3k, 3k).
        u: Velocities before, (3k,).
        mu: Coefficients of friction, (k,).
        least: Least normal impulses, (k,).
        speed: Largest contact speed before.
        facets: Directions of friction per contact.
        first: Angle of the first direction of each contact, (k,).
    """
    count = len(mu)
    # In units of the speed and of G_nn^(1/2) of each contact, entries are of the order of one.
    unit = 1.0 / np.sqrt(np.abs(np.diag(G)[::3]))
    normals, directions = np.zeros((3 * count, count)), np.zeros((3 * count, count * facets))
    # Without these units a light and a heavy contact differ by their mass ratio, and the one threshold _ZERO fits neither.
    for i in range(count):
        angles = first[i] + 2.0 * np.pi / facets * np.arange(facets)
        normals[3 * i, i] = unit[i]
        block = directions[3 * i : 3 * i + 3, i * facets : (i + 1) * facets]
        block[1], block[2] = unit[i] * np.cos(angles), unit[i] * np.sin(angles)
    B = np.hstack((normals, directions))
    base = np.zeros(3 * count)
    base[::3] = least
    E = np.repeat(np.eye(count), facets, axis=0)
    M = np.block(
        [
            [B.T @ G @ B, np.vstack((np.zeros((count, count)), E))],
            [np.diag(mu), -E.T, np.zeros((count, count))],
        ]
    )
    q = np.concatenate((B.T @ (u + G @ base) / speed, mu * least / (unit * speed)))
    z = lemke(M, q)
    impulses: FloatArray = base + speed * (B @ z[: count * (1 + facets)])
    return impulses.reshape(-1, 3)


def lemke(M: FloatArray, q: FloatArray) -> FloatArray:
    """Solve M z + q >= 0, z >= 0, complementary, for z; the last iterate on a ray or after too many pivots.

    The tableau holds w - M z - z0 = q; its first columns are the inverse of the basis, which the ratio test needs.
    """
    size = len(q)
    # No contact approaches: z = 0 solves the problem, and the artificial variable would have no row to enter by.
    if q.min() >= 0.0:
        return np.zeros(size)
    tableau = np.hstack((np.eye(size), -M, -np.ones((size, 1)), q[:, None]))
    basis = np.arange(size)
    artificial = 2 * size
    entering, leaving_row = (
        artificial,
        size - 1 - int(np.argmin(q[::-1])),
    )  # of equal ones, the last is lexicographically least
    for _ in range(_PIVOTS_PER_ROW * size):
        left = int(basis[leaving_row])
        _pivot(tableau, leaving_row, entering)
        basis[leaving_row] = entering
        # The artificial variable has left the basis: the rest is a complementary solution.
        if left == artificial:
            break
        entering = left + size if left < size else left - size
        row = _leaving(tableau, entering, basis == artificial)
        # On a ray no variable leaves. The problem has a solution where ``least`` is zero (its matrix is copositive): then it
        # is rounding. The iterate is a start for Newton's method all the same.
        if row is None:
            break
        leaving_row = row
    z = np.zeros(2 * size + 1)
    z[basis] = np.maximum(tableau[:, -1], 0.0)
    return z[size : 2 * size]


def _pivot(tableau: FloatArray, row: int, column: int) -> None:
    tableau[row] /= tableau[row, column]
    others = tableau[:, column].copy()
    others[row] = 0.0
    tableau -= np.outer(others, tableau[row])


def _leaving(tableau: FloatArray, column: int, artificial: BoolArray) -> int | None:
    """Row of the lexicographically least ratio, or None on a ray; the artificial variable leaves as soon as possible."""
    entries = tableau[:, column]
    rows = np.flatnonzero(entries > _ZERO)
    if not len(rows):
        return None
    size = len(tableau)
    ratios = tableau[rows, -1] / entries[rows]
    rows = rows[ratios <= ratios.min() + _ZERO * max(1.0, abs(float(ratios.min())))]
    # Of equal ratios that of the artificial variable ends the method; another choice could pivot on and lose the solution.
    if artificial[rows].any():
        return int(rows[artificial[rows]][0])
    # The lexicographic rule compares ties by the columns of the inverse basis: in symmetric scenes ratios tie, and would
    # cycle.
    for other in range(size):
        if len(rows) == 1:
            break
        ratios = tableau[rows, other] / entries[rows]
        rows = rows[ratios <= ratios.min() + _ZERO * max(1.0, abs(float(ratios.min())))]
    return int(rows[0])


_AIM = 1e-11
"""Residual at which iterations end, one hundredth of SOLVED."""
_STEPS, _HALVINGS, _DAMPED_STEPS = 60, 12, 200
"""Most steps of Newton's method, halvings of one of them, and damped steps, before the next method takes over.

Impacts of the tests that Newton's method solves take up to 36 steps, those left to the damped one up to 121.
"""
_FIRST_DAMPING, _MAX_DAMPING = 1e-3, 1e12
"""Damping of the first damped step, and that at which steps have become too short to change anything."""
_SUFFICIENT = 1e-4
"""Share of the linear prediction by which a step must lower the residual (Armijo's condition)."""
_MEMORY = 4
"""A step must lower the largest of this many residuals: a kink of F may raise the residual for a few steps."""
_ALIGNED = None
_FACETS = ((8, 0.0), (16, 0.0), (32, 0.0), (64, 0.0), (8, np.pi / 8), (128, 0.0), *6 * ((12, _ALIGNED),))
"""Numbers of facets of the pyramids, with the angle of the first; aligned: opposite to the slip of the best impulses."""
_MAX_FACETS = 700
"""Largest number of facets of all contacts together: a larger tableau takes many seconds."""


_COMPLIANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 0.0)
"""Compliance of redundant contacts, as shares of their inverse masses: the first is found from anywhere, each from the one
before."""


@dataclass
class CoulombProblem:
    """k contacts at one instant.

    Attributes:
        G: A A^T for rows (n, t1, t2) of each contact, (3k, 3k), 1/kg; G_nn > 0.
        u: Velocities before, (3k,), m/s.
        mu: Coefficients of friction, (k,).
        least: Least normal impulses, >= 0, (k,), N s.
        speed: Unit of speeds: the largest contact speed before the impact, m/s.
        inertia: Symmetric matrix that scales the unknowns, (3k, 3k); None for G itself, which need not be symmetric
            otherwise.
    """

    G: FloatArray
    u: FloatArray
    mu: FloatArray
    least: FloatArray
    speed: float
    inertia: FloatArray | None = None

    def __post_init__(self) -> None:
        count, inertia = len(self.mu), self.G if self.inertia is None else self.inertia
        self.rows = self.G.reshape(count, 3, 3 * count)
        normal = np.diag(inertia)[::3]
        largest = np.array([np.linalg.eigvalsh(inertia[i : i + 2, i : i + 2])[-1] for i in range(1, 3 * count, 3)])
        # A tangent along which nothing moves has no slip to correct: any scale serves.
        across = np.where(largest > 0.0, largest, normal)
        self.r = 1.0 / np.stack((normal, across, across), axis=1)
        self.share: FloatArray = 1.0 / (self.r * self.speed)

    def after(self, impulses: FloatArray) -> FloatArray:
        """Velocities after impulses (k, 3): (k, 3)."""
        return np.asarray(self.u + self.G @ impulses.ravel()).reshape(-1, 3)


def coulomb(contacts: CoulombProblem) -> tuple[FloatArray, float]:
    """Impulses, (k, 3), exactly inside their cones, and their residual; above SOLVED they are no solution."""
    least_only = np.zeros((len(contacts.mu), 3))
    least_only[:, 0] = contacts.least
    # Start from the least impulses, or near the solution of compliant contacts; pyramids give other starts if that fails.
    best, residual = _solve(contacts, _of_compliant(contacts, least_only))
    for facets, turn, wider in _pyramids(len(contacts.mu)):
        if residual <= SOLVED:
            break
        first = _against_slip(contacts, best) if turn is _ALIGNED else np.full(len(contacts.mu), turn)
        mu, scales = wider * contacts.mu, (contacts.least, contacts.speed)
        impulses, left = _solve(contacts, pyramid_impulses(contacts.G, contacts.u, mu, *scales, facets, first))
        if left < residual:
            best, residual = impulses, left
    # Remove what the residual left: open contacts get exactly their least impulse, and impulses are clipped to their cones.
    # What is left would be a force of rounding on a contact that opens, and its record would show an impulse.
    open_ = _split(contacts, best)[1] <= contacts.least
    best[open_, 0] = contacts.least[open_]
    best[:, 0] = np.maximum(best[:, 0], contacts.least)
    return np.stack([clip_to_cone(impulse, mu) for impulse, mu in zip(best, contacts.mu, strict=True)]), residual


def _of_compliant(contacts: CoulombProblem, start: FloatArray) -> FloatArray:
    """Impulses, (k, 3), of contacts that yield less and less, at last not at all; the start itself where none is redundant.

    Where friction at several points of a face slides in different directions, redundant contacts have many solutions, with
    other velocities each: rounding, or the order of the points, would choose among them. Each of these problems has one.
    """
    sizes = np.linalg.eigvalsh(0.5 * (contacts.G + contacts.G.T))
    if sizes[0] > RANK * sizes[-1]:
        return start
    yields, approach = np.diag(np.diag(contacts.G)), float(-contacts.u[::3].min())
    # Where a body slides fast and lands slowly, a residual of its slip would be an approach that is left.
    aim = _AIM * min(max(approach / contacts.speed, EPSILON), 1.0)
    for share in _COMPLIANCES:
        start, _ = _newton(replace(contacts, G=contacts.G + share * yields), start, aim)
    return start


def _pyramids(count: int) -> Iterator[tuple[int, float | None, float]]:
    """Facets, angle of the first, and a factor of mu, for pyramids inside the friction cone and around it.

    A pyramid around the cone keeps contacts sticking that nearly slip, one inside it lets them slip.
    """
    for facets, turn in _FACETS:
        # Pivots cost the square of the rows and their number grows with the rows: the cost grows with the cube of the
        # facets.
        if count * facets > _MAX_FACETS:
            continue
        yield facets, turn, 1.0
        yield facets, turn, 1.0 / np.cos(np.pi / facets)


def _against_slip(contacts: CoulombProblem, impulses: FloatArray) -> FloatArray:
    """Angles opposite to the slip after some impulses, (k,)."""
    after = contacts.after(impulses)
    return np.arctan2(-after[:, 2], -after[:, 1])


def _split(contacts: CoulombProblem, impulses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Arguments of the two projections: lambda - r u, (k, 3), and its normal part, (k,)."""
    whole = impulses - contacts.r * contacts.after(impulses)
    return whole, whole[:, 0]


def _solve(contacts: CoulombProblem, start: FloatArray) -> tuple[FloatArray, float]:
    """The best impulses from a start, (k, 3), and their residual."""
    best, residual = _newton(contacts, start)
    return (best, residual) if residual <= SOLVED else _damped(contacts, best)


def _newton(contacts: CoulombProblem, start: FloatArray, aim: float = _AIM) -> tuple[FloatArray, float]:
    """Newton's method with a non-monotone line search, up to a residual."""
    impulses, share = start, contacts.share.ravel()
    violation, slopes = violation_of(contacts, impulses)
    best, least = impulses, float(np.abs(violation).max())
    sizes = deque([float(np.linalg.norm(violation))], maxlen=_MEMORY)
    for _ in range(_STEPS):
        if least < aim:
            break
        # In one unit for all unknowns the step of least norm shares impulses among redundant contacts by their inertia.
        step = np.linalg.lstsq(slopes * (share[:, None] / share), -violation, rcond=CANCELLED)[0] / share
        # F is piecewise smooth: a full step across a kink, between slip and stick, may increase the residual.
        for halving in range(_HALVINGS):
            part = 0.5**halving
            trial = impulses + part * step.reshape(-1, 3)
            violation, slopes = violation_of(contacts, trial)
            size = float(np.linalg.norm(violation))
            if size <= (1.0 - _SUFFICIENT * part) * max(sizes):
                break
        else:
            break
        impulses = trial
        sizes.append(size)
        if np.abs(violation).max() < least:
            best, least = impulses, float(np.abs(violation).max())
    return best, least


def _damped(contacts: CoulombProblem, start: FloatArray) -> tuple[FloatArray, float]:
    """The method of Levenberg and Marquardt: slower, but each step lowers the residual."""
    impulses, share, damping = start, contacts.share.ravel(), _FIRST_DAMPING
    violation, slopes = violation_of(contacts, impulses)
    for _ in range(_DAMPED_STEPS):
        size = float(np.linalg.norm(violation))
        if np.abs(violation).max() < _AIM or damping > _MAX_DAMPING:
            break
        # Damping that falls with the residual keeps the convergence fast although the Jacobian is singular at redundant
        # contacts (Fan & Yuan, Computing 74, 2005).
        stacked = np.vstack((slopes * (share[:, None] / share), np.sqrt(damping * size) * np.eye(len(share))))
        step = np.linalg.lstsq(stacked, np.append(-violation, np.zeros(len(share))), rcond=None)[0] / share
        trial = impulses + step.reshape(-1, 3)
        there, slopes_there = violation_of(contacts, trial)
        if np.linalg.norm(there) < size:
            impulses, violation, slopes, damping = trial, there, slopes_there, max(damping / 5.0, CANCELLED)
        else:
            damping *= 4.0
    return impulses, float(np.abs(violation).max())


def violation_of(contacts: CoulombProblem, impulses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F in units of ``speed``, (3k,), and one element of its generalised Jacobian dF/dlambda, (3k, 3k), unscaled."""
    count = len(contacts.mu)
    whole, normal = _split(contacts, impulses)
    closed = normal > contacts.least
    length_n = np.where(closed, normal, contacts.least)
    radius, length = contacts.mu * length_n, np.hypot(whole[:, 1], whole[:, 2])
    # A cone of width zero has no inside: without friction a contact always takes the branch of sliding, with zero force.
    slides = (length > radius) | (radius <= 0.0)
    # The projection on the disc has no direction at its centre; any does, as the radius is zero wherever this is used.
    along = whole[:, 1:] / np.where(length > 0.0, length, 1.0)[:, None]
    projected = np.where(slides[:, None], radius[:, None] * along, whole[:, 1:])
    F = impulses - np.column_stack((length_n, projected))
    return (F * contacts.share).ravel(), _slopes(contacts, closed, slides, along, radius, length).reshape(3 * count, -1)


def _slopes(
    contacts: CoulombProblem, closed: BoolArray, slides: BoolArray, along: FloatArray, radius: FloatArray, length: FloatArray
) -> FloatArray:
    """Element of the generalised Jacobian dF/dlambda, (k, 3, 3k).

    A contact is open or closed, and sticks or slides: each combination has its own branch of the projections in F.
    """
    count = len(closed)
    unit = np.eye(3 * count).reshape(count, 3, 3 * count)
    pushed = contacts.r[:, :, None] * contacts.rows
    slopes = pushed.copy()
    slopes[~closed, 0] = unit[~closed, 0]
    for i in np.flatnonzero(slides):
        across = np.eye(2) - np.outer(along[i], along[i])
        turned = radius[i] / length[i] * across if radius[i] > 0.0 else np.zeros((2, 2))
        lengthened = unit[i, 0] - pushed[i, 0] if closed[i] else np.zeros(3 * count)
        slopes[i, 1:] = unit[i, 1:] - turned @ (unit[i, 1:] - pushed[i, 1:])
        slopes[i, 1:] -= contacts.mu[i] * np.outer(along[i], lengthened)
    return slopes


_COMPLIANCE = 1e-9
"""Compliance of the contacts, as a share of the mean inverse mass: it shares forces among redundant ones."""


def coulomb_forces(G: FloatArray, b: FloatArray, mu: FloatArray, slips: FloatArray) -> tuple[FloatArray, float]:
    """Forces (n, t1, t2) of k closed contacts, N, (k, 3), and their residual; above SOLVED they are no solution.

    Args:
        G: Delassus matrix of rows (n, t1, t2) of each contact, 1/kg, (3k, 3k); G_nn > 0.
        b: Accelerations without contact forces, m/s^2, (3k,).
        mu: Coefficients of friction, (k,).
        slips: Slip velocities of sliding contacts, of any length, (k, 2); zero for those without slip.
    """
    scale, sizes = float(np.abs(b).max(initial=0.0)), np.hypot(slips[:, 0], slips[:, 1])
    # Nothing accelerates the contacts, and nothing may be divided by a scale of zero.
    if scale == 0.0:
        return np.zeros((len(mu), 3)), 0.0
    slides = sizes > 0.0
    # The column of the normal force of a sliding contact gets its friction too.
    along = np.eye(len(b))
    for i in np.flatnonzero(slides).tolist():
        along[3 * i + 1 : 3 * i + 3, 3 * i] = -mu[i] * (slips[i] / sizes[i])
    # With friction columns the matrix is not symmetric, and redundant contacts make it singular: without the compliance
    # their shares of a load would not be determined.
    compliant = G @ along + _COMPLIANCE * float(G.diagonal()[::3].mean()) * np.eye(len(b))
    still = np.where(slides, 0.0, mu)
    contacts = CoulombProblem(compliant, b, still, np.zeros(len(mu)), scale, inertia=G)
    forces, residual = coulomb(contacts)
    return (along @ forces.ravel()).reshape(-1, 3), residual
