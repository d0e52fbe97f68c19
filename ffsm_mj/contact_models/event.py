"""Events of contact models: their scene, time, effect, and what a log says of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.system import System
from ffsm_mj.records.events import RunEnded
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S


class EventCounter(Stateful):
    """Counter shared by the contact models of a run: it orders events that happen at the same time."""

    @dataclass
    class State:
        """Number of the next event; None: unknown."""

        next: int | None

    def __init__(self) -> None:
        """Start at 0."""
        self._next: int | None = 0

    def next_number(self) -> int:
        """Return the number of the next event, and advance the counter."""
        number = self._next or 0
        self._next = number + 1
        return number

    def mark_unknown(self) -> None:
        """Mark the count as unknown: a log replay continues after a gap in the log, which may have contained events."""
        self._next = None

    def continue_from(self, number: int) -> None:
        """Continue from the number of a logged event if the count is unknown; else do nothing."""
        if self._next is None:
            self._next = number


@dataclass(frozen=True)
class Scene:
    """The logged system and its data, which every motion keeps current; what a contact model is constructed with."""

    system: System
    data: Any
    numbers: EventCounter = field(default_factory=EventCounter)
    """Event numbers of persistent contacts and grasps."""


class EventTime(NamedTuple):
    """Simulation time of an event in s, and the index of the integration step that contains it, from 0."""

    time_s: float
    step: int


@dataclass(frozen=True)
class LoggedEvent:
    """One event of a log.

    Attributes:
        kind: Name of the kind of its records.
        name: Name for messages, such as ``impact 1``.
        number: Its number among the events of its kind, from 0.
        records: Its records.
        state: Coordinates and rates before, (nq + nv,).
        state_after: Coordinates and rates after, (nq + nv,).
        efforts: Efforts after the event, (nu,).
        in_step: Whether it was located in a step; others are due before one, at a tick or right after another event.
    """

    kind: str
    name: str
    number: int
    records: tuple[Any, ...]
    state: FloatArray
    state_after: FloatArray
    efforts: FloatArray
    in_step: bool = False

    @property
    def time_s(self) -> float:
        """Time of the event."""
        return float(self.records[0].time_s)

    @property
    def step(self) -> int:
        """Index of its integration step."""
        return int(self.records[0].step)


class EventEffect(NamedTuple):
    """The effect of an event.

    Attributes:
        records: Event records for the log, the controller and the phases.
        exchange: Energy and momentum exchanged, to be entered in the balance; None if nothing was exchanged.
        motion: The motion to integrate from now on; None if it does not change.
        end: How the run ends at this event; None if it continues. The controller is evaluated once more only if the run
            completes.
        triggers_control: Whether the controller is evaluated immediately; else it receives the records at its next tick.
        leaves_to_impacts: Whether nothing was done because pairs touch, which the model that resolves impacts handles.
        accuracy: How well the state determines fields of the records that it determines worse than to rounding, by name.
        is_tick: Whether the controller is evaluated as at a control tick, only later.
        varied: In a log replay, the records as rounding of the state may change them, each time in another way.
    """

    records: tuple[Any, ...]
    exchange: Exchange | None = None
    motion: Motion | None = None
    end: RunEnded | None = None
    triggers_control: bool = True
    leaves_to_impacts: bool = False
    accuracy: Mapping[str, float] = MappingProxyType({})
    is_tick: bool = False
    varied: Sequence[tuple[Any, ...]] = ()


def event_fields(scene: Scene, instant: EventTime, before: FloatArray, number: int | None = None) -> dict[str, Any]:
    """Fields that records of persistent contacts, grasps and dry friction share; the state after is that in ``data``.

    Args:
        scene: The logged system and its data.
        instant: Time and step of the event.
        before: Generalised velocity before the event, (nv,).
        number: Number of the event; None: the next one.
    """
    system, data = scene.system, scene.data
    return {
        "event": scene.numbers.next_number() if number is None else number,
        "time_s": instant.time_s,
        "step": instant.step,
        "qpos": tuple(data.qpos.tolist()),
        "qvel_before": system.by_joint(before),
        "qvel_after": system.by_joint(data.qvel),
    }


def just_after(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """First time between two times at which a function becomes negative, rounded up until it is negative there.

    A log replay evaluates the same state with slightly different rounding: it must reach the same decision.

    Args:
        f: The function; positive at the first time and negative at the second.
        start_s: First time, s.
        end_s: Second time, s.
    """
    from scipy.optimize import brentq  # takes a second to import: only runs with such events pay

    root, late = float(brentq(f, start_s, end_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME)), EVENT_TIME_S
    while True:
        root, late = min(root + late, end_s), 2.0 * late
        if root >= end_s or f(root) < 0.0:
            return root
