"""Which joints with dry friction slide, and how the others are held: a decision on all at rest, and on closed contacts.

Where contacts block a joint that also sticks, the share of its friction is not determined: a finger pressed on a wall by a
drive F against a friction f presses with any force from F - f to F + f. By convention the friction is idle: contacts and
limits carry what they can, and the frictions are those of least |tau / f| that the motion allows (``idle_friction``). They
are then combinations of the joints, fewer than these: along the others contacts alone hold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.joint_friction.box import bounded_forces

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
        held: Combinations of the joints that their frictions hold, (r, k): unit rows of those that stick, fewer if contacts
            block some.
    """

    slides: FloatArray
    held: FloatArray

    @classmethod
    def without_contacts(cls, slides: FloatArray) -> Senses:
        """Every joint that sticks is held by its friction alone."""
        return cls(slides, np.eye(len(slides))[slides == 0.0])

    @property
    def idle(self) -> BoolArray:
        """Joints that stick by contacts alone, (k,)."""
        return np.asarray((self.slides == 0.0) & ~self.held.any(axis=0))


def decided(joints: RestRows, contacts: RestRows | None, slow: BoolArray, before: FloatArray) -> Senses:
    """Decide on the joints that are at rest.

    Args:
        joints: Rows of all joints with friction, with the limits of their frictions.
        contacts: Rows of closed contacts: normals, whose forces are positive, and tangents of points that stick; None: there
            are none.
        slow: Joints at rest, (k,).
        before: Senses: of joints at rest those in which they begin to slide, 0 if that is to be found, (k,).
    """
    if not slow.any():
        return Senses.without_contacts(before)
    starts = slow & (before != 0.0)
    while True:
        still, slides = slow & ~starts, np.where(slow & ~starts, 0.0, before)
        rows = RestRows(*(each[still] for each in joints))
        if contacts is not None:
            rows = RestRows(*(np.concatenate(both) for both in zip(rows, contacts, strict=True)))
        pushed = joints.W.T @ (joints.high * slides)
        found = bounded_forces(rows.W, rows.b - rows.W @ pushed, rows.low, rows.high, rows.masses)
        count = int(still.sum())
        slides[still] = found.moves[:count]
        # A joint that breaks away accelerates from zero; where the load on it falls instead, it sticks after all.
        a = joints.b - joints.W @ pushed + joints.W @ (rows.W.T @ found.forces)
        back = starts & (slides * a < -_SURE * (np.abs(joints.b) + np.sum(joints.W**2, axis=1) * joints.high))
        if not back.any():
            break
        starts &= ~back
    chosen = Senses.without_contacts(slides)
    if contacts is None:
        return chosen
    sticks = still & (slides == 0.0)
    kept = np.concatenate((found.moves[:count] == 0.0, np.ones(len(contacts.b), dtype=np.bool_)))
    shared = _shared(RestRows(*(each[kept] for each in rows)), found.forces[kept], int(sticks.sum()))
    if len(shared) == sticks.sum():
        return chosen
    held = np.zeros((len(shared), len(slow)))
    held[:, sticks] = shared
    return Senses(slides, held)


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
        found = lsq_linear(least, np.append(_EXACT / scale * effect, np.zeros(count)), (low, high), method="bvls").x[count:]
        carries = carries | (found > _IDLE * np.abs(found).max(initial=0.0))
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
