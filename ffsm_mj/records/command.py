"""Efforts for the actuators: what a control law commands, and what a program that steps a simulation does in its place."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.state import Stateful


@dataclass(frozen=True)
class Command(Stateful):
    """Efforts and setpoints by actuator of the model; a controller writes into the arrays, it cannot replace them.

    Attributes:
        effort: Force in N or torque in N m at the joint or site that the actuator drives, or setpoint of a servo, (nu,).
        powered: False where the actuator is off: exactly zero effort, whatever its limits, (nu,).
        setpoints: True where ``effort`` is a setpoint; a servo takes no effort, (nu,).
        requests: Names of what contact models are asked to do now; each says which it hears.
        others: Efforts that other parts of the phase have already commanded at this call, to be read only, (nu,).
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

    @classmethod
    def off(cls, count: int) -> Command:
        """Everything unpowered."""
        powered, setpoints = np.zeros((2, count), dtype=np.bool_)
        return cls(np.zeros(count), powered, setpoints, others=np.zeros(count))

    def clear(self) -> None:
        """Switch everything off."""
        self.effort.fill(0.0)
        self.powered.fill(False)
        self.setpoints.fill(False)
        self.requests.clear()

    def drive(self, actuators: npt.NDArray[np.intp] | slice, effort: FloatArray) -> None:
        """Power some motors, by their ids or a slice of them, with the given efforts."""
        self.effort[actuators] = effort
        self.powered[actuators] = True

    def set(self, servos: npt.NDArray[np.intp] | slice, setpoints: FloatArray) -> None:
        """Give some servos, by their ids or a slice of them, the given setpoints."""
        self.drive(servos, setpoints)
        self.setpoints[servos] = True


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
