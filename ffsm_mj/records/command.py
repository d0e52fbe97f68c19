"""Efforts for the actuators: what a control law commands, and what a program that steps a simulation does in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.errors import full_name
from ffsm_mj.state import Stateful

Actuators: TypeAlias = str | Sequence[str | int] | npt.NDArray[np.intp] | slice
"""Actuators by name, with or without the prefix of a model, by MuJoCo id, or a slice of the ids."""


@dataclass(frozen=True)
class Command(Stateful):
    """Efforts and setpoints by actuator of the model; a controller writes into the arrays, it cannot replace them.

    Attributes:
        effort: Force in N or torque in N m at the joint or site that the actuator drives, or setpoint of a servo, (nu,).
        powered: False where the actuator is off: exactly zero effort, whatever its limits, (nu,).
        setpoints: True where ``effort`` is a setpoint; a servo takes no effort, (nu,).
        requests: Names of what contact models are asked to do now; each says which it hears.
        others: Efforts that other parts of the phase have already commanded at this call, to be read only, (nu,).
        names: Full names of the actuators, (nu,); without them only ids can be commanded.
    """

    @dataclass
    class State:
        """Efforts, and which actuators are powered; requests are made once."""

        effort: FloatArray
        powered: BoolArray

    effort: FloatArray
    powered: npt.NDArray[np.bool_]
    setpoints: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    requests: set[str] = field(default_factory=set)
    others: FloatArray = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()
    _ids: dict[str, int] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def off(cls, actuators: int | Sequence[str]) -> Command:
        """Everything unpowered, of a number of actuators or of the actuators of these names."""
        count, names = (actuators, ()) if isinstance(actuators, int) else (len(actuators), tuple(actuators))
        powered, setpoints = np.zeros((2, count), dtype=np.bool_)
        return cls(np.zeros(count), powered, setpoints, others=np.zeros(count), names=names)

    def clear(self) -> None:
        """Switch everything off."""
        self.effort.fill(0.0)
        self.powered.fill(False)
        self.setpoints.fill(False)
        self.requests.clear()

    def drive(self, actuators: Actuators, effort: FloatArray | float) -> None:
        """Power some motors with the given efforts: ``drive("motor_2", 1.0)``.

        Raises:
            LookupError: No actuator has the name, or more than one; the message lists the names.
        """
        ids = self._indices(actuators)
        self.effort[ids] = effort
        self.powered[ids] = True

    def set(self, servos: Actuators, setpoints: FloatArray | float) -> None:
        """Give some servos the given setpoints.

        Raises:
            LookupError: See :meth:`drive`.
        """
        self.drive(servos, setpoints)
        self.setpoints[self._indices(servos)] = True

    def _indices(self, actuators: Actuators) -> Any:
        """What selects some actuators in an array."""
        if isinstance(actuators, str):
            return self._id(actuators)
        if isinstance(actuators, list | tuple):
            return [self._id(one) if isinstance(one, str) else one for one in actuators]
        return actuators

    def _id(self, name: str) -> int:
        if name not in self._ids:  # a law names the same actuators at every call
            self._ids[name] = self.names.index(full_name("actuator", name, self.names))
        return self._ids[name]


@dataclass(frozen=True)
class ExternalCommand:
    """Command of the program that steps a simulation, in place of that of the control laws.

    Attributes:
        command: Efforts, which actuators are powered, and requests.
        actuators: Actuators that it commands, (nu,); the control laws command the others.
    """

    command: Command
    actuators: npt.NDArray[np.bool_]

    @property
    def is_complete(self) -> bool:
        """Whether it commands every actuator: no control law is evaluated."""
        return bool(self.actuators.all())

    def write(self, command: Command) -> None:
        """Write it into a command, over what control laws have written there.

        Efforts are held to the end of a step, so they are written at every decision in it; requests are made once.
        """
        np.copyto(command.effort, self.command.effort, where=self.actuators)
        np.copyto(command.powered, self.command.powered, where=self.actuators)
        np.copyto(command.setpoints, True, where=self.actuators)
        command.requests.update(self.command.requests)
        self.command.requests.clear()
