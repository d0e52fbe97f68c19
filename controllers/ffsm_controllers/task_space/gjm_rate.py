"""Resolved motion rate by the generalised Jacobian.

The rates of the joints are to be qd_c = alpha^# (v_c - v_h), v_c = yd_d - k e with its length bounded as a whole; a servo
brings them there: u = M_c k_v (qd_c - qd) + c_c. v_h is what the momentum gives the tip: without it an error of |v_h|/k
would stay wherever the robot has momentum. alpha^# = alpha^T (alpha alpha^T)^-1, the inverse damped near singularities as
in :func:`~ffsm_controllers.task_space.singularity.damped_inverse`: exact where all singular values of alpha are above a
bound, and towards zero for one that vanishes. The tip lags behind v_c by 1/k_v.

Source: Umetani & Yoshida 1989, Resolved motion rate control of space manipulators with generalized Jacobian matrix, IEEE
Trans. Robot. Autom. 5(3), with the momentum.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from pydantic import PositiveFloat

from ffsm_controllers.task_space.config import AttitudeTarget, TaskLawConfig
from ffsm_controllers.task_space.task_law import TaskLaw
from ffsm_mj.controller_protocol import ControllerContext, Damping, FloatArray, StrictModel


class PositionRates(StrictModel):
    """Velocity that a distance asks for."""

    k_1_s: PositiveFloat
    """Velocity per distance, 1/s."""
    max_speed_m_s: PositiveFloat | None = None
    """Speed that a distance asks for at most, m/s; left out: no bound."""


class AttitudeRates(AttitudeTarget):
    """Angular velocity that an angle asks for."""

    k_1_s: PositiveFloat
    """Angular velocity per angle, 1/s."""
    max_rate_rad_s: PositiveFloat | None = None
    """Angular speed that an angle asks for at most, rad/s; left out: no bound."""


class GjmRateConfig(TaskLawConfig):
    """Resolved motion rate by the generalised Jacobian."""

    kind: Literal["gjm_rate"]
    position: PositionRates
    """Gain of the position."""
    attitude: AttitudeRates | None = None
    """Gain of the attitude; left out: it is not controlled."""
    servo_gain_1_s: PositiveFloat
    """Gain k_v of the servo that holds the joints to their rates, 1/s; some ten times the other gains."""
    least_singular_value: PositiveFloat = 0.1
    """Singular value of the generalised Jacobian, m/s (of turns rad/s) per rad/s of the joints, below which a direction is
    near a singularity: the rates for it fade out."""


class GjmRate(TaskLaw):
    """Resolved motion rate."""

    Config = GjmRateConfig

    def __init__(self, config: GjmRateConfig, context: ControllerContext) -> None:
        """Resolve joints and gains.

        Raises:
            ScenarioFaults: No task, an unknown joint, or fewer joints than components of the output.
        """
        super().__init__(config, context, config.attitude, inverts=True)
        self._position, self._turns, self._servo = config.position, config.attitude, config.servo_gain_1_s
        self._largest = config.least_singular_value**-2
        self.watch(self._largest, _of_singular_value)

    def effort(self, data: Any) -> FloatArray:  # noqa: ARG002
        """U of the law, (n,)."""
        model, k = self.model, self.positions
        rates = model.target_rates - model.v_h
        rates[:k] += _bounded(-self._position.k_1_s * model.e[:k], self._position.max_speed_m_s)
        if self._turns is not None:
            rates[k:] += _bounded(-self._turns.k_1_s * model.e[k:], self._turns.max_rate_rad_s)
        inverse = self.damped(model.alpha.dot(model.alpha.T), self._largest)
        commanded = inverse.dot(rates).dot(model.alpha)
        return np.asarray(model.M_c.dot(self._servo * (commanded - model.qd)) + model.c_c)

    def damping_at(self, data: Any) -> Damping:
        """That of the servo."""
        model = self.model
        model.update(data)
        dofs = model.joints.dofs
        return Damping("servo_gain_1_s", dofs, np.full(len(dofs), self._servo), self._servo * model.M_c)


def _bounded(vector: FloatArray, most: float | None) -> FloatArray:
    """A vector, shortened to a length if it is longer."""
    length = math.hypot(*vector.tolist())
    return vector * (most / length) if most is not None and length > most else vector


def _of_singular_value(least: float, largest: float) -> str:
    value, bound = math.sqrt(max(least, 0.0)), largest**-0.5
    return f"singular value of the generalised Jacobian down to {value:.3g} (least_singular_value {bound:g})"
