"""Coefficients of the springs and dampers of the joints of a compiled model, which MuJoCo stores in two arrays each."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray


def stiffness_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the spring of each joint, (njnt, 3)."""
    return np.column_stack((model.jnt_stiffness, model.jnt_stiffnesspoly.reshape(model.njnt, -1)))


def damping_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the damper of each degree of freedom, (nv, 3)."""
    return np.column_stack((model.dof_damping, model.dof_dampingpoly.reshape(model.nv, -1)))


def has_springs_or_dampers(model: Any) -> bool:
    """Whether any joint has a spring or a damper; cheaper than their coefficients."""
    return bool(
        model.jnt_stiffness.any() or model.dof_damping.any() or model.jnt_stiffnesspoly.any() or model.dof_dampingpoly.any()
    )
