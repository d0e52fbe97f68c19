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
    """Whether any joint or tendon has a spring or a damper; cheaper than their coefficients."""
    arrays = (
        *(model.jnt_stiffness, model.dof_damping, model.jnt_stiffnesspoly, model.dof_dampingpoly),
        *(model.tendon_stiffness, model.tendon_damping, model.tendon_stiffnesspoly, model.tendon_dampingpoly),
    )
    return any(array.any() for array in arrays)


def sign_preserving(damping: FloatArray) -> bool:
    """Whether a damper with coefficients (a, b, c) takes energy at every rate, by MuJoCo's condition."""
    a, b, c = damping.tolist()
    return not (a < 0.0 or c < 0.0 or (b < 0.0 and b * b > 4.0 * a * c))


def tendon_stiffness_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the spring of each tendon, (ntendon, 3)."""
    return np.column_stack((model.tendon_stiffness, model.tendon_stiffnesspoly))


def tendon_damping_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the damper of each tendon, (ntendon, 3)."""
    return np.column_stack((model.tendon_damping, model.tendon_dampingpoly))
