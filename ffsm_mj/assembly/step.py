"""What a simulator gives the program that steps it: steps, states and errors."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import FfsmError
from ffsm_mj.simulation.outcome import Ended
from ffsm_mj.state import entries, from_bytes, to_bytes


class SimulatorError(FfsmError):
    """A simulator was used in a way that its state does not allow."""


@dataclass(frozen=True)
class SimulatorState:
    """State of a simulator: numbers, texts and arrays, which move between processes and machines as bytes.

    Attributes:
        time_s: Its simulation time, s.
        overrides: Overrides of the run, beside those of the simulator.
        seed: Key ``seed`` of the run, if one was given.
        fingerprint: Fingerprint of the scenario and its models.
        parts: What the parts of the simulation remember.
    """

    time_s: float
    overrides: tuple[str, ...]
    seed: int | None
    fingerprint: str
    parts: Any = field(repr=False)

    def to_bytes(self) -> bytes:
        """The state as bytes; see :mod:`ffsm_mj.state` for their format."""
        return to_bytes(self)

    @classmethod
    def from_bytes(cls, data: bytes) -> SimulatorState:
        """A state from bytes; nothing is executed.

        Raises:
            StateError: They are no state of a simulator, of another version, or damaged.
        """
        state = entries(from_bytes(data), [each.name for each in fields(cls)], "a simulator")
        return cls(**state)


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
