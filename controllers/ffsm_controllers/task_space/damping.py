"""The damping of laws on a task's output, for the check of gains against the control period."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ffsm_mj.controller_protocol import Damping, FloatArray
from ffsm_mj.task_model import TaskModel


def output_damping(model: TaskModel, pushes: FloatArray, key: str, gain: float, rows: slice) -> Damping:
    """Damping of some rows of the output.

    Args:
        model: The task model, current.
        pushes: Efforts per rate of each row of the output, (n, p).
        key: What the gain is called.
        gain: Its value, for messages.
        rows: Rows of the output that it is for.
    """
    dofs = model.joints.dofs
    return Damping(key, dofs, np.full(len(dofs), gain), pushes[:, rows].dot(model.alpha[rows]))


def joint_damping(model: TaskModel, gain: float, unseen: FloatArray) -> Damping:
    """Damping of motions of the joints, ``unseen`` being what is left of efforts at them, (n, n)."""
    dofs = model.joints.dofs
    return Damping("joint_damping_N_m_s_rad", dofs, np.full(len(dofs), gain), gain * unseen)


def most_unstable(model: TaskModel, dampings: Iterable[Damping]) -> Damping:
    """The damping that is first to be unstable as the control period grows."""
    return max(dampings, key=lambda damping: np.linalg.eigvals(np.linalg.solve(model.M_c, damping.matrix)).real.max())
