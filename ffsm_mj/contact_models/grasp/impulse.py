"""Plastic impulse that joins two bodies at their current pose: it stops the relative motions that a latch does not permit.

With the rows J of these components of the relative twist at one point of both bodies, u = J qdot, the impulse on the second
is lambda = -(J M^-1 J^T)^+ u and qdot+ = qdot + M^-1 J^T lambda. In mass-weighted velocities w = L^T qdot, M = L L^T, this
removes the component of w in the row space of A = J L^-T, so the energy loss is half the square of that component. Joints
that allow fewer relative motions than the latch stops, such as planar ones, make the rows dependent: an SVD determines
their rank.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.tolerances import RANK


@dataclass(frozen=True)
class PlasticImpulse:
    """Plastic impulse between two bodies.

    Attributes:
        impulse: Impulse on the second body in N s, and its moment about the point in N m s, world axes, least norm, (6,).
        change: Change of the generalised velocity, (nv,).
        loss_J: Kinetic energy lost.
        rank: Number of relative motions that the joints allow and the latch stops.
        least_ratio: Smallest singular value that counts over the largest, of the rows in mass-weighted velocities.
    """

    impulse: FloatArray
    change: FloatArray
    loss_J: float
    rank: int
    least_ratio: float


def relative_twist_rows(model: Any, data: Any, first: int, second: int, point: FloatArray) -> FloatArray:
    """Jacobian of the relative twist of two bodies at a common point, (6, nv)."""
    of_first, of_second = np.empty((6, model.nv)), np.empty((6, model.nv))
    for rows, body in ((of_first, first), (of_second, second)):
        mujoco.mj_jac(model, data, rows[:3], rows[3:], point, body)
    return of_second - of_first


def plastic_impulse(
    model: Any, data: Any, first: int, second: int, point: FloatArray, stopped: FloatArray | None = None
) -> PlasticImpulse:
    """Compute the impulse that joins two bodies at the state in ``data``, which is not changed.

    Args:
        model: MuJoCo model.
        data: Its data, positions and velocities current.
        first: Id of one body.
        second: Id of the other.
        point: Point of application, world axes, m, (3,).
        stopped: Orthonormal components of the relative twist that are stopped, (n, 6); None: all six.
    """
    J = relative_twist_rows(model, data, first, second, point)
    if stopped is not None:
        J = stopped @ J
    L = np.linalg.cholesky(mass_matrix(model, data))
    A = np.linalg.solve(L, J.T).T
    left, sizes, right = np.linalg.svd(A, full_matrices=False)
    rank = int(np.count_nonzero(sizes > RANK * sizes[0]))
    left, sizes, right = left[:, :rank], sizes[:rank], right[:rank]
    taken = (left.T @ (J @ data.qvel)) / sizes  # of the mass-weighted velocity, along the rows of ``right``
    impulse = -left @ (taken / sizes)
    return PlasticImpulse(
        impulse=impulse if stopped is None else impulse @ stopped,
        change=-np.linalg.solve(L.T, right.T @ taken),
        loss_J=0.5 * float(taken @ taken),
        rank=rank,
        least_ratio=float(sizes[-1] / sizes[0]) if rank else 1.0,
    )
