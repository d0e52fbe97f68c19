"""Several control laws in one phase, each with actuators of its own: the parts of the phase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ffsm_mj.controller_protocol import (
    Command,
    Controller,
    ControllerError,
    ControllerReport,
    Finishes,
    Observation,
    Stateful,
    Summarises,
    with_state,
)


@dataclass(frozen=True)
class Part:
    """One of the control laws of a phase.

    Attributes:
        name: Name in the scenario.
        kind: Kind of the law.
        law: The law.
        command: What it commands, all off before each call.
    """

    name: str
    kind: str
    law: Controller
    command: Command


class Parts(Stateful):
    """Control laws side by side, as one control law.

    The parts are evaluated in the order of the scenario; those whose class has ``after_others = True`` come last, since they
    account for the efforts of the other parts, ``command.others``.

    Attributes:
        parts: The parts in the order of the scenario.
        telemetry_signals: Signals of all parts, with the name of the part before their own.
    """

    @dataclass
    class State:
        """States of the laws by the name of the part."""

        laws: dict[str, Any]

    def __init__(self, laws: Mapping[str, tuple[str, Controller]], actuators: Sequence[str]) -> None:
        """Collect the parts.

        Args:
            laws: Kind and law by the name of the part.
            actuators: Names of all actuators of the model.
        """
        self._actuators = tuple(actuators)
        self.parts = tuple(Part(name, kind, law, Command.off(self._actuators)) for name, (kind, law) in laws.items())
        self._laws = {part.name: with_state(part.law, f"part {part.name!r} ({part.kind})") for part in self.parts}
        self._order = sorted(self.parts, key=lambda part: bool(getattr(part.law, "after_others", False)))
        self.telemetry_signals = tuple(
            replace(signal, name=f"{part.name}_{signal.name}", description=f"{signal.description}, part {part.name!r}")
            for part in self.parts
            for signal in part.law.telemetry_signals
        )
        self._current: Part | None = None

    @property
    def in_charge(self) -> str:
        """Name and kind of the part evaluated last, for a person; empty between calls."""
        return f"part {self._current.name!r} ({self._current.kind})" if self._current is not None else ""

    def start(self, observation: Observation) -> None:
        """Let all parts take over."""
        for part in self._order:
            self._current = part
            part.law.start(observation)
        self._current = None

    def control(self, observation: Observation, command: Command) -> None:
        """Collect the commands of all parts.

        Raises:
            ControllerError: Two parts drive the same actuator.
        """
        for part in self._order:
            self._current, part_command = part, part.command
            part_command.clear()
            np.copyto(part_command.others, command.effort)
            part.law.control(observation, part_command)
            if command.powered.dot(part_command.powered):
                raise ControllerError(self._clash(part))
            np.copyto(command.effort, part_command.effort, where=part_command.powered)
            np.logical_or(command.powered, part_command.powered, out=command.powered)
            np.logical_or(command.setpoints, part_command.setpoints, out=command.setpoints)
            command.requests.update(part_command.requests)
        self._current = None

    def _clash(self, part: Part) -> str:
        """Message for actuators that a part and one before it drive."""
        before = self._order[: self._order.index(part)]
        first = next(other for other in before if other.command.powered.dot(part.command.powered))
        both = np.flatnonzero(first.command.powered & part.command.powered)
        names = ", ".join(self._actuators[i] for i in both)
        return f"it drives {names}, which part {first.name!r} ({first.kind}) drives too"

    def is_finished(self, time_s: float) -> bool:
        """Whether all parts are finished that can be."""
        return all(part.law.is_finished(time_s) for part in self.parts if isinstance(part.law, Finishes))

    def telemetry(self) -> list[float]:
        """Values of the signals of all parts.

        Raises:
            ValueError: A part gives another number of values than signals.
        """
        values: list[float] = []
        for part in self.parts:
            if part.law.telemetry_signals:
                report = part.law.telemetry()
                if len(report) != len(part.law.telemetry_signals):
                    raise ValueError(
                        f"telemetry of part {part.name!r} gives {len(report)} values for "
                        f"{len(part.law.telemetry_signals)} signals"
                    )
                values.extend(report)
        return values

    def summary(self) -> ControllerReport:
        """What the parts report, with the name of the part before each name."""
        return {
            f"{part.name}_{name}": value
            for part in self.parts
            if isinstance(part.law, Summarises)
            for name, value in part.law.summary().items()
        }
