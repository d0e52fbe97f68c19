"""Independent check of contact forces with friction: the same modes, with rows and accelerations from other functions.

Accelerations come from the support functions of the geoms (:mod:`ffsm_mj.contact.second_rate`), Jacobians from those of
impacts. The modes are those of the replay. The forces of redundant points are those of equal springs, by a singular value
decomposition.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact.second_rate import SecondRate
from ffsm_mj.contact_models.impact.contact import Contact, LimitContact, contact_rows
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision
from ffsm_mj.contact_models.persistent.friction.modes import Mode
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.tolerances import RANK, SAME_POINT_M

_SLIPS_M_S = 1e-6
"""Slip above this has a direction of its own; below, points may keep that of an earlier state until they stop."""
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
    model: Any,
    data: Any,
    M: FloatArray,
) -> dict[UnilateralConstraint, FloatArray]:
    """Resultant force on geom b of each pair, N; the first component for a joint limit, N or N m.

    Args:
        closed: The closed contacts of the replay, with their modes.
        points: Closed points.
        contacts: The same in the coordinates of the motion.
        model: Model of the motion.
        data: Its data, with accelerations without contact forces.
        M: Its mass matrix.
    """
    axes = [_axes(each) for each in points]
    J = np.stack([contact_rows(model, data, contact, each[1:]) for contact, each in zip(contacts, axes, strict=True)])
    b = np.array(
        [(each.rate.value, *(across[1:] @ each.rate.acceleration)) for each, across in zip(points, axes, strict=True)]
    )
    held, along = _held(closed, points, axes, J @ data.qvel)
    A = np.linalg.solve(np.linalg.cholesky(M), J.reshape(-1, J.shape[2]).T).T
    U, sizes, _ = np.linalg.svd(A[held], full_matrices=False)
    U = U[:, sizes > math.sqrt(RANK) * sizes[0]] if len(held) else U
    forces = np.zeros(A.shape[0])
    if len(held):
        system = U.T @ A[held] @ (along.T @ A).T @ U
        forces = along @ (U @ np.linalg.lstsq(system, -U.T @ b.ravel()[held], rcond=None)[0])
    found: dict[UnilateralConstraint, FloatArray] = {}
    for each, across, force in zip(points, axes, forces.reshape(-1, 3), strict=True):
        vector = force[0] * _FIRST if isinstance(each.pair, JointLimit) else force @ across
        found[each.pair] = found.get(each.pair, np.zeros(3)) + vector
    return found


def _axes(each: PointAgain) -> FloatArray:
    """Normal and tangents of a point, (3, 3); zero tangents without friction."""
    across = tangents(each.near.normal) if each.pair.mu > 0.0 else np.zeros((2, 3))
    return np.vstack((each.near.normal, across))


def _held(
    closed: ActiveContactSet, points: Sequence[PointAgain], axes: Sequence[FloatArray], u: FloatArray
) -> tuple[list[int], FloatArray]:
    """Indices of the rows held in the modes of the replay, and the directions along which their forces act, (3k, rows)."""
    decision = closed.decide()
    assert isinstance(decision, FrictionalDecision)
    kinds = dict(zip(decision.contact_points, decision.kinds.tolist(), strict=True))
    begins = dict(zip(decision.contact_points, decision.directions, strict=True))
    held: list[int] = []
    columns: list[FloatArray] = []
    for i, (each, across) in enumerate(zip(points, axes, strict=True)):
        contact = _same_point(closed, each)
        kind = kinds[contact] if contact is not None else Mode.CLOSED
        if kind in (Mode.SLIDE, Mode.STICK):
            column = np.zeros(3 * len(points))
            column[3 * i] = 1.0
            if kind == Mode.SLIDE and each.pair.mu > 0.0:
                assert contact is not None
                column[3 * i + 1 : 3 * i + 3] = -each.pair.mu * _direction(u[i, 1:], across[1:] @ begins[contact])
            held.append(3 * i)
            columns.append(column)
        if kind == Mode.STICK:
            for row in (3 * i + 1, 3 * i + 2):
                held.append(row)
                columns.append(np.eye(1, 3 * len(points), row)[0])
    return held, np.array(columns).reshape(-1, 3 * len(points)).T


def _direction(u: FloatArray, begins: FloatArray) -> FloatArray:
    """Direction of slip along the tangents: that of the slip, or of the replay where a point only begins to slide."""
    speed = math.hypot(*u.tolist())
    return np.asarray(u / speed if speed > _SLIPS_M_S else begins / math.hypot(*begins.tolist()))


def _same_point(closed: ActiveContactSet, each: PointAgain) -> ContactPoint | None:
    """The contact point of the replay at the place of a point."""
    for contact in closed.by_pair.get(each.pair, ()):
        if isinstance(each.pair, JointLimit) or math.dist(contact.feature.at(closed.data).point, each.point) <= SAME_POINT_M:
            return contact
    return None
