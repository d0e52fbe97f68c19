"""Limits of the forces of actuators: the instant in a step at which a force reaches its limit, or leaves it.

A force within its limits is a smooth function of the state, and at them it has a kink, which a step of order four must not
contain: the step ends there. The functions whose roots are sought are the forces without limits less these.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motor_kinks import MotorKinks
from ffsm_mj.dynamics.step_path import StepPath
from ffsm_mj.model.actuators import servo_mask, without_force_limits, without_joint_limits
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S

_AT_LIMIT = 1e-9
"""A force this close to a limit, relative to it, is at the limit: a step that begins there has passed the kink."""


class ForceLimits:
    """Limits of the servos of a model, and of the joints and tendons that they act on.

    Attributes:
        servos: Servos with a ``forcerange``, (n,).
        dofs: Degrees of freedom with an ``actuatorfrcrange``, (m,).
        ranges: Least and greatest force of each of them, (n, 2).
        dof_ranges: The same of the degrees of freedom, (m, 2).
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data = model, data
        self.servos = np.flatnonzero(servo_mask(model) & model.actuator_forcelimited.astype(bool))
        limited = model.jnt_actfrclimited.astype(bool)
        self.dofs = np.array(model.jnt_dofadr[limited], dtype=np.intp)
        self.ranges = np.ascontiguousarray(model.actuator_forcerange[self.servos], dtype=np.float64)
        self.dof_ranges = np.ascontiguousarray(model.jnt_actfrcrange[limited], dtype=np.float64)
        self._unlimited, self._without_joints = without_force_limits(model), without_joint_limits(model)
        sizes = np.concatenate((np.abs(self.ranges), np.abs(self.dof_ranges)))
        self._motors = MotorKinks(model, data)
        rounding = _AT_LIMIT * np.repeat(sizes.max(axis=1, initial=0.0), 2)
        self._rounding = np.concatenate((rounding, self._motors.rounding))

    def _margins(self) -> FloatArray:
        """Forces without limits less their least and greatest values, and the functions of :class:`MotorKinks`."""
        data = self._data
        mujoco.mj_fwdActuation(self._unlimited, data)
        forces = data.actuator_force[self.servos]
        mujoco.mj_fwdActuation(self._without_joints, data)
        totals = data.qfrc_actuator[self.dofs]
        mujoco.mj_fwdActuation(self._model, data)
        of_dofs = (totals[:, None] - self.dof_ranges).ravel()
        return np.concatenate(((forces[:, None] - self.ranges).ravel(), of_dofs, self._motors.values()))

    def first_kink(self, path: StepPath, duration_s: float) -> float | None:
        """Time in a step of the first kink of a force, or None; the path is left at its start.

        Args:
            path: The step.
            duration_s: How much of it, s.
        """
        from scipy.optimize import brentq  # takes a second to import: only runs with kinks pay

        path.move_to(duration_s)
        end = self._margins()
        path.move_to(0.0)
        start, until_s = self._margins(), duration_s

        def margin(time_s: float, which: int) -> float:
            path.move_to(time_s)
            return float(self._margins()[which])

        for i in np.flatnonzero((start * end < 0.0) & (np.abs(start) > self._rounding)).tolist():
            if margin(until_s, i) * start[i] < 0.0:
                until_s = float(brentq(margin, 0.0, until_s, args=(i,), xtol=EVENT_TIME_S, rtol=EVENT_TIME))
        path.move_to(0.0)
        return until_s if until_s < duration_s else None
