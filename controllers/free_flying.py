"""The paper's free-flying pause (section 4.4): base and arm under PD back to where the phase began, at rest.

The base is driven through motors on its own joints (ideal, world-aligned thrusters and an ideal wheel); what the thrusters
make of it, on or off, is decided by the plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from controllers.pd import Gain, Pd, PdConfig
from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import Command, ControllerContext, Observation
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.signals import Signal


class PartConfig(StrictModel):
    """PD gains of some joints."""

    joints: tuple[str, ...]
    """Joints of this part."""
    kp: Gain
    """Proportional gain, N/m for slides, N m/rad for hinges."""
    kd: Gain
    """Derivative gain, N s/m for slides, N m s/rad for hinges."""


class FreeFlyingConfig(StrictModel):
    """PD on thrusters, wheel and arm towards the configuration at the start of the phase."""

    kind: Literal["free_flying"]
    thrusters: PartConfig
    """Base translation; the paper: kp 50, kd 37.5."""
    wheel: PartConfig
    """Base rotation; the paper: kp 200, kd 150."""
    arm: PartConfig
    """The arm; the paper: kp 150, kd 112.5."""


class FreeFlying:
    """Three PD parts that drive disjoint joints."""

    Config = FreeFlyingConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = ()

    def __init__(self, config: FreeFlyingConfig, context: ControllerContext) -> None:
        """Build one PD per part.

        Raises:
            ScenarioFaults: An unknown joint.
        """
        self._parts: list[Pd] = []
        for name, part in (("thrusters", config.thrusters), ("wheel", config.wheel), ("arm", config.arm)):
            try:
                self._parts.append(Pd(PdConfig(kind="pd", joints=part.joints, kp=part.kp, kd=part.kd), context))
            except ScenarioFaults as faults:
                raise ScenarioFaults([Fault(f.message, (name, *f.path)) for f in faults.faults]) from faults

    def start(self, observation: Observation) -> None:
        """Take the reference of every part."""
        for part in self._parts:
            part.start(observation)

    def control(self, observation: Observation, command: Command) -> None:
        """Drive every part."""
        for part in self._parts:
            part.control(observation, command)

    def telemetry(self) -> Sequence[float]:
        """Nothing to report."""
        return ()
