"""Plays recorded efforts from a file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ffsm_controllers.playback.columns import effort_record
from ffsm_controllers.playback.config import PlaybackConfig
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerReport,
    IntArray,
    Observation,
    Signal,
    Stateful,
    is_servo,
)
from ffsm_mj.tolerances import SCHEDULED_S


class Playback(Stateful):
    """Recorded efforts, whatever the robot does.

    An effort of exactly zero is played as off: a motor on a torque-speed line delivers nothing at any speed only where it is
    off. Logs do not tell the two apart.
    """

    @dataclass
    class State:
        """Time 0 of the record, the last sample that was played, samples that never were, and the greatest delay, s."""

        start_s: float
        sample: int
        skipped: int
        late_s: float

    Config = PlaybackConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = ()

    def __init__(self, config: PlaybackConfig, context: ControllerContext) -> None:
        """Take the columns of the file.

        Raises:
            ScenarioFaults: The file does not fit the actuators; see :func:`effort_record`.
        """
        table = context.recorded["file"]
        self._actuators, self._record = effort_record(config, table, context.system)
        # An effort of zero is off; a servo has a setpoint of zero.
        self._servos = np.array([is_servo(context.system.mj, i) for i in self._actuators.tolist()], dtype=np.bool_)
        self._of_phase, self._place = config.time.since == "phase", table.place
        self._period_s, self._start_s = context.control_period_s, 0.0
        self._sample, self._skipped, self._late_s = -1, 0, 0.0

    @property
    def driven_actuators(self) -> IntArray:
        """Those with a column."""
        return self._actuators

    def start(self, observation: Observation) -> None:
        """Set the clock of the record; a grasp that closes or opens does not set it back."""
        self._start_s = observation.phase_start_s if self._of_phase else 0.0
        self._sample = self._record.sample_at(observation.time_s - self._start_s)

    def control(self, observation: Observation, command: Command) -> None:
        """Play the efforts of this time, until the next control tick."""
        next_tick = math.floor((observation.time_s + SCHEDULED_S) / self._period_s) + 1
        time_s = observation.time_s - self._start_s
        efforts = self._record.over(time_s, next_tick * self._period_s - observation.time_s)
        if efforts is not None:
            command.effort[self._actuators] = efforts
            command.powered[self._actuators] = (efforts != 0.0) | self._servos
            command.setpoints[self._actuators] = self._servos
        if self._record.interpolation == "held":
            self._compare(time_s)

    def _compare(self, time_s: float) -> None:
        """Compare the times of samples with those at which they are played."""
        sample = self._record.sample_at(time_s)
        if sample > self._sample:
            self._skipped += sample - self._sample - 1
            self._late_s = max(self._late_s, time_s - float(self._record.times_s[sample]))
            self._sample = sample

    def is_finished(self, time_s: float) -> bool:
        """Whether the record is over, also where its last efforts are held."""
        return time_s - self._start_s >= self._record.end_s - SCHEDULED_S

    def telemetry(self) -> Sequence[float]:
        """Nothing to report."""
        return ()

    def summary(self) -> ControllerReport:
        """Samples of a held record that lie between control ticks."""
        report: dict[str, float | int | str] = {"samples": len(self._record.times_s)}
        if self._late_s > SCHEDULED_S or self._skipped:
            report |= {"latest_sample_s": self._late_s, "skipped_samples": self._skipped}
            skipped = f", and {self._skipped} are never played" if self._skipped else ""
            report["note"] = (
                f"samples of {self._place} begin up to {self._late_s:.3g} s late{skipped}: they lie between control ticks; "
                "choose a control period that divides their times, or 'interpolation: mean'"
            )
        return report
