"""Timing of control: commands that reach the actuators late, and control ticks that are late."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.interface import EventEffect, EventSource, EventTime, LoggedEvent, Scene
from ffsm_mj.controller_protocol import Command
from ffsm_mj.records.events import EFFORT_CHANGE, EffortChange
from ffsm_mj.sensing.sensor import NoiseStream
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import SCHEDULED_S

ARRIVAL, LATE_TICK = "command arrives", "late tick"


@dataclass(frozen=True)
class ControlTiming:
    """Delays of a run.

    Attributes:
        delays_s: Time from a command to its arrival at each actuator, s, (nu,).
        jitter_s: Greatest lateness of a control tick, s.
        period_s: Control period, s.
        seed: Seed of the run.
    """

    delays_s: FloatArray
    jitter_s: float
    period_s: float
    seed: int

    @property
    def is_ideal(self) -> bool:
        """Whether every command acts at the control tick at which it is decided."""
        return self.jitter_s == 0.0 and not self.delays_s.any()


class _Arrival(NamedTuple):
    """Part of a command on its way.

    Attributes:
        time_s: When it arrives.
        actuators: Ids of its actuators.
        effort: Their efforts.
        powered: Whether they are powered.
    """

    time_s: float
    actuators: npt.NDArray[np.intp]
    effort: FloatArray
    powered: npt.NDArray[np.bool_]


class DelayedControl(Stateful, EventSource):
    """Lets commands arrive and late control ticks happen at their times, inside steps too.

    An arrival or a tick that coincides with a control tick of the time grid happens there, without an event.
    """

    @dataclass
    class State:
        """Commands under way and the last ones sent, what has arrived, and times, s."""

        under_way: list[Any]
        sent: list[Any]
        effective: Any
        late_tick_s: float
        next_tick_s: float
        clock_s: float

    kind = "delayed control"
    records = (EFFORT_CHANGE,)

    def __init__(self, timing: ControlTiming, scene: Scene, actuation: Actuation) -> None:
        """Nothing is under way.

        Args:
            timing: Delays.
            scene: The logged system and its data.
            actuation: Applies what has arrived.
        """
        super().__init__(scene)
        self._timing, self._actuation = timing, actuation
        delays = timing.delays_s
        self._groups = [(delay, np.flatnonzero(delays == delay)) for delay in sorted(set(delays.tolist()))]
        self._under_way: deque[_Arrival] = deque()
        self._sent: list[_Arrival | None] = [None] * len(self._groups)
        self._effective = Command.off(len(delays))
        actuation.bind(self._effective, scene.data)
        self._lateness = NoiseStream(timing.seed, "control_jitter", 1)
        self._late_tick_s, self._next_tick_s, self._clock_s = math.inf, math.inf, 0.0
        self._replayed: Sequence[EffortChange] = ()

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        super().set_state(state)
        self._under_way = deque(_Arrival(*fields) for fields in self._under_way)
        self._sent = [None if fields is None else _Arrival(*fields) for fields in self._sent]
        self._look_ahead()

    def begin_tick(self, time_s: float, number: int) -> bool:
        """Begin a control tick of the time grid; returns whether the control law is called now, or later by an event."""
        self._clock_s, self._next_tick_s = time_s, time_s + self._timing.period_s
        late_s = self._timing.jitter_s * float(self._lateness.uniform(number)[0]) if self._timing.jitter_s else 0.0
        if late_s < SCHEDULED_S:
            return True
        self._late_tick_s = time_s + late_s
        self._arrive(time_s)
        self._look_ahead()
        return False

    def send(self, command: Command, time_s: float) -> None:
        """Send a command to the actuators, where each part arrives after its delay; what has arrived is applied."""
        self._clock_s = time_s
        for i, (delay_s, actuators) in enumerate(self._groups):
            arrival = _Arrival(time_s + delay_s, actuators, command.effort[actuators], command.powered[actuators])
            if not self._repeats(self._sent[i], arrival):
                self._sent[i] = arrival
                self._under_way.append(arrival)
        self._arrive(time_s)
        self._look_ahead()

    @staticmethod
    def _repeats(last: _Arrival | None, arrival: _Arrival) -> bool:
        """Whether a part of a command says nothing new."""
        if last is None:
            return False
        return np.array_equal(last.effort, arrival.effort) and np.array_equal(last.powered, arrival.powered)

    def _arrive(self, time_s: float) -> None:
        """Apply everything that has arrived at a time, the earliest first."""
        due = [coming for coming in self._under_way if coming.time_s <= time_s + SCHEDULED_S]
        for arrival in sorted(due, key=lambda coming: coming.time_s):
            self._effective.effort[arrival.actuators] = arrival.effort
            self._effective.powered[arrival.actuators] = arrival.powered
        self._under_way = deque(coming for coming in self._under_way if coming.time_s > time_s + SCHEDULED_S)
        self._actuation.apply(self._effective, self.scene.data, time_s)

    def _next_s(self) -> float:
        """Time of the next event before the next tick of the time grid, which needs none."""
        times = [self._late_tick_s, *(arrival.time_s for arrival in self._under_way)]
        return min((time for time in times if time < self._next_tick_s - SCHEDULED_S), default=math.inf)

    def _look_ahead(self) -> None:
        """Ask to be consulted in every step while something is due before the next tick."""
        self.event_bound = 0.0 if math.isfinite(self._next_s()) else math.inf

    def first_event(self, duration_s: float) -> float | None:
        """See :class:`EventSource`: times are known, nothing is searched for."""
        at_s = self._next_s() - self._clock_s
        return max(0.0, min(at_s, duration_s)) if at_s <= duration_s + SCHEDULED_S else None

    def is_clear(self) -> bool:
        """Whether nothing is due before the next tick."""
        return not math.isfinite(self._next_s())

    def after_substep(self, duration_s: float) -> None:
        """Move the clock on."""
        self._clock_s += duration_s

    def act(self, instant: EventTime) -> EventEffect | None:
        """Apply what has arrived, or let the control law be called."""
        time_s = instant.time_s
        self._clock_s = time_s
        late = self._late_tick_s <= time_s + SCHEDULED_S
        if self._replayed:
            late = self._replayed[0].cause == LATE_TICK
        elif late:
            self._late_tick_s = math.inf
        else:
            self._arrive(time_s)
        self._look_ahead()
        data = self.scene.data
        rates = self.scene.system.by_joint(data.qvel)
        record = EffortChange(time_s, instant.step, LATE_TICK if late else ARRIVAL, tuple(data.qpos.tolist()), rates, rates)
        return EventEffect((record,), triggers_control=late, is_tick=late)

    def replay(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce a logged event: its record says what happened, and the efforts are those of the log."""
        self._replayed = event.records
        effect = super().replay(event)
        self._replayed = ()
        return effect


def command_delays_s(
    names: Sequence[str], of_model: Mapping[str, float], default_s: float, stated: Mapping[str, float | None]
) -> FloatArray:
    """Delay of each actuator, s, (nu,): its own in the scenario, that of its model file, or the default of the scenario.

    Args:
        names: Full names of the actuators.
        of_model: Delays in the model files by full name.
        default_s: Default of the scenario.
        stated: Delays in the scenario by full name; None: not given.
    """
    delays = []
    for name in names:
        delay_s = stated.get(name)
        delays.append(delay_s if delay_s is not None else of_model.get(name, default_s))
    return np.array(delays, dtype=np.float64)
