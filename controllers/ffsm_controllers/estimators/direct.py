"""Estimator without a filter for the state: the newest valid sample of each coordinate and rate, brought to now."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
from pydantic import NonNegativeFloat

from ffsm_controllers.estimators.readings import ORDER, Reading, readings_of
from ffsm_mj.controller_protocol import ControllerContext, FloatArray, Measurement, Stateful, StrictModel, predict


class DirectConfig(StrictModel):
    """Newest samples; rates that nothing measures are differences of samples, filtered."""

    kind: Literal["direct"]
    rate_filter_s: NonNegativeFloat = 0.02
    """Time constant of the first-order filter on rates from differences of samples, s; 0: none."""


class Direct(Stateful):
    """The newest valid sample of each quantity, moved over its age by the model's own free motion.

    - Coordinates and rates of joints come from ``jointpos``, ``jointvel``, ``ballquat``, ``ballangvel``; pose and twist of
      a floating body from ``framepos``, ``framequat``, ``startracker``, ``framelinvel``, ``frameangvel``, ``gyro`` and
      ``velocimeter`` on it, relative to the world or to a frame of another model, whose estimate is used.
    - A rate without a sensor is the difference of two samples, with a first-order filter (``rate_filter_s``).
    - What nothing measures moves as the model predicts it from the initial state, under the efforts held.
    """

    @dataclass
    class State:
        """Past estimates, the oldest first: time, s, coordinates and rates; and what was read of each sensor."""

        history: list[tuple[float, FloatArray, FloatArray]]
        readings: list[Reading.State]

    Config = DirectConfig
    telemetry_signals = ()

    def __init__(self, config: DirectConfig, context: ControllerContext) -> None:
        """Find what each sensor measures.

        Raises:
            ScenarioFaults: No sensor measures anything of the state.
        """
        self._model, self._field = context.system.mj, context.external_field
        self._readings = readings_of(context.system, context.sensors, config.rate_filter_s)
        self._past = mujoco.MjData(self._model)
        used = [context.sensors[reading.sensor] for reading in self._readings]
        self._longest_s = max(sensor.delay_s + sensor.delay_jitter_s + sensor.interval_s for sensor in used)
        self._history: deque[tuple[float, FloatArray, FloatArray]] = deque()

    def start(self, data: Any) -> None:
        """Begin at the initial state."""
        self._history.clear()
        self._remember(data.time, data)
        for reading in self._readings:
            reading.forget()

    def update(self, time_s: float, measured: Mapping[str, Measurement], events: Sequence[Any], data: Any) -> None:  # noqa: ARG002
        """See :class:`~ffsm_mj.controller_protocol.Estimator`."""
        predict(self._model, data, time_s - data.time, self._field)
        data.time = time_s
        by_time: dict[float, list[tuple[Reading, Measurement]]] = {}
        for reading in self._readings:
            sample = measured[reading.sensor]
            if reading.is_new(sample):
                by_time.setdefault(round(sample.time_s, 9), []).append((reading, sample))
        for sampled_s in sorted(by_time):  # the newest have the last word
            self._take(sampled_s, by_time[sampled_s], data)
        self._remember(time_s, data)

    def _take(self, sampled_s: float, samples: list[tuple[Reading, Measurement]], data: Any) -> None:
        """Take over what was measured at one time: set in the estimate of that time, which then moves on until now."""
        past, now_s = self._past, data.time
        if sampled_s < now_s:
            past.time, past.qpos[:], past.qvel[:] = self._known_at(sampled_s)
            past.ctrl[:] = data.ctrl
            predict(self._model, past, sampled_s - past.time, self._field)
        else:
            past.qpos[:], past.qvel[:] = data.qpos, data.qvel
        past.ctrl[:] = 0.0
        for order in ORDER:
            mujoco.mj_kinematics(self._model, past)
            mujoco.mj_comPos(self._model, past)
            mujoco.mj_comVel(self._model, past)
            for reading, sample in samples:
                if reading.order == order:
                    reading.write(sample, past)
        past.time = sampled_s
        predict(self._model, past, now_s - sampled_s, self._field)
        for reading, _ in samples:
            data.qpos[reading.qpos], data.qvel[reading.dofs] = past.qpos[reading.qpos], past.qvel[reading.dofs]

    def _remember(self, time_s: float, data: Any) -> None:
        """Keep the estimate as long as samples may be under way."""
        history = self._history
        history.append((time_s, data.qpos.copy(), data.qvel.copy()))
        while len(history) > 1 and history[1][0] <= time_s - self._longest_s:
            history.popleft()

    def _known_at(self, time_s: float) -> tuple[float, FloatArray, FloatArray]:
        """Last estimate at or before a time; the oldest one if there is none."""
        before = [known for known in self._history if known[0] <= time_s + 1e-9]
        return before[-1] if before else self._history[0]

    def telemetry(self) -> tuple[()]:
        """Nothing."""
        return ()
