"""The control law ``my_law`` for ffsm-mj: viscous damping of joints, to be replaced by your own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerReport,
    Faults,
    Observation,
    Signal,
    Stateful,
    StrictModel,
    is_servo,
    needs_motors,
)


class MyLawConfig(StrictModel):
    """What a phase of a scenario may set."""

    kind: Literal["my_law"]
    actuators: tuple[str, ...]
    """Joint motors to drive."""
    gain: float
    """N m s/rad."""


class MyLaw(Stateful):
    """u = -gain * rate of the joint."""

    @dataclass
    class State:
        """Attributes that the law keeps from one call to the next: saved and restored with a simulation."""

        fastest: float

    Config = MyLawConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal("controller", "my_law_fastest_rad_s", "rad/s", "greatest rate of a damped joint"),
    )

    def __init__(self, config: MyLawConfig, context: ControllerContext) -> None:
        """Resolve names.

        Raises:
            ScenarioFaults: No actuator has this name, or it is a servo; the message contains file, line and column.
        """
        system = context.system
        with Faults() as faults:
            for i, name in enumerate(config.actuators):
                with faults.below("actuators", i):
                    actuator = system.index("actuator", name)
                    if is_servo(system.mj, actuator):
                        faults.add(needs_motors(system, [actuator]), "actuators", i)
        self._motors = np.array([system.index("actuator", name) for name in config.actuators])
        self._dofs = system.mj.jnt_dofadr[system.mj.actuator_trnid[self._motors, 0]]
        self._gain, self._fastest = config.gain, 0.0

    def start(self, observation: Observation) -> None:
        """Take over at the beginning of a phase."""

    def control(self, observation: Observation, command: Command) -> None:
        """Write the efforts for the coming control period; called at once at an impact too."""
        rates = observation.data.qvel[self._dofs]
        command.drive(self._motors, -self._gain * rates)
        self._fastest = float(np.abs(rates).max())

    def telemetry(self) -> tuple[float, ...]:
        """Values of ``telemetry_signals`` after the last call: columns of the log."""
        return (self._fastest,)

    def summary(self) -> ControllerReport:
        """What it came to, for ``summary.json``; may be left out."""
        return {"last_fastest_rad_s": self._fastest}
