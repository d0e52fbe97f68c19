"""Independent check of contact forces with friction: the same modes, with rows and accelerations from other functions.

Accelerations come from the support functions of the geoms (:mod:`ffsm_mj.contact.second_rate`), Jacobians from those of
impacts. The modes are those of the replay, except that a point slides where its velocity says so. The forces of redundant
points are those of equal springs, by a singular value decomposition.

The forces found in these modes must satisfy Coulomb's conditions: no normal force pulls, those of sticking points are inside
their cones, friction of sliding points opposes their slip, and no gap of a point without force closes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact.second_rate import SecondRate
from ffsm_mj.contact_models.impact.contact import Contact, LimitContact, contact_rows
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.closure import held_rate_tolerance
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.cone_depth import depth
from ffsm_mj.contact_models.persistent.friction.cone_shares import least_in_cones
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision
from ffsm_mj.contact_models.persistent.friction.point_modes import Mode, unit_slips
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import RANK, SAME_POINT_M

_SLIPS_M_S = 1e-6
"""Slip above this has a direction of its own; below, points may keep that of an earlier state until they stop."""
_ROUNDINGS = 10.0
"""A gap closes, or a force pulls, where it accelerates the gap by more than its rounding times this; a slip has a direction
of its own where it differs from that of the replay by more than the rounding of slips times this."""
_FIRST = np.array((1.0, 0.0, 0.0))


class PointAgain(NamedTuple):
    """A closed point of a pair, found by other functions."""

    pair: UnilateralConstraint
    near: Proximity
    point: FloatArray
    rate: SecondRate


def resultants_with_friction(
    closed: ActiveContactSet,
    points: Sequence[PointAgain],
    contacts: Sequence[Contact | LimitContact],
    motion: Motion,
    data: Any,
    M: FloatArray,
) -> tuple[dict[UnilateralConstraint, FloatArray], float]:
    """Resultant force on geom b of each pair, N; the first component for a joint limit, N or N m.

    The second value is the largest violation of Coulomb's conditions by the forces of single points, N.

    Args:
        closed: The closed contacts of the replay, with their modes.
        points: Closed points.
        contacts: The same in the coordinates of the motion.
        motion: The motion, with accelerations without contact forces in its data, or in a copy.
        data: Its data or the copy.
        M: Its mass matrix.
    """
    axes = [_axes(each) for each in points]
    J = np.stack([contact_rows(motion.model, data, contact, each[1:]) for contact, each in zip(contacts, axes, strict=True)])
    b = np.array(
        [(each.rate.value, *(across[1:] @ each.rate.acceleration)) for each, across in zip(points, axes, strict=True)]
    )
    u, mu = J @ data.qvel, np.array([each.pair.mu for each in points])
    kinds, rounding = _modes(closed, points, u)
    A = np.linalg.solve(np.linalg.cholesky(M), motion.constrained(J.reshape(-1, J.shape[2])).T).T
    forces = _in_cones(A, _forces(A, b.ravel(), *_held(closed, points, axes, u, kinds)), mu, kinds)
    rates = (b.ravel() + A @ (A.T @ forces.ravel()))[::3]
    violation = _violation(forces, mu, kinds, rates, np.sum(A[::3] ** 2, axis=1), rounding)
    found: dict[UnilateralConstraint, FloatArray] = {}
    for each, across, force in zip(points, axes, forces, strict=True):
        vector = force[0] * _FIRST if isinstance(each.pair, JointLimit) else force @ across
        found[each.pair] = found.get(each.pair, np.zeros(3)) + vector
    return found, violation


def _axes(each: PointAgain) -> FloatArray:
    """Normal and tangents of a point, (3, 3); zero tangents without friction."""
    across = tangents(each.near.normal) if each.pair.mu > 0.0 else np.zeros((2, 3))
    return np.vstack((each.near.normal, across))


def _modes(closed: ActiveContactSet, points: Sequence[PointAgain], u: FloatArray) -> tuple[IntArray, float]:
    """Modes of the points, (k,), and the rounding of their accelerations, m/s^2.

    Velocities of points that stick in the replay may drift like the gap rates of closed pairs; faster ones slide.
    """
    decision = closed.decide()
    assert isinstance(decision, FrictionalDecision)
    replayed = dict(zip(decision.contact_points, decision.kinds.tolist(), strict=True))
    kinds = np.full(len(points), Mode.CLOSED, dtype=np.int64)
    for i, each in enumerate(points):
        contact = _same_point(closed, each)
        kinds[i] = replayed[contact] if contact is not None else Mode.CLOSED
        if kinds[i] == Mode.STICK and math.hypot(*u[i, 1:].tolist()) > held_rate_tolerance(each.near):
            kinds[i] = Mode.SLIDE
    return kinds, _ROUNDINGS * float(decision.rounding.max(initial=0.0))


def _forces(A: FloatArray, b: FloatArray, held: Sequence[int], along: FloatArray) -> FloatArray:
    """Forces (n, t1, t2) of equal springs that hold some rows, N, (k, 3).

    Args:
        A: Rows J L^-T, (3k, nv).
        b: Accelerations without contact forces, m/s^2, (3k,).
        held: Indices of the rows held.
        along: Directions along which their forces act, (3k, rows held).
    """
    if not len(held):
        return np.zeros((len(b) // 3, 3))
    U, sizes, _ = np.linalg.svd(A[held], full_matrices=False)
    U = U[:, sizes > math.sqrt(RANK) * sizes[0]]
    system = U.T @ A[held] @ (along.T @ A).T @ U
    shares = U @ np.linalg.lstsq(system, -U.T @ b[held], rcond=None)[0]
    return np.asarray(along @ shares).reshape(-1, 3)


def _in_cones(A: FloatArray, forces: FloatArray, mu: FloatArray, kinds: IntArray) -> FloatArray:
    """Forces with the shares of sticking points inside their cones, if others of the same effect are, (k, 3)."""
    sticks = np.flatnonzero(kinds == Mode.STICK)
    if not len(sticks) or depth(forces[sticks], mu[sticks]) >= 0.0:
        return forces
    rows = A.reshape(len(forces), 3, -1)[sticks].reshape(3 * len(sticks), -1)
    U, sizes, _ = np.linalg.svd(rows)
    free = U[:, int(np.count_nonzero(sizes > math.sqrt(RANK) * sizes[0])) :]
    if not free.shape[1]:
        return forces
    shared = forces.copy()
    shared[sticks] = least_in_cones(forces[sticks], free, mu[sticks])
    return shared


def _violation(
    forces: FloatArray, mu: FloatArray, kinds: IntArray, rates: FloatArray, inverse_mass: FloatArray, rounding: float
) -> float:
    """Largest violation of the inequalities, as a force in N.

    Args:
        forces: Forces (n, t1, t2), N, (k, 3).
        mu: Coefficients of friction, (k,).
        kinds: Modes, (k,).
        rates: Second rates of the gaps, m/s^2, (k,).
        inverse_mass: Inverse mass along each normal, 1/kg, (k,).
        rounding: Rounding of the rates, m/s^2.
    """
    sticks, moves = kinds == Mode.STICK, inverse_mass > 0.0
    outside = -depth(forces[sticks], mu[sticks]) if sticks.any() else 0.0
    # Normal forces that pull, and gaps that close.
    negative = np.where(kinds == Mode.CLOSED, rates, forces[:, 0] * inverse_mass)[moves]
    normal = np.maximum(-negative - rounding, 0.0) / inverse_mass[moves]
    return max(outside, float(normal.max(initial=0.0)), 0.0)


def _held(
    closed: ActiveContactSet, points: Sequence[PointAgain], axes: Sequence[FloatArray], u: FloatArray, kinds: IntArray
) -> tuple[list[int], FloatArray]:
    """Indices of the rows held in some modes, and the directions along which their forces act, (3k, rows)."""
    decision = closed.decide()
    assert isinstance(decision, FrictionalDecision)
    replayed = zip(decision.directions, decision.rows.speed_rounding.tolist(), strict=True)
    known = dict(zip(decision.contact_points, replayed, strict=True))
    held: list[int] = []
    columns: list[FloatArray] = []
    for i, (each, across) in enumerate(zip(points, axes, strict=True)):
        contact, kind = _same_point(closed, each), int(kinds[i])
        if kind in (Mode.SLIDE, Mode.STICK):
            column = np.zeros(3 * len(points))
            column[3 * i] = 1.0
            if kind == Mode.SLIDE and each.pair.mu > 0.0:
                assert contact is not None
                direction, rounding = known[contact]
                along = _direction(u[i, 1:], across[1:] @ direction, rounding)
                column[3 * i + 1 : 3 * i + 3] = -each.pair.mu * along
            held.append(3 * i)
            columns.append(column)
        if kind == Mode.STICK:
            for row in (3 * i + 1, 3 * i + 2):
                held.append(row)
                columns.append(np.eye(1, 3 * len(points), row)[0])
    return held, np.array(columns).reshape(-1, 3 * len(points)).T


def _direction(u: FloatArray, replayed: FloatArray, rounding: float) -> FloatArray:
    """Direction of slip along the tangents: that of the slip, or of the replay where the slip says nothing else.

    Friction turns by the rounding of a slip over the slip: by 1e-7 rad at 2e-5 m/s, which is more than forces may differ.
    """
    speed, (own, unit) = math.hypot(*u.tolist()), unit_slips(np.array((u, replayed)))
    # A point that sticks in the replay has no direction there.
    says_else = speed > _SLIPS_M_S and speed * math.dist(own, unit) > _ROUNDINGS * rounding
    return np.asarray(own if says_else or not unit.any() else unit)


def _same_point(closed: ActiveContactSet, each: PointAgain) -> ContactPoint | None:
    """The contact point of the replay at the place of a point."""
    for contact in closed.by_pair.get(each.pair, ()):
        if isinstance(each.pair, JointLimit) or math.dist(contact.feature.at(closed.data).point, each.point) <= SAME_POINT_M:
            return contact
    return None
