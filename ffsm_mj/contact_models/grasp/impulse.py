"""Plastic impulse that joins two bodies at their current pose: it stops the relative motions that a latch does not permit.

With the rows J of these components of the relative twist at one point of both bodies, u = J qdot, the impulse on the second
is lambda = -(J M^-1 J^T)^+ u and qdot+ = qdot + M^-1 J^T lambda. In mass-weighted velocities w = L^T qdot, M = L L^T, this
removes the component of w in the row space of A = J L^-T, so the energy loss is half the square of that component. Joints
that allow fewer relative motions than the latch stops, such as planar ones, make the rows dependent: an SVD determines
their rank.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.mass_weighted import MassWeightedRows, PlasticClosing
from ffsm_mj.dynamics.rigid_body import mass_matrix


def relative_twist_rows(model: Any, data: Any, first: int, second: int, point: FloatArray) -> FloatArray:
    """Jacobian of the relative twist of two bodies at a common point, (6, nv)."""
    of_first, of_second = np.empty((6, model.nv)), np.empty((6, model.nv))
    for rows, body in ((of_first, first), (of_second, second)):
        mujoco.mj_jac(model, data, rows[:3], rows[3:], point, body)
    return of_second - of_first


def plastic_impulse(
    model: Any, data: Any, first: int, second: int, point: FloatArray, stopped: FloatArray | None = None
) -> PlasticClosing:
    """Compute the impulse that joins two bodies at the state in ``data``, which is not changed.

    Its ``impulses`` are the impulse on the second body in N s and its moment about the point in N m s, world axes, (6,).

    Args:
        model: MuJoCo model.
        data: Its data, positions and velocities current.
        first: Id of one body.
        second: Id of the other.
        point: Point of application, world axes, m, (3,).
        stopped: Orthonormal components of the relative twist that are stopped, (n, 6); None: all six.
    """
    J = relative_twist_rows(model, data, first, second, point)
    found = MassWeightedRows(mass_matrix(model, data), J if stopped is None else stopped @ J).plastic(data.qvel)
    return found if stopped is None else replace(found, impulses=found.impulses @ stopped)
