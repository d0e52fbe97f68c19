"""What a simulator gives the program that steps it: steps, states and errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import FfsmError
from ffsm_mj.simulation.ending import Ended


class SimulatorError(FfsmError):
    """A simulator was used in a way that its state does not allow."""


@dataclass(frozen=True)
class SimulatorState:
    """State of a simulator; can be pickled.

    Attributes:
        time_s: Its simulation time, s.
        overrides: Overrides of the run, beside those of the simulator.
        seed: Key ``seed`` of the run, if one was given.
        fingerprint: Fingerprint of the scenario and of the parts of the simulation.
        contents: What these parts remember.
    """

    time_s: float
    overrides: tuple[str, ...]
    seed: int | None
    fingerprint: str
    contents: bytes


class Step(NamedTuple):
    """Result of a step.

    Attributes:
        observation: What a control law sees at the end of the step, before its decision there. Its MuJoCo data are those of
            the simulation: they show the present, and must not be written.
        events: Records of what happened in the step, contact events and phases.
        ended: How the run ended; None while it lasts.
    """

    observation: Observation
    events: tuple[Any, ...]
    ended: Ended | None
