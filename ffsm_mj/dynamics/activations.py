"""Activations of actuators in the stages of a step: filters and integrators as functions of the time, others by quadrature.

The activation w of a filter with the time constant tau is u + (w_0 - u) exp(-t / tau) while its control u is constant,
that of an integrator w_0 + u t within its range. Those of muscles, motors and controllers with an integral are further
components of the state, with the rates that MuJoCo gives them. MuJoCo's own RK4 is of order one in most of these.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_STEP = 1e-4
"""Step of differences of activations."""


class Activations:
    """Activations of a model in the stages of a step.

    Attributes:
        kink_s: Time from the start of the step at which an integrator reaches the end of its range, s; infinite without.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data, self.kink_s = model, data, math.inf
        single = np.flatnonzero(model.actuator_actnum == 1)
        kinds = model.actuator_dyntype[single]
        filters, integrators = single[np.isin(kinds, _FILTERS)], single[kinds == _INTEGRATOR]
        self._filters, self._filter_controls = model.actuator_actadr[filters], model.actuator_ctrladr[filters]
        self._taus = np.maximum(model.actuator_dynprm[filters, 0], float(mujoco.mjMINVAL))
        self._integrators, self._rates = model.actuator_actadr[integrators], model.actuator_ctrladr[integrators]
        limited = model.actuator_actlimited[integrators].astype(bool)
        self._low, self._high = np.where(limited[:, None], model.actuator_actrange[integrators], [-np.inf, np.inf]).T
        self._start = np.array(data.act)
        self._sum, self._last = np.zeros(model.na), np.zeros(model.na)
        self._nodes = np.zeros((0, model.na))

    def fastest(self) -> float:
        """Largest rate at which an activation decays by itself at the state in the data, 1/s."""
        data, kept, rates = self._data, self._data.act.copy(), []
        for sign in (1.0, -1.0):
            data.act[:] = kept + sign * _STEP
            mujoco.mj_fwdActuation(self._model, data)
            rates.append(data.act_dot.copy())
        data.act[:] = kept
        mujoco.mj_fwdActuation(self._model, data)
        return float(np.abs(rates[0] - rates[1]).max(initial=0.0)) / (2.0 * _STEP)

    def begin(self, duration_s: float, nodes: int = 0) -> None:
        """Begin a step at the state in the data, forces current; with the number of nodes if it is implicit."""
        model, data = self._model, self._data
        limited = model.actuator_ctrllimited.astype(bool)
        controls = np.where(limited, np.clip(data.ctrl, *model.actuator_ctrlrange.T), data.ctrl)
        self._targets, self._slopes = controls[self._filter_controls], controls[self._rates]
        self._start[:] = data.act
        self._sum.fill(0.0)
        self._nodes = np.tile(data.act_dot, (nodes, 1))
        starts = self._start[self._integrators]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (np.where(self._slopes > 0.0, self._high, self._low) - starts) / self._slopes
        inside = reach[(reach > 0.0) & (reach < duration_s)]
        self.kink_s = float(inside.min(initial=math.inf))

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
        act[self._integrators] = np.clip(self._start[self._integrators] + after_s * self._slopes, self._low, self._high)

    def add(self, weight: float) -> None:
        """Add the rates of a stage with its weight."""
        self._last[:] = self._data.act_dot
        self._sum += weight * self._last

    def end(self, duration_s: float) -> None:
        """Set the activations at the end of an explicit step."""
        self.move_to(duration_s, duration_s * self._sum)

    def move_to_node(self, after_s: float, weights: FloatArray) -> None:
        """Set the activations at a node of an implicit step, with the weights of the nodes' rates in it, s."""
        self.move_to(after_s, weights @ self._nodes)

    def set_node(self, node: int) -> float:
        """Store the rates at a node; returns by how much they have changed."""
        change = float(np.abs(self._data.act_dot - self._nodes[node]).max(initial=0.0))
        self._nodes[node] = self._data.act_dot
        return change
