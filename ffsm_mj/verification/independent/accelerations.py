"""Accelerations at a logged state, and the loads of closed grasps that go with them: equations of motion with multipliers.

With mass matrix M, all known forces f, rows J of what the closed grasps stop and the drift d of these rows, M a = f + J^T l
and J a = d. A run integrates another model instead, in which the first grasped object is a part of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ffsm_mj.tolerances import RANK
from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.scene import Latched, LoggedScene

_CLOSED_WITH_FORCE = 2.0
"""Magnitude of the state of a contact rule, or of the limits of a joint, from which on it may exert a force."""


def forces_known(scene: LoggedScene) -> bool:
    """Whether all forces but those of contacts, limits and grasps are known from models and efforts."""
    model = scene.model
    rubs = np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss)
    return not scene.scenario.get("contact_models") and model.neq == 0 and not rubs


def is_out_of_contact(scene: LoggedScene, row: Array) -> bool:
    """Whether neither a contact nor a joint limit exerts a force in a row."""
    return bool(np.all(np.abs(scene.contact_states(row)) < _CLOSED_WITH_FORCE))


def accelerate(scene: LoggedScene, closed: Sequence[Latched]) -> None:
    """Write accelerations at the state in the data, and what follows from them, with grasps closed."""
    data = scene.data
    M, force = scene.mass_matrix(), scene.free_force()
    acceleration = np.linalg.solve(M, force)
    if closed:
        J = np.concatenate([scene.latch_rows(grasp) for grasp in closed])
        drift = np.concatenate([scene.latch_drift(g) - scene.latch_rows(g, rates=True) @ data.qvel for g in closed])
        # Rows may depend on each other, as in a plane: the acceleration is unique all the same.
        L = np.linalg.cholesky(M)
        A = np.linalg.solve(L, J.T)
        acceleration += np.linalg.solve(L.T, np.linalg.pinv(A.T, rcond=RANK) @ (drift - J @ acceleration))
    data.qacc[:] = acceleration
    mujoco.mj_rnePostConstraint(scene.model, data)


def load_on(scene: LoggedScene, tree: int, point: Array) -> Array:
    """Force and torque about a point that a tree needs from outside to accelerate as in the data, (6,): N and N m.

    Args:
        scene: The scene, after :func:`accelerate`.
        tree: Root body of the tree.
        point: The point, world axes, m, (3,).
    """
    torque, force = np.split(np.asarray(scene.data.cfrc_int[tree]), 2)
    return np.concatenate((force, torque + np.cross(scene.data.subtree_com[scene.model.body_rootid[tree]] - point, force)))
