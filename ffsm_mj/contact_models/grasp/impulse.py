"""The plastic impulse that joins two bodies at the pose they have: no relative twist is left.

With the rows J of the relative twist at one point of both bodies, u = J qdot, the impulse on the second is
lambda = -(J M^-1 J^T)^+ u and qdot+ = qdot + M^-1 J^T lambda. In mass-weighted velocities w = L^T qdot, M = L L^T, that
takes away the part of w in the row space of A = J L^-T, so that the loss is half the square of what is taken away. Joints
that leave less than six relative motions, as those of a plane do, make rows dependent: they are solved with their rank.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix

RANK = 1e-10
"""Singular values below this share of the largest are none."""


@dataclass(frozen=True)
class PlasticImpulse:
    """What joins two bodies.

    Attributes:
        impulse: On the second body: force part in N s, moment about the point in N m s, world axes, of least norm, (6,).
        change: Of the generalised velocity, (nv,).
        loss_J: Kinetic energy that is lost.
        rank: Number of relative motions that the joints left.
        twist: Of the second body against the first at the point, before: linear in m/s, angular in rad/s, (6,).
    """

    impulse: FloatArray
    change: FloatArray
    loss_J: float
    rank: int
    twist: FloatArray


def relative_twist_rows(model: Any, data: Any, first: int, second: int, point: FloatArray) -> FloatArray:
    """Rate of the second body's twist against the first's at one point of both by generalised velocity, (6, nv)."""
    of_first, of_second = np.empty((6, model.nv)), np.empty((6, model.nv))
    for rows, body in ((of_first, first), (of_second, second)):
        mujoco.mj_jac(model, data, rows[:3], rows[3:], point, body)
    return of_second - of_first


def plastic_impulse(model: Any, data: Any, first: int, second: int, point: FloatArray) -> PlasticImpulse:
    """What joins two bodies at the state in ``data``, which stays as it is.

    Args:
        model: MuJoCo model.
        data: Its data, positions and velocities current.
        first: Id of one body.
        second: Id of the other.
        point: Where the impulse acts on both, world axes, m, (3,).
    """
    J = relative_twist_rows(model, data, first, second, point)
    L = np.linalg.cholesky(mass_matrix(model, data))
    A = np.linalg.solve(L, J.T).T
    left, sizes, right = np.linalg.svd(A, full_matrices=False)
    rank = int(np.count_nonzero(sizes > RANK * sizes[0]))
    left, sizes, right = left[:, :rank], sizes[:rank], right[:rank]
    twist = J @ data.qvel
    taken = (left.T @ twist) / sizes  # of the mass-weighted velocity, along the rows of ``right``
    return PlasticImpulse(
        impulse=-left @ (taken / sizes),
        change=-np.linalg.solve(L.T, right.T @ taken),
        loss_J=0.5 * float(taken @ taken),
        rank=rank,
        twist=twist,
    )
