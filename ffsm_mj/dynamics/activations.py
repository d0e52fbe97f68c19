"""Activations of actuators in the stages of a step: filters and integrators as functions of the time, others by quadrature.

The activation w of a filter with the time constant tau is u + (w_0 - u) exp(-t / tau) while its control u is constant,
that of an integrator w_0 + u t within its range, and a setpoint of limited rate moves to u as fast as it may. Those of
muscles, motors and controllers with an integral are further components of the state, with the rates that MuJoCo gives them.
MuJoCo's own RK4 is of order one in most of these.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.motor_kinks import MotorKinks
from ffsm_mj.model.actuators import INTEGRAL_LIMIT, SLEW_RATE, controllers_of

_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_FULL = 1.0 - 1e-9
"""An integral this close to its limit, relative to it, is at the limit."""


class Activations:
    """Activations of a model in the stages of a step.

    Attributes:
        kink_s: Time from the start of the step at which an integrator reaches the end of its range, or a setpoint its
            target, s; infinite without.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data, self.kink_s = model, data, math.inf
        single = np.flatnonzero(model.actuator_actnum == 1)
        kinds = model.actuator_dyntype[single]
        filters, integrators = single[np.isin(kinds, _FILTERS)], single[kinds == _INTEGRATOR]
        self._filters, self._filter_controls = model.actuator_actadr[filters], model.actuator_ctrladr[filters]
        self._taus = np.maximum(model.actuator_dynprm[filters, 0], float(mujoco.mjMINVAL))
        self._integrals, self._integral_limits, slewing, setpoints = _controllers(model)
        # Both are ramps: an integrator at the rate of its control, a setpoint at its own.
        ramps = np.concatenate((integrators, slewing))
        self._ramps, self._ramp_controls = model.actuator_actadr[ramps], model.actuator_ctrladr[ramps]
        self._ramps[len(integrators) :], self._slews = setpoints, slice(len(integrators), None)
        self._slew_rates = model.actuator_gainprm[slewing, SLEW_RATE]
        limited = model.actuator_actlimited[ramps].astype(bool)
        self._low, self._high = np.where(limited[:, None], model.actuator_actrange[ramps], [-np.inf, np.inf]).T
        self._start, self._full = np.array(data.act), self._integrals[:0]
        self._sum, self._last = np.zeros(model.na), np.zeros(model.na)
        self._nodes = np.zeros((0, model.na))
        self._kinks, self._values = MotorKinks(model, data), np.zeros(0)

    def __bool__(self) -> bool:
        """Whether there is anything to do in the stages, or a kink to be found."""
        return bool(len(self._start)) or bool(self._kinks)

    def begin(self, duration_s: float, nodes: int = 0) -> None:
        """Begin a step at the state in the data, forces current; with the number of nodes if it is implicit."""
        model, data = self._model, self._data
        limited = model.actuator_ctrllimited.astype(bool)
        controls = np.where(limited, np.clip(data.ctrl, *model.actuator_ctrlrange.T), data.ctrl)
        self._targets, self._slopes = controls[self._filter_controls], controls[self._ramp_controls]
        self._start[:] = data.act
        starts, slews = self._start[self._ramps], self._slews
        targets = self._slopes[slews].copy()
        self._slopes[slews] = self._slew_rates * np.sign(targets - starts[slews])
        self._low[slews], self._high[slews] = np.minimum(starts[slews], targets), np.maximum(starts[slews], targets)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (np.where(self._slopes > 0.0, self._high, self._low) - starts) / self._slopes
        inside = reach[(reach > 0.0) & (reach < duration_s)]
        self.kink_s = float(inside.min(initial=math.inf))
        integrals, errors = self._start[self._integrals], data.act_dot[self._integrals]
        self._full = self._integrals[(np.abs(integrals) >= _FULL * self._integral_limits) & (errors * integrals > 0.0)]
        if self._kinks:
            self._values = self._kinks.values()
        self._sum.fill(0.0)
        self._nodes = np.tile(self._stopped(data.act_dot), (nodes, 1))

    def is_kinked(self, duration_s: float) -> bool:
        """Whether the step of a duration that ends at the state in the data, forces current, has a kink inside."""
        if self.kink_s < duration_s:
            return True
        if not self._kinks:
            return False
        beyond = np.abs(self._values) > self._kinks.rounding
        return bool((beyond & (self._values * self._kinks.values() < 0.0)).any())

    def _stopped(self, rates: FloatArray) -> FloatArray:
        """Rates of activations in this step: an integral at its limit stays there, (na,)."""
        rates = rates.copy()
        rates[self._full] = 0.0
        return rates

    def move_to(self, after_s: float, others: FloatArray | None = None) -> None:
        """Set the activations at a stage.

        Args:
            after_s: Time since the start of the step, s.
            others: Increments of those without a closed form, (na,); None: by their rates at the last stage.
        """
        act = self._data.act
        act[:] = self._start + (after_s * self._last if others is None else others)
        decay = np.exp(-after_s / self._taus)
        act[self._filters] = self._targets + (self._start[self._filters] - self._targets) * decay
        act[self._ramps] = np.clip(self._start[self._ramps] + after_s * self._slopes, self._low, self._high)

    def add(self, weight: float) -> None:
        """Add the rates of a stage with its weight."""
        self._last[:] = self._stopped(self._data.act_dot)
        self._sum += weight * self._last

    def end(self, duration_s: float) -> None:
        """Set the activations at the end of an explicit step."""
        self.move_to(duration_s, duration_s * self._sum)

    def move_to_node(self, after_s: float, weights: FloatArray) -> None:
        """Set the activations at a node of an implicit step, with the weights of the nodes' rates in it, s."""
        self.move_to(after_s, weights @ self._nodes)

    def set_node(self, node: int) -> float:
        """Store the rates at a node; returns by how much they have changed."""
        rates = self._stopped(self._data.act_dot)
        change = float(np.abs(rates - self._nodes[node]).max(initial=0.0))
        self._nodes[node] = rates
        return change


def _controllers(model: Any) -> tuple[IntArray, FloatArray, IntArray, IntArray]:
    """Addresses of the integrals of controllers and their limits, infinite without; actuators and addresses of setpoints."""
    both = [controllers_of(model, kind) for kind in (mujoco.mjtGain.mjGAIN_PID, mujoco.mjtGain.mjGAIN_DCMOTOR)]
    ids, slews, integrals = (np.concatenate(parts) for parts in zip(*both, strict=True))
    limits = model.actuator_gainprm[ids, INTEGRAL_LIMIT]
    limits = np.where(limits > 0.0, limits, np.inf)
    return integrals[integrals >= 0], limits[integrals >= 0], ids[slews >= 0], slews[slews >= 0]
