"""How far a simulation has come: everything the loop itself remembers between two steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ffsm_mj.controller_protocol import Observation
from ffsm_mj.records.events import RunEnded


@dataclass(frozen=True)
class EventDue:
    """An event that is applied to the state, but not recorded yet: the decision on the efforts after it is due.

    Attributes:
        records: Its records.
        observation: What the controller sees of it.
        triggers_control: Whether the controller is evaluated now; otherwise it receives the records at its next evaluation.
        end: How the run ends at it; None if it continues.
    """

    records: tuple[Any, ...]
    observation: Observation
    triggers_control: bool
    end: RunEnded | None


@dataclass(frozen=True)
class Start:
    """State from which a run goes on.

    Attributes:
        time_s: Its time, s.
        changes: What the parts of a simulation of the same structure have come to remember until then.
        new_laws: The control law of the phase is another one than that which came there: it begins at this state.
        replaced: Phases, by position, whose control laws are of another kind: ``changes`` has nothing of them.
    """

    time_s: float
    changes: bytes
    new_laws: bool
    replaced: tuple[int, ...] = ()


@dataclass
class Progress:
    """Position on the time grid.

    Attributes:
        time_s: Simulation time, s.
        steps: Integration steps completed.
        ticks: Control ticks of the time grid begun.
        evaluations: Evaluations of the controller.
        left_s: Time left of the integration step under way, s.
        is_within_step: Whether an integration step is under way: an event in it is the latest thing that happened.
        events_in_step: Events in the integration step under way.
        due: Event at which a decision is due; None: the next decision is that of the next control tick.
    """

    time_s: float = 0.0
    steps: int = 0
    ticks: int = 0
    evaluations: int = 0
    left_s: float = 0.0
    is_within_step: bool = False
    events_in_step: int = 0
    due: EventDue | None = None
