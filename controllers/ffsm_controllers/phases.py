"""The phase machine: a controller made of controllers, one per phase of the task (paper, Fig. 2)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any

import numpy as np

from ffsm_controllers.indices import compact
from ffsm_controllers.parts import Parts
from ffsm_controllers.settled import TIME_TOLERANCE_S, SettlingMonitor
from ffsm_mj.controller_protocol import (
    Columns,
    Command,
    Controller,
    ControllerError,
    ControllerReport,
    Finishes,
    GivenCommand,
    Observation,
    PhaseRecord,
    Signal,
    Summarises,
)


@dataclass(frozen=True)
class MeasurementBound:
    """A bound on what a sensor measures.

    Attributes:
        sensor: Its full name.
        above: The measurement is beyond it above this value; None: no such bound.
        below: The measurement is beyond it below this value; None: no such bound.
    """

    sensor: str
    above: float | None = None
    below: float | None = None

    def is_exceeded(self, observation: Observation) -> bool:
        """Whether the newest sample is valid, and its value, or the norm of a vector, is beyond the bound."""
        sample = observation.measured[self.sensor]
        if not sample.valid:
            return False
        value = float(sample.value[0]) if len(sample.value) == 1 else math.hypot(*sample.value.tolist())
        return value > self.above if self.above is not None else self.below is not None and value < self.below


@dataclass(frozen=True)
class Phase:
    """One phase.

    Attributes:
        name: Name in the scenario.
        kind: Kind of its controller; with several parts ``name: kind`` of each.
        controller: What drives the robot in it.
        until: What ends it after its start, for people: ``impact``, a record of another contact model, ``settled``,
            ``finished``; empty: nothing.
        ending: Class of the records that do.
        settled: Says when the tip has settled, which ends it; None where that does not.
        sensed: Bound on a measurement, beyond which it ends; None where that does not.
        finishes: Whether it ends when its controller has finished.
        duration_s: It ends at the first control tick at or after this time since its start; None: no such end.
        arm: Names of the captures that may close while it lasts.
        release: Names of those that let go as it begins.
        held: The same law made for the systems in which objects are held, by the name of the capture.
    """

    name: str
    kind: str
    controller: Controller
    until: str = ""
    ending: type | None = None
    settled: SettlingMonitor | None = None
    sensed: MeasurementBound | None = None
    finishes: bool = False
    duration_s: float | None = None
    arm: tuple[str, ...] = ()
    release: tuple[str, ...] = ()
    held: Mapping[str, Controller] = field(default_factory=dict)

    def law(self, grasp: str) -> Controller:
        """The controller of the system in which a capture holds; empty: the free one."""
        return self.held[grasp] if grasp else self.controller


class PhaseMachine:
    """Runs phases in order; the last one lasts to the end of the run.

    Attributes:
        phases: The phases in their order.
        given: Command of the program that steps the simulation: phases begin and end, and their controllers are asked only
            for actuators that it leaves to them.
    """

    def __init__(self, phases: Sequence[Phase]) -> None:
        """Collect what the phases report: a signal that several share is one column."""
        self.phases = tuple(phases)
        signals: dict[str, Signal] = {}
        for phase in self.phases:
            signals |= {signal.key: signal for signal in phase.controller.telemetry_signals}
        column = {key: i for i, key in enumerate(signals)}
        self._columns = [compact([column[s.key] for s in phase.controller.telemetry_signals]) for phase in self.phases]
        self.telemetry = np.full(len(signals), np.nan)
        self._live_index = np.full(1, -1.0)
        index = Signal("phase", "index", "", "position of the phase in the scenario, from 0")
        self.columns: tuple[Columns, ...] = (
            Columns(tuple(signals.values()), live=self.telemetry),
            Columns((index,), live=self._live_index),
        )
        self.given: GivenCommand | None = None
        self.phase_index = -1
        self._start_s = 0.0
        self._begun: list[PhaseRecord] = []
        self._current: PhaseRecord | None = None
        self._begins_again = False
        self._grasp = ""
        self._requests: list[str] = []
        self._asked: dict[tuple[int, str], Controller] = {}

    @property
    def in_charge(self) -> str:
        """Name of the phase and kind of its controller, or its part that is being evaluated."""
        phase = self.phases[max(self.phase_index, 0)]
        part = law.in_charge if isinstance(law := phase.law(self._grasp), Parts) else ""
        return f"phase {phase.name!r}, {part}" if part else f"phase {phase.name!r} ({phase.kind})"

    def control(self, observation: Observation, command: Command) -> None:
        """Change phase where it is due, then ask its controller, unless a given command leaves it nothing to command."""
        if self.phase_index < 0:
            self._begin(0, observation, "start")
        reason = self._ended(observation)
        if reason and self.phase_index + 1 < len(self.phases):
            self._begin(self.phase_index + 1, observation, reason)
        if observation.grasp != self._grasp or self._begins_again:
            self._take_over(observation)
        if self.given is None:
            self._ask(observation, command)
        else:
            if not self.given.is_complete:
                self._ask(observation, command)
            self.given.write(command)
        if self._requests:
            command.requests.update(self._requests)
            self._requests.clear()

    def _ask(self, observation: Observation, command: Command) -> None:
        """Let the controller of the phase command, and take its telemetry."""
        controller = self.phases[self.phase_index].law(self._grasp)
        controller.control(observation, command)
        if controller.telemetry_signals:
            report = controller.telemetry()
            if len(report) != len(controller.telemetry_signals):
                raise ValueError(f"telemetry gives {len(report)} values for {len(controller.telemetry_signals)} signals")
            self.telemetry[self._columns[self.phase_index]] = report

    def _ended(self, observation: Observation) -> str:
        """Why the current phase is over, or nothing."""
        phase = self.phases[self.phase_index]
        if phase.ending is not None and any(isinstance(event, phase.ending) for event in observation.events):
            return phase.until
        if phase.settled is not None and phase.settled.look(_of_free(observation)):
            return phase.until
        if phase.sensed is not None and phase.sensed.is_exceeded(observation):
            return phase.until
        law = phase.law(self._grasp)
        if phase.finishes and observation.at_tick and isinstance(law, Finishes) and law.is_finished(observation.time_s):
            return phase.until
        elapsed = observation.time_s - self._start_s
        if observation.at_tick and phase.duration_s is not None and elapsed >= phase.duration_s - TIME_TOLERANCE_S:
            return "time"
        return ""

    def _begin(self, index: int, observation: Observation, reason: str) -> None:
        phase, before = self.phases[index], self.phases[self.phase_index].arm if self.phase_index >= 0 else ()
        self.phase_index = index
        self._requests += [f"{name}.release" for name in phase.release]
        self._requests += [f"{name}.disarm" for name in before if name not in phase.arm]
        self._requests += [f"{name}.arm" for name in phase.arm]
        self._live_index[0], self._start_s = index, observation.time_s
        self.telemetry.fill(np.nan)
        self._current = PhaseRecord(index, phase.name, phase.kind, observation.time_s, reason)
        self._begun.append(self._current)
        if phase.settled is not None:
            phase.settled.begin(_of_free(observation))
        self._take_over(observation)

    def _take_over(self, observation: Observation) -> None:
        """Let the phase's law for what moves now begin."""
        self._begins_again = False
        self._grasp = observation.grasp
        law = self.phases[self.phase_index].law(self._grasp)
        self._asked[self.phase_index, self._grasp] = law
        law.start(observation._replace(phase_start_s=self._start_s))

    def drain_phases(self) -> list[PhaseRecord]:
        """Phases begun since the last call."""
        begun, self._begun = self._begun, []
        return begun

    def tell_phase_again(self) -> None:
        """Let the phase under way be among the phases begun since the last call: a log begins with it."""
        if self._current is not None:
            self._begun[:] = [self._current]

    def begin_law_again(self) -> None:
        """Let the control law of the phase under way begin at its next call."""
        self._begins_again = True

    def reports(self) -> dict[str, ControllerReport]:
        """What the control laws of the phases begun say of their work, by phase.

        Raises:
            ControllerError: One says what is neither a finite number nor text.
        """
        found: dict[str, ControllerReport] = {}
        for i, phase in enumerate(self.phases[: self.phase_index + 1]):
            report: dict[str, float | int | str] = {}
            for grasp in ("", *phase.held):
                law = self._asked.get((i, grasp))
                told: ControllerReport = law.summary() if isinstance(law, Summarises) else {}
                before = f"{grasp}: " if grasp else ""
                report |= {f"{before}{name}": _plain(phase, name, value) for name, value in told.items()}
            found[phase.name] = report
        return found


def _of_free(observation: Observation) -> Observation:
    """What the free system would show: its data alone, whatever is held."""
    return observation._replace(data=observation.free) if observation.grasp else observation


def _plain(phase: Phase, name: str, value: Any) -> float | int | str:
    """A value of a summary in Python's own types, whatever a law counted in."""
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real) and math.isfinite(value):
        return float(value)
    raise ControllerError(f"summary of phase {phase.name!r} ({phase.kind}): {name} is {value!r}, no finite number or text")
