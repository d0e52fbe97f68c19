"""Everything unpowered: coasting, and the paper's safety pause."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from ffsm_mj.controller_protocol import Command, ControllerContext, Observation, Signal, StrictModel


class OffConfig(StrictModel):
    """No actuation."""

    kind: Literal["off"]


class Off:
    """Leaves every actuator off."""

    Config = OffConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = ()

    def __init__(self, config: OffConfig, context: ControllerContext) -> None:
        """Nothing to set up."""

    @property
    def driven_actuators(self) -> Sequence[int]:
        """None."""
        return ()

    def start(self, observation: Observation) -> None:
        """Nothing to remember."""

    def control(self, observation: Observation, command: Command) -> None:
        """Leave the command as it is: all off."""

    def telemetry(self) -> Sequence[float]:
        """Nothing to report."""
        return ()
