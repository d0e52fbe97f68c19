"""Actuation of the plant: applies the limits of actuators to the commands of a controller, which cannot bypass them.

Efforts are forces in N or torques in N m at the driven joint or site; MuJoCo's ``ctrl`` is the effort over gear and gain.
The command of a servo is its setpoint, which is ``ctrl`` itself; where no law commands a servo, it keeps the last one, and
before the first one that at which it exerts no force at the start of the run. A command is decided once per control tick
and constant until the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj._core.tick import Limits
from ffsm_mj.actuation.config import AnyActuator
from ffsm_mj.actuation.limits import limits_of
from ffsm_mj.actuation.servos import ServoForces, activation_columns, begin_at_rest, set_activations
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import ControllerError
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.driven_joints import control_unit, unit_suffix
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.state import Stateful

_EFFORTS = {
    "command": "commanded",
    "applied": "delivered",
    "lower": "lower bound while powered",
    "upper": "upper bound while powered",
}
_SETPOINTS = {
    "command": "commanded",
    "applied": "in effect, within its bounds",
    "lower": "lower bound",
    "upper": "upper bound",
}
"""Logged quantities of each actuator, in the order of :attr:`Actuation.table`."""


class Actuation(Stateful):
    """Limits of all actuators, as arrays.

    Attributes:
        names: Full names of the actuators in MuJoCo's order.
        table: By actuator: command, applied effort, least and greatest possible effort, (nu, 4); of a servo the setpoints.
        applied: Currently applied efforts and setpoints, (nu,).
        gear: Effort per ctrl, (nu,).
        servos: Which are servos, (nu,).
        envelope: Limits of the actuators.
        counts: On-time in s and unsigned impulse in N s of each on-off actuator, (number of on-off actuators, 2).
        others: Indices of the on-off actuators, which have valves.
        columns: Columns of the table and the counts.
        keys: Columns of ``command``, ``applied``, ``lower`` and ``upper`` by actuator.
    """

    @dataclass
    class State:
        """Efforts and their bounds, (nu, 4), counts, and what valves remember."""

        table: FloatArray
        counts: FloatArray
        valves: list[Any]
        valves_open: bool

    def __init__(
        self,
        system: System,
        configs: Mapping[str, AnyActuator],
        data: Any,
        activations: Mapping[str, float | Sequence[float]] = MappingProxyType({}),
    ) -> None:
        """Resolve names and collect limits.

        Args:
            system: Robot and objects.
            configs: Limits in the scenario by name.
            data: State of the system at the start, derived quantities current; receives the activations.
            activations: Activations of servos at the start by name; others begin without force.

        Raises:
            ScenarioFaults: An unknown actuator, or a limit of motors for a servo.
        """
        self.names = system.names("actuator")
        self.envelope, valves = limits_of(system, configs)
        self.gear, self.servos = self.envelope.gear, self.envelope.keeps
        self._valves = [*valves.values()]
        self.table = np.zeros((len(self.names), len(_EFFORTS)))
        self._wanted, self.applied, self._lower, self._upper = self.table.T
        self._wanted[:] = begin_at_rest(system.mj, data)
        set_activations(system, data, activations)
        self._counted = np.array([*valves], dtype=np.intp)
        self._gears = self.gear[self._counted]
        self._valves_open = False
        self.counts = np.zeros((len(self._valves), 2))
        efforts = _effort_signals(system)
        self.keys = {what: [signal.key for signal in efforts[i :: len(_EFFORTS)]] for i, what in enumerate(_EFFORTS)}
        self.columns: tuple[Columns, ...] = (
            Columns(efforts, live=self.table.reshape(-1)),
            Columns(
                _count_signals([self.names[i] for i in self._counted]), live=self.counts.reshape(-1), resume=self._resume
            ),
        )
        self.others = frozenset(self._counted.tolist())
        if self.servos.any():
            self.columns += (ServoForces(system, data).columns,)
        if system.mj.na:
            self.columns += (activation_columns(system, data),)
        self._data: Any = None
        self._command: Command | None = None

    def limits(self, command: Command, data: Any, actuators: IntArray) -> Limits | None:
        """Limits of a command while it drives some actuators alone; None if those of :attr:`others` take part."""
        self.bind(command, data)
        possible = not self._valves_open and self.others.isdisjoint(actuators.tolist())
        return self._limits if possible else None

    def bind(self, command: Command, data: Any) -> None:
        """Bind to the command and the data that :meth:`apply` is going to be called with."""
        if data is self._data and command is self._command:
            return
        self._data, self._command, self._ctrl = data, command, data.ctrl
        arrays = command.effort, command.powered, data.actuator_velocity, self.table, data.ctrl
        self._limits = Limits(self.envelope, *arrays)

    def apply(self, command: Command, data: Any, time_s: float) -> None:
        """Convert a command to ``data.ctrl``, to be held until the next one.

        Raises:
            ControllerError: A powered effort or setpoint is not finite.
        """
        self.bind(command, data)
        if not self._limits.apply():
            wrong = np.flatnonzero(~np.isfinite(self._wanted))
            names = ", ".join(self.names[i] for i in wrong)
            what = "setpoint" if self.servos[wrong].all() else "effort"
            raise ControllerError(f"the controller commands a non-finite {what} for {names}")
        if self._valves:
            self._switch(command.powered, time_s)

    def _switch(self, powered: npt.NDArray[np.bool_], time_s: float) -> None:
        """Open or close the valves of the on-off actuators, which deliver full thrust or none, within limits."""
        on = powered.tolist()  # element access is faster in lists than in arrays
        numbers = self._counted.tolist()
        if not (self._valves_open or True in [on[i] for i in numbers]):
            return  # all are closed and stay closed
        wanted = self._wanted.tolist()
        lower, upper, forces = self._lower.tolist(), self._upper.tolist(), []
        for i, valve in zip(numbers, self._valves, strict=True):
            forces.append(valve.fire(wanted[i], lower[i], upper[i], time_s) if on[i] else valve.shut())
        self._take(forces)

    def _take(self, forces: Sequence[float]) -> None:
        """Apply the forces of the valves."""
        self.applied[self._counted] = forces
        self._ctrl[self._counted] = self.applied[self._counted] / self._gears
        self._valves_open = any(forces)

    def hold(self, efforts: FloatArray, data: Any, time_s: float) -> None:
        """Restore efforts that were decided before, within limits; the state of valves follows from the efforts.

        Args:
            efforts: Efforts of all actuators, (nu,).
            data: State at which they were decided.
            time_s: Time at which they were decided.
        """
        self.apply(Command(efforts, (efforts != 0.0) | self.servos), data, time_s)
        if self._valves:
            numbers = self._counted.tolist()
            self._take([valve.stand(float(efforts[i]), time_s) for i, valve in zip(numbers, self._valves, strict=True)])

    def by_name(self) -> dict[str, tuple[float, ...]]:
        """Currently applied effort, N or N m, or setpoint, by actuator."""
        return {name: (effort,) for name, effort in zip(self.names, self.applied.tolist(), strict=True)}

    def elapse(self, duration_s: float) -> None:
        """Accumulate on-times and impulses of the on-off actuators over an interval of held efforts."""
        if not self._valves_open:
            return
        applied = self.applied[self._counted]
        self.counts[:, 0] += duration_s * (applied != 0.0)
        self.counts[:, 1] += duration_s * np.abs(applied)

    def _resume(self, counts: FloatArray) -> None:
        self.counts[:] = counts.reshape(-1, 2)


def _effort_signals(system: System) -> tuple[Signal, ...]:
    """Four signals per actuator, in the order of the table."""
    signals, servos = [], servo_mask(system.mj)
    for i, name in enumerate(system.names("actuator")):
        unit, kind, meanings = control_unit(system.mj, i), "effort", _EFFORTS
        if servos[i]:
            kind, meanings = "setpoint", _SETPOINTS
        for what, meaning in meanings.items():
            text, end = f"{kind} of {name}, {meaning}", unit_suffix(unit)
            signals.append(Signal("actuators", f"{identifier(name)}_{what}{end}", unit, text, f"actuator {name}"))
    return tuple(signals)


def _count_signals(names: Sequence[str]) -> tuple[Signal, ...]:
    """Two signals per on-off actuator, in the order of the counts."""
    signals = []
    for name in names:
        field, element = identifier(name), f"actuator {name}"
        time, impulse = f"time that {name} has been on", f"impulse that {name} has delivered, unsigned"
        signals.append(Signal("actuators", f"{field}_on_time_s", "s", time, element))
        signals.append(Signal("actuators", f"{field}_impulse_N_s", "N s", impulse, element))
    return tuple(signals)
