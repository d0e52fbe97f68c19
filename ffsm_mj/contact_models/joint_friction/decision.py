"""Which joints with dry friction slide, and how the others are held: a decision on all at rest, and on closed contacts.

Where contacts block a joint that also sticks, the share of its friction is not determined: a finger pressed on a wall by a
drive F against a friction f presses with any force from F - f to F + f. By convention the friction is idle: contacts and
limits carry what they can, and the frictions are those of least |tau / f| that the motion allows (``idle_friction``). They
are then combinations of the joints, fewer than these: along the others contacts alone hold.

Accelerations under forces that are bounded: dry friction of coordinates at rest, and unilateral constraints.

Of all accelerations, those under dry friction minimise

    (a - a_f)^T M (a - a_f) / 2 + sum_i f_i |A_i a + g_i|

subject to bilateral rows that hold and unilateral ones that do not close. The problem is strictly convex: the accelerations
are unique, also where the forces are not, as of two coupled joints. In mass-weighted coordinates, with rows W of which the
bilateral ones have been taken out, its dual is a bounded least-squares problem,

    minimise |w + W^T tau|   subject to   low <= tau <= high,   W w = accelerations of the rows without these forces

which an active-set method solves exactly (Stark & Parker, *Bounded-variable least-squares*, 1995).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.tolerances import RANK

_COMPLIANCE = 1e-10
"""Compliance of each row as a share of its inverse mass if nothing else were held.

Without it rows that depend on each other, as those of joints that a coupling joins, have no unique forces, and pivoting on
them may not end. It decides which rows are at a bound alone; the forces of the others are then those without compliance.
"""
_AT_BOUND = 1e-9
"""A force this close to its bound, as a share of it, is at the bound."""
_FAR = 1e6
"""A row moves for certain if holding it took this many times what holds all others: its own force is then at a bound.

Where the length of a tendon is extreme its row vanishes, but its second rate does not. Scaled with the need of such a row,
what holds the others would be lost in rounding.
"""
_MOVES = 1e-8
"""A row at its bound moves if it accelerates by more than this share of what its own force and all others do to it.

