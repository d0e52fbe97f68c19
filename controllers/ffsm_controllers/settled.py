"""When a phase has done its work: the tip is near its target and slow, and has been for a while."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from pydantic import PositiveFloat

from ffsm_controllers.endings import TIME_TOLERANCE_S, Trigger
from ffsm_mj.controller_protocol import Controller, Observation, Stateful, StrictModel, System, Task


class SettledConfig(StrictModel):
    """When the tip has settled at the task's target: near and slow at every control tick and impact of some time."""

    error_m: PositiveFloat
    """Near: at most this far from the target along the task's axes, m."""
    speed_m_s: PositiveFloat
    """Slow: at most this fast against the target along the task's axes, m/s."""
    for_s: PositiveFloat
    """For so long, s: the phase ends at the first control tick at or after that."""


class SettlingMonitor(Stateful, Trigger):
    """Watches the tip through a phase."""

    @dataclass
    class State:
        """Time since which the tip is near and slow, s; None: it is not."""

        since_s: float | None

    def __init__(self, bounds: SettledConfig, system: System, task: Task) -> None:
        """Know the bounds and whose tip it is."""
        self._bounds, self._model = bounds, system.mj
        self._task, self._site, self._axes = task, task.tip_site, list(task.axes)
        self._velocity = np.zeros(6)
        self._since_s: float | None = None

    def begin(self, observation: Observation) -> None:
        """The phase begins here."""
        self._since_s = None
        self._look(observation)

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:  # noqa: ARG002
        """Whether the phase is over, at a control tick or at an impact."""
        return self._look(observation)

    def _look(self, observation: Observation) -> bool:
        if not self._within(observation):
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = observation.time_s
        return observation.at_tick and observation.time_s - self._since_s >= self._bounds.for_s - TIME_TOLERANCE_S

    def _within(self, observation: Observation) -> bool:
        data, bounds = observation.data, self._bounds
        target, rates = self._task.target_at(observation.time_s, data)
        if math.dist(data.site_xpos[self._site][self._axes], target) > bounds.error_m:
            return False
        mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_SITE, self._site, self._velocity, 0)
        return math.hypot(*(self._velocity[3:][self._axes] - rates).tolist()) <= bounds.speed_m_s
