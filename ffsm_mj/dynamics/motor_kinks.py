"""Kinks of controllers and motors: functions of the state whose roots a step of order four must not contain.

A controller stops to integrate its error e beyond a limit of the integral z, until e changes its sign: kinks at |z| at its
limit and at e = 0. Its voltage v = (R / K) tau + K ldot reaches a limit, the rate of the current another one, and the LuGre
friction of a motor has |ldot|, with a kink where the motor reverses.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.actuators import INTEGRAL_LIMIT, controllers_of, without_force_limits
from ffsm_mj.model.inputs import signature_inputs

_DC, _PID = mujoco.mjtGain.mjGAIN_DCMOTOR, mujoco.mjtGain.mjGAIN_PID
_AT_ROOT, _SMALL = 1e-9, 1e-12
"""Values this close to zero are zero: relative to the limit, and of errors and rates in their units."""


class MotorKinks:
    """Functions with a sign change at each kink of the controllers and motors of a model.

    Attributes:
        rounding: Size below which each is zero, (n,).
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data = model, data
        motors, slews, integrals = controllers_of(model, _DC)
        others, _, more = controllers_of(model, _PID)
        both, places = np.concatenate((motors, others)), np.concatenate((integrals, more))
        self._limits = model.actuator_gainprm[both, INTEGRAL_LIMIT]
        limited = (self._limits > 0.0) & (places >= 0)
        self._limits, self._integrals = self._limits[limited], places[limited]
        driven = (model.actuator_gainprm[motors, 7] > 0.0) & (model.actuator_gainprm[motors, 1] > 0.0)
        self._drives = [tuple(row) for row in np.stack((motors, slews, integrals), axis=1)[driven].tolist()]
        self._voltages = model.actuator_gainprm[motors[driven], 7]
        currents = motors[(model.actuator_dynprm[motors, 1] > 0.0) & (model.actuator_dynprm[motors, 0] > 0.0)]
        # The current is the last activation of a motor that has one.
        self._currents = model.actuator_actadr[currents] + model.actuator_actnum[currents] - 1
        self._rates = model.actuator_dynprm[currents, 1]
        self._bristles = motors[model.actuator_biasprm[motors, 3] > 0.0]
        self._unlimited = without_force_limits(model)
        self._unlimited.actuator_dynprm[currents, 1] = 0.0
        ends = np.concatenate((self._limits, np.repeat(self._voltages, 2), np.repeat(self._rates, 2)))
        small = np.full(len(self._limits) + len(self._bristles), _SMALL)
        self.rounding = np.concatenate((_AT_ROOT * ends, small))

    def __bool__(self) -> bool:
        """Whether the model has any."""
        return bool(len(self.rounding))

    def values(self) -> FloatArray:
        """Their values at the state in the data, forces current, (n,)."""
        data = self._data
        voltages, errors = self._drive_voltages(), data.act_dot[self._integrals]
        rates = np.zeros(0)
        if len(self._currents):
            mujoco.mj_fwdActuation(self._unlimited, data)
            rates = data.act_dot[self._currents]
            mujoco.mj_fwdActuation(self._model, data)
        return np.concatenate(
            (
                np.abs(data.act[self._integrals]) - self._limits,
                np.stack((voltages - self._voltages, voltages + self._voltages), axis=1).ravel(),
                np.stack((rates - self._rates, rates + self._rates), axis=1).ravel(),
                errors,
                data.actuator_velocity[self._bristles],
            )
        )

    def _drive_voltages(self) -> FloatArray:
        """Voltages of the controllers of motors without limit, V."""
        model, data, found = self._model, self._data, []
        for i, slew, integral in self._drives:
            resistance, constant, _, _, kp, ki, kd = model.actuator_gainprm[i, :7].tolist()
            inputs, given = dict.fromkeys(("pos", "vel", "ff"), 0.0), signature_inputs(_DC, model.actuator_ctrlspec[i])
            for at, token in enumerate(given, i):
                low, high = model.actuator_ctrlrange[at].tolist()
                inputs[token] = float(data.ctrl[at])
                if model.actuator_ctrllimited[at]:
                    inputs[token] = min(max(inputs[token], low), high)
            if slew >= 0:
                inputs[given[0]] = float(data.act[slew])
            rate = float(data.actuator_velocity[i])
            torque = kd * (inputs["vel"] - rate) + inputs["ff"]
            torque += kp * (inputs["pos"] - float(data.actuator_length[i]))
            torque += ki * float(data.act[integral]) if integral >= 0 else 0.0
            found.append(resistance / constant * torque + constant * rate)
        return np.array(found)
