"""A control law that workers can import, and that goes wrong as it is told."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from typing import ClassVar, Literal

from ffsm_mj.controller_protocol import Command, ControllerContext, Observation, Signal, StrictModel


class FuseConfig(StrictModel):
    kind: Literal["fuse"]
    act: Literal["nothing", "kill", "raise", "stick", "dawdle"] = "nothing"


class Fuse:
    """Does nothing, or ends the worker, or never returns."""

    Config = FuseConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = ()

    def __init__(self, config: FuseConfig, context: ControllerContext) -> None:
        self._act = config.act

    def start(self, observation: Observation) -> None:
        if self._act == "stick":
            time.sleep(1000.0)  # in C: no exception of ours reaches it; at once, before any look at the clock

    def control(self, observation: Observation, command: Command) -> None:
        if self._act == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self._act == "raise":
            raise ArithmeticError("the fuse is blown")
        if self._act == "dawdle":
            time.sleep(0.1)

    def telemetry(self) -> Sequence[float]:
        return ()
