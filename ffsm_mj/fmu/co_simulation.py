"""A scenario under a master of a co-simulation: variables by name, steps of the master, states to go back to.

The master owns the clock. Between its communication points the scenario runs as under :class:`ffsm_mj.Simulator`: actuators
that are handed over take the master's commands, which are held over the step, and the phases of the scenario the others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from ffsm_mj.assembly.simulator import Simulator, SimulatorState
from ffsm_mj.errors import FfsmError, InputError, described
from ffsm_mj.fmu.ports import EXTERNAL, OVERRIDES, RECORD, Outputs, Port, Value, inputs, parameters
from ffsm_mj.state import StateError

_SAME_TIME = 1e-6
"""Shares of a control period up to which two times are the same: masters add up steps in floating point."""


class RefusedStep(FfsmError):
    """A step that was not made: the state is that before it, and the message says why."""


class CoSimulationState(NamedTuple):
    """Everything that determines how a co-simulation goes on.

    Attributes:
        values: Values of parameters and inputs, in the order of the ports.
        phase: Number of the phase.
        counts: Numbers of events so far.
        simulator: State of the simulation; None before the start.
    """

    values: list[Value]
    phase: int
    counts: dict[str, int]
    simulator: SimulatorState | None

    def to_bytes(self) -> bytes:
        """As bytes that another process reads."""
        whole = json.dumps([self.values, self.phase, self.counts]).encode()
        return whole + b"\n" + (self.simulator.to_bytes() if self.simulator is not None else b"")

    @classmethod
    def from_bytes(cls, data: bytes) -> CoSimulationState:
        """Read them.

        Raises:
            StateError: They are not those of a state.
        """
        whole, _, simulator = data.partition(b"\n")
        try:
            values, phase, counts = json.loads(whole)
        except (TypeError, ValueError) as error:
            raise StateError(f"not a state of a unit: {described(error)}") from error
        return cls(values, phase, counts, SimulatorState.from_bytes(simulator) if simulator else None)


class CoSimulation:
    """A scenario with its variables.

    Attributes:
        ports: Variables: parameters, inputs, outputs.
        time_s: Communication point, s.
        period_s: Control period: steps are multiples of it, s.
    """

    def __init__(self, scenario: str | Path) -> None:
        """Read a scenario, and declare its variables.

        Args:
            scenario: A scenario file, or a folder that holds one.

        Raises:
            InputError: The scenario or a model is wrong.
        """
        self._scenario, self._begun = scenario, False
        self._simulator = Simulator(scenario, record=False, check=False)
        self.time_s = self._simulator.reset().time_s
        assembly, prepared = self._simulator.assembly, self._simulator.prepared
        self._commands, self.period_s = (
            dict(zip(assembly.actuation.names, assembly.actuation.keys["command"], strict=True)),
            prepared.scenario.control_period_s,
        )
        self._outputs = Outputs(assembly)
        settable = [*parameters(prepared.scenario_yaml, [*self._commands]), *inputs(assembly)]
        self.ports: list[Port] = [*settable, *self._outputs.ports]
        self._starts = [port.start for port in settable]
        self._values = list(self._starts)
        self._places = {port.name: place for place, port in enumerate(settable)}
        self._shown: list[Value] | None = None

    def get(self, places: Iterable[int]) -> list[Value]:
        """Values of variables by their places among the ports."""
        if self._shown is None:  # evaluated where they are asked for
            ended = self._simulator.ended
            self._shown = [*self._values, *self._outputs.values(ended)]
        return [self._shown[place] for place in places]

    def set(self, place: int, value: Value) -> None:
        """Set a parameter or an input.

        Raises:
            InputError: It is neither, or a parameter of a run that has begun.
        """
        port = self.ports[place]
        if port.causality == "output":
            raise InputError(f"{port.name} is an output, and cannot be set")
        if port.causality == "parameter" and self._begun:
            raise InputError(f"{port.name} is a parameter, and is fixed when the run has begun")
        self._values[place], self._shown = value, None

    def begin(self, start_s: float = 0.0) -> None:
        """Begin the run with the parameters as they are.

        Raises:
            InputError: The scenario does not allow one of them, or begins at another time.
        """
        overrides = self._overrides()
        if overrides or self._value(RECORD):
            folder = str(self._value(RECORD))
            self.close()
            self._simulator = Simulator(self._scenario, overrides, record=folder or False, check=False)
            self._simulator.reset()
            declared = [port.name for port in self.ports if port.causality == "output"]
            self._outputs = Outputs(self._simulator.assembly)
            if (others := [port.name for port in self._outputs.ports]) != declared:
                odd = sorted({*declared} ^ {*others}) or ["their order"]
                raise InputError(f"the parameters change the outputs ({odd[0]}): export a unit of the changed scenario")
            self.period_s = self._simulator.prepared.scenario.control_period_s
        now = self._simulator.time_s
        if abs(start_s - now) > _SAME_TIME * self.period_s:
            raise InputError(f"start time {start_s:.9g} s: the scenario begins at {now:.9g} s")
        self.time_s, self._begun, self._shown = now, True, None

    def _overrides(self) -> list[str]:
        """Overrides by the parameters that are not as the scenario states them."""
        changed = []
        for port, value, start in zip(self.ports, self._values, self._starts, strict=False):
            if port.causality != "parameter" or value == start or port.name.endswith(EXTERNAL.format("")):
                continue
            if port.name == OVERRIDES:
                changed += [text.strip() for text in str(value).split(";") if text.strip()]
            elif port.name != RECORD:
                whole = isinstance(value, float) and value.is_integer() and abs(value) < 1e15
                # A key of whole numbers takes no 3.0, and one of others takes 3.
                changed.append(f"{port.name}={json.dumps(int(value) if whole and not isinstance(value, bool) else value)}")
        return changed

    def _value(self, name: str) -> Value:
        return self._values[self._places[name]]

    def step(self, now_s: float, step_s: float) -> None:
        """Simulate over a step of the master, a multiple of the control period.

        Raises:
            RefusedStep: The step was not made; or the run ended in it, by its end or otherwise.
        """
        tolerance_s = _SAME_TIME * self.period_s
        if not self._begun:
            raise RefusedStep("a step before the end of the initialization")
        if (ended := self._simulator.ended) is not None:
            raise RefusedStep(f"the run has ended: {ended.outcome.value}, at t = {self.time_s:.9g} s")
        if abs(now_s - self.time_s) > tolerance_s:
            text = f"a step from t = {now_s:.9g} s, where the run is at t = {self.time_s:.9g} s"
            raise RefusedStep(text + (": restore a state to go back" if now_s < self.time_s else ""))
        ticks = round(step_s / self.period_s)
        if ticks < 1 or abs(step_s - ticks * self.period_s) > tolerance_s:
            raise RefusedStep(f"a step of {step_s:.9g} s is no multiple of the control period of {self.period_s:.9g} s")
        command = self._command()
        end_s, self._shown = self.time_s + ticks * self.period_s, None
        try:
            step = self._simulator.step(command, until=end_s)
        except InputError as error:
            raise RefusedStep(described(error)) from error
        self._outputs.count(step.events)
        self.time_s = self._simulator.time_s
        if step.ended is not None and self.time_s < end_s - tolerance_s:
            reason = ": ".join(filter(None, (step.ended.outcome.value, step.ended.message)))
            raise RefusedStep(f"the run ended at t = {self.time_s:.9g} s, inside the step to {end_s:.9g} s: {reason}")

    def _command(self) -> dict[str, float] | None:
        """Commands of the actuators that are handed over; None if none is."""
        command = {}
        for name, key in self._commands.items():
            if self._value(EXTERNAL.format(name)):
                value = float(self._value(key))
                if not math.isfinite(value):
                    raise RefusedStep(f"{key} is {value}, not a finite number")
                command[name] = value
        return command or None

    def get_state(self) -> CoSimulationState:
        """Everything that determines how it goes on."""
        simulator = self._simulator.get_state() if self._begun else None
        return CoSimulationState(list(self._values), self._outputs.phase, dict(self._outputs.counts), simulator)

    def set_state(self, state: CoSimulationState) -> None:
        """Go on from a state, of this or of another process.

        Raises:
            SimulatorError: It is that of another scenario.
            StateError: It does not fit.
        """
        if state.simulator is not None:
            if not self._begun:
                self._values = list(state.values)
                self.begin()
            self._simulator.set_state(state.simulator)
            self.time_s = self._simulator.time_s
        self._values, self._shown = list(state.values), None
        self._outputs.phase, self._outputs.counts = state.phase, dict(state.counts)

    def close(self) -> Any:
        """End the run; returns it, with its log if a folder was asked for."""
        return self._simulator.close()
