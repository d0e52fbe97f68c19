"""Integrals over a step: Simpson's rule, and the state at the middle of the step that it needs."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import cross, rotation_dofs


def simpson(start: FloatArray, middle: FloatArray, end: FloatArray, duration_s: float) -> FloatArray:
    """Integral of a rate over a step, in units of the rate times s.

    Args:
        start: Rate at the start.
        middle: Rate at the middle, at the state of :func:`hermite_midpoint`.
        end: Rate at the end.
        duration_s: Length of the step.
    """
    return duration_s / 6.0 * (start + 4.0 * middle + end)


def hermite_midpoint(
    model: Any, qpos_0: FloatArray, qvel_0: FloatArray, qpos_1: FloatArray, qvel_1: FloatArray, duration_s: float
) -> tuple[FloatArray, FloatArray]:
    """State at the middle of a step, by cubic Hermite interpolation on the configuration manifold.

    Returns:
        (qpos, qvel) at the middle; the configuration is fourth-order accurate in the duration, the velocity third.
    """
    rotations = rotation_dofs(model)
    chord = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, chord, duration_s, qpos_0, qpos_1)
    end = qvel_1.copy()
    # The chord of a rotation is a rotation vector; its rate at the end is the inverse right Jacobian times omega.
    for part in rotations:
        theta, omega = chord[part] * duration_s, qvel_1[part]
        turn = cross(theta, omega)
        end[part] = omega + 0.5 * turn + cross(theta, turn) / 12.0
    half = 0.5 * chord + 0.125 * (qvel_0 - end)
    qpos = qpos_0.copy()
    mujoco.mj_integratePos(model, qpos, half, duration_s)
    qvel = 1.5 * chord - 0.25 * (qvel_0 + end)
    for part in rotations:
        theta, rate = half[part] * duration_s, qvel[part]
        turn = cross(theta, rate)
        qvel[part] = rate - 0.5 * turn + cross(theta, turn) / 6.0
    return qpos, qvel
