"""Settings of a simulation, and how far it has come: everything that the loop itself remembers between two steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from ffsm_mj.controller_protocol import Observation
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.kinds import kind_named, kind_of
from ffsm_mj.state import StateError, Stateful


@dataclass(frozen=True)
class Settings:
    """Time grid of a run, and what the control law is told; see the scenario keys of the same names.

    Attributes:
        time_step_s: Integration step, s.
        steps_per_tick: Steps in a control period.
        ticks: Control periods in the run.
        feedback_impulse_N_s: Least impulse of the impacts that are reported to the control law; -inf: all contact events
            are; None: none.
        keeps_states: Whether the log gets the state of the simulation at events.
    """

    time_step_s: float
    steps_per_tick: int
    ticks: int
    feedback_impulse_N_s: float | None = -math.inf
    keeps_states: bool = False


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

    @dataclass
    class State:
        """An event at which a run goes on: its records, and how it is reported to the controller."""

        records: list[Any]
        triggers_control: bool
        at_tick: bool

    def get_state(self) -> State:
        """What it is; its observation follows from the state of the plant."""
        return self.State(records_as_state(self.records), self.triggers_control, self.observation.at_tick)


@dataclass
class Progress(Stateful):
    """Position on the time grid: its own state.

    Attributes:
        time_s: Simulation time, s.
        steps: Integration steps completed.
        ticks: Control ticks of the time grid begun.
        evaluations: Evaluations of the controller.
        left_s: Time left of the integration step under way, s.
        is_within_step: Whether an integration step is under way: an event in it is the latest thing that happened.
        events_in_step: Events in the integration step under way.
    """

    time_s: float = 0.0
    steps: int = 0
    ticks: int = 0
    evaluations: int = 0
    left_s: float = 0.0
    is_within_step: bool = False
    events_in_step: int = 0


Progress.State = Progress


@dataclass(frozen=True)
class Start:
    """State from which a run goes on.

    Attributes:
        time_s: Its time, s.
        state: The state of a simulation of the same parts.
        new_laws: The control law of the phase is another one than that which came there: it begins at this state.
        replaced: Phases, by position, whose control laws are of another kind: ``state`` has nothing of them.
    """

    time_s: float
    state: Any
    new_laws: bool
    replaced: tuple[int, ...] = ()


def records_as_state(records: Sequence[Any]) -> list[Any]:
    """Event records in a state: their kinds and fields by name."""
    return [
        {"kind": kind_of(record).name, "fields": {field.name: getattr(record, field.name) for field in fields(record)}}
        for record in records
    ]


def records_of_state(saved: Sequence[Any]) -> tuple[Any, ...]:
    """Event records from a state.

    Raises:
        StateError: They are none.
    """
    try:
        return tuple(kind_named(record["kind"]).record(**record["fields"]) for record in saved)
    except (KeyError, TypeError) as error:
        raise StateError(f"records of events in a state: {error}") from error