Above the effect of the compliance. A row that would move, but slower, is held with a force beyond its bound by as much: it
leaves its bound within a step, where the event is located.
"""


class BoundedForces(NamedTuple):
    """Solution for some rows.

    Attributes:
        forces: Forces along the rows, (n,).
        accelerations: Accelerations of the rows, (n,); zero to rounding where a row is held.
        moves: Direction in which each row accelerates, with its force at the opposite bound, -1 or 1; 0 if it is held, (n,).
    """

    forces: FloatArray
    accelerations: FloatArray
    moves: FloatArray


def bounded_forces(W: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, masses: FloatArray) -> BoundedForces:
    """Forces that keep rows from accelerating as far as their bounds allow.

    Args:
        W: Rows in mass-weighted coordinates, less what bilateral rows hold, (n, nv): W W^T are accelerations per force.
        b: Accelerations of the rows without these forces, (n,).
        low: Least forces, (n,); negative or zero.
        high: Greatest forces, (n,); positive, and infinite for a unilateral row.
        masses: Accelerations of each row per force along it if no row were held, (n,): the scale of the compliance.
    """
    G = W @ W.T
    diagonal = np.diag(G)
    # Rows that bilateral ones hold: no force moves them, and they carry none.
    free = diagonal > RANK * masses
    forces = np.zeros(len(b))
    certain = _certain(W, b, high, free & np.isfinite(low), free)
    forces[certain] = np.where(b < 0.0, high, low)[certain]
    others = free & ~certain
    if others.any():
        rest = b + G @ forces
        forces[others] = _bounded(W[others], rest[others], low[others], high[others], np.sqrt(masses[others]))
    accelerations = b + G @ forces
    # Accelerations are judged by the terms that cancel in them: rounding, and what the compliance leaves, are shares of
    # these.
    terms = np.abs(b) + diagonal * np.abs(forces)
    at_low = np.isfinite(low) & (forces <= (1.0 - _AT_BOUND) * low)
    at_high = np.isfinite(high) & (forces >= (1.0 - _AT_BOUND) * high)
    moves = np.where(at_high & (accelerations < -_MOVES * terms), -1.0, 0.0)
    moves = np.where(at_low & (accelerations > _MOVES * terms), 1.0, moves)
    moves[~free] = 0.0
    # Those that move have their bound itself, the others what holds them without compliance: the least change.
    forces = np.where(moves < 0.0, high, np.where(moves > 0.0, low, forces))
    bound = free & (moves == 0.0)
    if bound.any():
        # Coupled rows make G singular: of the forces with one effect, those of the least change.
        left = b[bound] + G[bound] @ forces
        forces[bound] -= np.linalg.lstsq(G[np.ix_(bound, bound)], left, rcond=RANK)[0]
    return BoundedForces(forces, b + G @ forces, moves)


def _certain(W: FloatArray, b: FloatArray, high: FloatArray, rubs: BoolArray, free: BoolArray) -> BoolArray:
    """Rows with dry friction that move whatever the forces on all rows are, (n,)."""
    certain = np.zeros(len(b), dtype=np.bool_)
    sizes = np.linalg.norm(W, axis=1)
    # What holding a row alone would take, in mass-weighted units: comparable between joints and tendons of any scale.
    needs = np.where(rubs, np.abs(b) / np.where(rubs, sizes, 1.0), 0.0)
    # With one row left nothing is lost beside it: its force follows by clipping.
    while np.count_nonzero(free & ~certain) > 1:
        most = int(np.argmax(np.where(certain, 0.0, needs)))
        others = free & ~certain
        others[most] = False
        # Forces on the others do at most what holds them: the solution is the projection of it on a convex set.
        forces = np.linalg.lstsq(W[others], b[others], rcond=None)[0]
        moving = certain | (np.arange(len(b)) == most)
        if needs[most] <= _FAR * (np.linalg.norm(forces) + sizes[moving] @ high[moving]):
            break
        certain[most] = True
    return certain


def _bounded(W: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, sizes: FloatArray) -> FloatArray:
    """Forces within their bounds that minimise the mass-weighted acceleration, with compliance, (n,)."""
    if len(b) == 1:
        return np.clip(-b / float(W[0] @ W[0]), low, high)
    from scipy.optimize import lsq_linear  # takes a second to import: only decisions between several rows pay

    # Units of the rows differ, N and N m, and the solver ends by an absolute tolerance: all are scaled to the order of one.
    scale = float(np.abs(b / sizes).max())
    if scale == 0.0:
        return np.zeros(len(b))
    rows = W / sizes[:, None]
    # Any w with W w = b will do: what is orthogonal to all rows adds a constant to the norm.
    w = np.linalg.lstsq(rows, b / sizes / scale, rcond=None)[0]
    compliant = np.vstack((rows.T, np.sqrt(_COMPLIANCE) * np.eye(len(b))))
    bounds = low * sizes / scale, high * sizes / scale
    solution = lsq_linear(compliant, -np.append(w, np.zeros(len(b))), bounds, method="bvls", tol=1e-15)
    return np.asarray(solution.x) / sizes * scale


def least_use(forces: FloatArray, idle: FloatArray, limits: FloatArray) -> FloatArray:
    """Of forces with the same effect those whose largest share of their limits is least, (n,): a linear programme.

    Args:
        forces: Some of these forces, (n,).
        idle: Forces without effect, (m, n).
        limits: Their limits, (n,).
    """
    from scipy.optimize import linprog  # takes time to import: only joints whose rows depend on each other pay

    shares, directions, ones = forces / limits, (idle / limits).T, np.ones((len(forces), 1))
    bounds = np.block([[directions, -ones], [-directions, -ones]])
    cost = np.append(np.zeros(len(idle)), 1.0)
    solution = linprog(cost, A_ub=bounds, b_ub=np.concatenate((-shares, shares)), bounds=(None, None), method="highs")
    return forces + solution.x[:-1] @ idle if solution.status == 0 else forces


_SURE = 1e-10
"""A joint that breaks away goes on although it decelerates by this share of what acts on it: it does not accelerate yet."""
_IDLE = 1e-6
"""Forces below this share of the largest carry nothing, and rows below this share of what cancels in them vanish."""
_EXACT = 1e4
"""Weight of the effect of forces over their size, where those of least size with one effect are found."""


class RestRows(NamedTuple):
    """Rows in mass-weighted coordinates, less what bilateral rows hold.

    Attributes:
        W: The rows, (n, nv).
        b: Their accelerations without dry friction and forces of contacts, (n,).
        low: Least forces along them, (n,).
        high: Greatest forces, (n,).
        masses: Their accelerations per force along each if no row were held, (n,).
    """

    W: FloatArray
    b: FloatArray
    low: FloatArray
    high: FloatArray
    masses: FloatArray


class Senses(NamedTuple):
    """A decision.

    Attributes:
        slides: Sense in which each joint slides, -1 or 1; 0: it sticks, (k,).
        at_rest: Combinations of the joints that their frictions hold, (r, k): unit rows of those that stick, fewer if
            contacts block some.
    """

    slides: FloatArray
    at_rest: FloatArray

    @classmethod
    def without_contacts(cls, slides: FloatArray) -> Senses:
        """Every joint that sticks is held by its friction alone."""
        return cls(slides, np.eye(len(slides))[slides == 0.0])

    @property
    def idle(self) -> BoolArray:
        """Joints that stick by contacts alone, (k,)."""
        return np.asarray((self.slides == 0.0) & ~self.at_rest.any(axis=0))


def decided(joints: RestRows, contacts: RestRows | None, slow: BoolArray, before: FloatArray) -> Senses:
    """Decide on the joints that are at rest.

    Args:
        joints: Rows of all joints with friction, with the limits of their frictions.
        contacts: Rows of closed contacts: normals, whose forces are positive, and tangents of points that stick; None: there
            are none.
        slow: Joints at rest, (k,).
        before: Senses: of joints at rest those in which they begin to slide, 0 if that is to be found, (k,).
    """
    # A joint that moves rubs against its rate, which no force changes at an instant.
    if not slow.any():
        return Senses.without_contacts(before)
    starts = slow & (before != 0.0)
    while True:
        still, slides = slow & ~starts, np.where(slow & ~starts, 0.0, before)
        rows = RestRows(*(array[still] for array in joints))
        if contacts is not None:
            rows = RestRows(*(np.concatenate(both) for both in zip(rows, contacts, strict=True)))
        # What slides has the size and sense of its friction: a load on those that are still.
        pushed = joints.W.T @ (joints.high * slides)
        solution = bounded_forces(rows.W, rows.b - rows.W @ pushed, rows.low, rows.high, rows.masses)
        count = int(still.sum())
        slides[still] = solution.moves[:count]
        # A joint that breaks away accelerates from zero; where the load on it falls instead, it sticks after all.
        a = joints.b - joints.W @ pushed + joints.W @ (rows.W.T @ solution.forces)
        back = starts & (slides * a < -_SURE * (np.abs(joints.b) + np.sum(joints.W**2, axis=1) * joints.high))
        if not back.any():
            break
        # Each pass takes a joint from those that start: the loop ends.
        starts &= ~back
    chosen = Senses.without_contacts(slides)
    if contacts is None:
        return chosen
    sticks = still & (slides == 0.0)
    kept = np.concatenate((solution.moves[:count] == 0.0, np.ones(len(contacts.b), dtype=np.bool_)))
    shared = _shared(RestRows(*(array[kept] for array in rows)), solution.forces[kept], int(sticks.sum()))
    if len(shared) == sticks.sum():
        return chosen
    shares = np.zeros((len(shared), len(slow)))
    shares[:, sticks] = shared
    return Senses(slides, shares)


def _shared(rows: RestRows, forces: FloatArray, count: int) -> FloatArray:
    """Combinations of joints along which their frictions hold, (r, count).

    With the rows W_c of contacts that carry force and P = 1 - W_c^+ W_c, the frictions tau = F x of least norm of x have
    x = U y with the left singular vectors U of F W P: the rows U^T F.

    Args:
        rows: Rows of joints that stick, then of contacts.
        forces: Forces along them with the right effect.
        count: Number of the joints.
    """
    from scipy.optimize import lsq_linear  # takes a second to import: only contacts at joints that stick pay

    limits, effect = rows.high[:count], rows.W.T @ forces
    scaled = rows.W * np.append(limits, np.ones(len(forces) - count))[:, None]
    scale = float(np.linalg.norm(effect))
    carries = ~np.isfinite(rows.low[count:])  # tangents of points that stick
    if scale > 0.0 and count < len(forces):
        size = np.append(np.ones(count), np.zeros(len(forces) - count))
        least = np.vstack((_EXACT / scale * scaled.T, np.diag(size)[:count]))
        low, high = np.append(-np.ones(count), rows.low[count:]), np.append(np.ones(count), rows.high[count:])
        shares = lsq_linear(least, np.append(_EXACT / scale * effect, np.zeros(count)), (low, high), method="bvls").x[count:]
        # Contacts that carry nothing in the least solution block nothing: only along the others is the friction idle.
        carries = carries | (shares > _IDLE * np.abs(shares).max(initial=0.0))
    of_contacts = np.linalg.svd(rows.W[count:][carries], full_matrices=False)
    V = of_contacts[2][of_contacts[1] > _IDLE * of_contacts[1].max(initial=0.0)]
    left = scaled[:count] - (scaled[:count] @ V.T) @ V
    U, sizes, _ = np.linalg.svd(left, full_matrices=False)
    rank = int(np.count_nonzero(sizes > _IDLE * np.linalg.norm(scaled[:count], axis=1).max(initial=0.0)))
    # Only where contacts block something is the friction shared: else each joint has a row of its own.
    return np.eye(count) if rank == count else _simple(U[:, :rank].T * limits)


def _simple(rows: FloatArray) -> FloatArray:
    """The rows with largest elements of one, and without those that are rounding."""
    scaled = rows / np.abs(rows).max(axis=1, initial=1e-300, keepdims=True)
    return np.where(np.abs(scaled) > _IDLE, scaled, 0.0)
