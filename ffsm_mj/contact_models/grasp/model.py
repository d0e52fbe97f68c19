"""Grasp contact model: an armed grasp closes by a plastic impulse and attaches its object to the robot until release.

Requests come from phases and control laws: ``<grasp>.arm``, ``<grasp>.disarm``, ``<grasp>.release``. They are executed at
the start of the next step, a release first. All grasps whose conditions hold at one instant close at it. A grasp of the same
two sites as a closed one takes over from it. The motion with closed grasps is that of
:class:`~ffsm_mj.contact_models.grasp.closing.ClosedGrasps`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing import ClosedGrasps, near_miss
from ffsm_mj.contact_models.grasp.closing_condition import Nearness
from ffsm_mj.contact_models.grasp.config import GraspConfig
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.load import SAMPLED, LoadSampler, load_rows
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.grasp.records import KINDS, ArmingRecord, GraspRecord, ReleaseRecord
from ffsm_mj.contact_models.interface import (
    EventEffect,
    EventSource,
    EventTime,
    ForceSource,
    LoggedEvent,
    Replayable,
    Scene,
    event_fields,
)
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.load_columns import SIGNALS_PER_SET, load_columns
from ffsm_mj.state import entries, get_states, set_states
from ffsm_mj.ties import last_of_first


class LoadReport:
    """Writes the loads of closed grasps into their columns, and reads from them what was closed.

    Attributes:
        columns: The columns.
    """

    def __init__(self, latches: Sequence[Latch], closed: ClosedGrasps) -> None:
        """Bind to the grasps of a run.

        Args:
            latches: All grasps, in the order of the scenario.
            closed: The closed ones.
        """
        sets = load_columns([latch.grasp for latch in latches])
        self._latches, self._closed, self._alone = tuple(latches), closed, len(sets) == 1
        self._samples, self._logged = np.zeros(SAMPLED * len(sets)), np.zeros(len(sets))
        self._samplers = [LoadSampler(values) for values in np.split(self._samples, len(sets))]
        signals = tuple(signal for columns in sets for signal in columns.signals)
        self.columns = Columns(signals, self._samples, self._table, self._take, self._resume, self._at_state, self._at_event)

    def get_state(self) -> list[Any]:
        """The largest loads between rows, by set of columns."""
        return [sampler.get_state() for sampler in self._samplers]

    def set_state(self, state: Any) -> None:
        """Go on with these loads."""
        for sampler, values in zip(self._samplers, state, strict=True):
            sampler.set_state(values)

    def _now(self) -> list[tuple[LoadSampler, int, Latch | None]]:
        """Each set of columns with what is closed of it."""
        if self._alone:
            latch = self._closed.latches[0] if self._closed.latches else None
            return [(self._samplers[0], latch.number if latch is not None else 0, latch)]
        # Grasps of different sites may be closed at once: each has columns, with its place in the order of closing.
        places = [(latch, self._closed.order_of(latch)) for latch in self._latches]
        return [
            (sampler, place, latch if place else None)
            for sampler, (latch, place) in zip(self._samplers, places, strict=True)
        ]

    def after_event(self, time_s: float) -> None:
        """Record the loads after an event, since they may change discontinuously."""
        for sampler, _, latch in self._now():
            if latch is not None:
                # The efforts decided at an event act from there on: a peak right after it lies between two rows.
                sampler.after_event(latch.load, time_s)

    def _take(self, _: float) -> None:
        """Sample what is closed, and loads under the efforts of the next step."""
        for sampler, closed, latch in self._now():
            sampler.take(closed, latch.load if latch is not None else None)

    def _table(self, samples: FloatArray) -> FloatArray:
        return np.concatenate([*map(load_rows, np.split(samples, len(self._samplers), axis=1))], axis=1)

    def _at_state(self) -> FloatArray:
        """Loads under the efforts in ``data``, and zeros in the other columns."""
        values = np.zeros((len(self._samplers), SIGNALS_PER_SET))
        for row, (_, _, latch) in zip(values, self._now(), strict=True):
            if latch is not None:
                row[1:7] = latch.load.now()
        return values.reshape(-1)

    def _at_event(self) -> FloatArray:
        """Sizes of these loads in the columns of loads after events, and zeros in the others."""
        values = self._at_state().reshape(-1, SIGNALS_PER_SET)
        sizes = np.linalg.norm(values[:, 1:7].reshape(-1, 2, 3), axis=2)
        values[:, :-3] = 0.0
        values[:, -3:-1] = sizes
        return values.reshape(-1)

    def _resume(self, values: FloatArray) -> None:
        for i, sampler in enumerate(self._samplers):
            part = values[i * SIGNALS_PER_SET : (i + 1) * SIGNALS_PER_SET]
            self._logged[i] = part[0]
            force, torque, at_s = part[-3:].tolist()
            sampler.between = force, torque, at_s if force > 0.0 else math.nan

    def logged_as_closed(self) -> list[Latch]:
        """The grasps that were closed by the values from which a run or a replay goes on, in the order of closing."""
        if self._alone:
            number = float(self._logged[0])
            return [self._latches[int(number) - 1]] if 1.0 <= number <= len(self._latches) else []
        places = [(place, latch) for place, latch in zip(self._logged.tolist(), self._latches, strict=True) if place >= 1.0]
        return [latch for _, latch in sorted(places, key=lambda entry: entry[0])]


ARM, DISARM, RELEASE = "arm", "disarm", "release"
"""Requests of a grasp, after its name and a dot."""


class GraspModel(EventSource, Replayable):
    """All grasps of a run. See :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    kind = "grasp"
    records = KINDS

    def __init__(
        self,
        scene: Scene,
        free: Motion,
        grasps: Sequence[tuple[Grasp, GraspConfig, System | None]],
        loops: LoopForces,
        others: Sequence[ForceSource] = (),
    ) -> None:
        """Initialise with all grasps disarmed and open.

        Args:
            scene: The logged system and its data.
            free: Its motion.
            grasps: Each grasp with its configuration, and the system in which its object is a child of the link, with a
                model owned by the run; None for one that rows alone hold: between two objects, or of a moving link.
            loops: Rows of further grasps.
            others: Other contact models that may exert forces on a grasped object.
        """
        super().__init__(scene)
        forces = (loops, *others)
        self._latches = {pair[0].name: Latch(i, scene, free, *pair, loops, forces) for i, pair in enumerate(grasps, start=1)}
        self._closed = ClosedGrasps(scene, free, loops)
        self._step_s = float(scene.system.mj.opt.timestep)
        self._closing: list[Latch] = []
        self._goes_on = False
        self._opening: Latch | None = None
        self._requests: set[str] = set()
        self.requests = tuple(f"{name}.{what}" for name in self._latches for what in (ARM, DISARM, RELEASE))
        self._report = LoadReport([*self._latches.values()], self._closed)
        self.columns = (self._report.columns,)

    @dataclass
    class State:
        """What each grasp remembers, which are closed, what is about to happen, and loads between rows."""

        latches: dict[str, Any]
        closed: Any
        closing: list[str]
        goes_on: bool
        opening: str | None
        requests: set[str]
        report: list[Any]

    def get_state(self) -> State:
        """What the grasps remember."""
        return self.State(
            get_states(self._latches),
            self._closed.get_state(),
            [latch.grasp.name for latch in self._closing],
            self._goes_on,
            self._opening.grasp.name if self._opening is not None else None,
            set(self._requests),
            self._report.get_state(),
        )

    def set_state(self, state: Any) -> None:
        """Go on from a state; the motion is that of :meth:`current_motion`."""
        values = entries(state, self.State)
        set_states(self._latches, values["latches"], "GraspModel")
        self._closed.set_state(values["closed"], self._latches)
        self._closing, self._goes_on = [self._latches[name] for name in values["closing"]], values["goes_on"]
        self._opening = None if values["opening"] is None else self._latches[values["opening"]]
        self._requests = set(values["requests"])
        self._report.set_state(values["report"])

    def current_motion(self) -> Motion:
        """The motion with the closed grasps."""
        return self._closed.motion

    def forget(self) -> None:
        """All grasps are disarmed, and nothing is about to happen."""
        for latch in self._latches.values():
            latch.disarm()
        self._closing, self._opening, self._goes_on = [], None, False
        self._requests.clear()

    @property
    def disarmed(self) -> dict[str, frozenset[frozenset[int]]]:
        """Pairs of geoms that are on one rigid body while a grasp alone is closed, by grasp name."""
        return {
            name: latch.grasped_motion.disabled for name, latch in self._latches.items() if latch.grasped_motion is not None
        }

    def data_of(self, grasp: str) -> Any:
        """MuJoCo data of the motion while a grasp of the robot is the first closed one."""
        grasped_motion = self._latches[grasp].grasped_motion
        assert grasped_motion is not None
        return grasped_motion.data

    def names(self) -> str:
        """The grasps that are armed or closed."""
        return (
            ", ".join(name for name, latch in self._latches.items() if latch.armed or latch in self._closed.latches)
            or self.kind
        )

    def handle_request(self, request: str) -> None:
        """Store a request of a phase or control law; it is executed at the start of the next step."""
        self._requests.add(request)
        self._update_watched()

    def on_records(self, records: Sequence[Any]) -> None:
        """An impact of one of its pairs closes an armed grasp."""
        hit = {name for record in records if isinstance(record, ImpactRecord) for name in (record.pair, record.rule)}
        if hit:
            # The impact is resolved first, so that the grasp closes at the velocities after it: two impulses at one instant.
            hit_by = [latch for latch in self._latches.values() if latch.armed and latch.contacts & hit]
            self._closing = _one_per_sites([*self._closing, *hit_by])

    def restart(self) -> None:
        """Discard the tracked path."""
        for latch in self._latches.values():
            latch.clear_path()
        self._update_watched()

    def _update_watched(self) -> None:
        self._watching = [latch for latch in self._latches.values() if latch.watches]
        self._limited = [latch for latch in self._closed.latches if latch.limit is not None]
        watches = self._requests or self._closing or self._opening or self._watching or self._limited
        # The motion bound limits distances, not speeds or loads: while one of these is watched, every step is looked at.
        self.event_bound = -math.inf if watches else math.inf

    def due(self) -> bool:
        """Whether a request is pending, an impact closes a grasp, or the bounds of an armed grasp are satisfied."""
        # These are due whatever the state is. Bounds and loads are evaluated only where nothing else is.
        if self._requests or self._closing:
            return True
        self._opening = self._overloaded()
        self._closing = self._within()
        return bool(self._closing) or self._opening is not None

    def _within(self) -> list[Latch]:
        """The armed grasps whose bounds hold at the state in ``data``, at the start of a step."""
        return _one_per_sites([latch for latch in self._watching if latch.is_within()])

    def _overloaded(self) -> Latch | None:
        """A closed grasp whose load limit is reached at the state in ``data``, at the start of a step."""
        reached = [latch for latch in self._limited if latch.limit is not None and latch.limit.is_reached()]
        # One opens at a time: the loads of the others change with it, and are asked for again at the same instant.
        return reached[0] if reached else None

    def is_clear(self) -> bool:
        """Whether the last step is taken to close no armed grasp and to reach no load limit; see the latches."""
        clear = [latch.was_clear(self._step_s) for latch in self._watching]  # every latch must record the end of the step
        return all(clear + [latch.limit.was_clear() for latch in self._limited if latch.limit is not None])

    def first_event(self, duration_s: float) -> float | None:
        """First time at which the bounds of an armed grasp are satisfied, or the load limit of a closed one is reached."""
        path = self.motion.path
        closing = [(latch.first(path, duration_s), latch) for latch in self._watching]
        opening = [(latch.limit.first(path, duration_s), latch) for latch in self._limited if latch.limit is not None]
        # Which of them act is decided at the time of the event, which may be earlier.
        self._closing = [latch for at, latch in closing if at is not None]
        self._opening = next((latch for at, latch in opening if at is not None), None)
        times_s = [at for at, _ in (*closing, *opening) if at is not None]
        # Of roots within one instant the last: there the conditions of all of them hold, and they act as one event.
        return last_of_first(times_s, float(path.start[0])) if times_s else None

    def after_substep(self, duration_s: float) -> None:
        """Update the closest approach of each armed grasp, for the near-miss record."""
        for latch in self._watching:
            latch.after_substep(self.motion.path, duration_s)

    def on_event_located(self, _: float) -> None:
        """Keep what closes or opens only if its condition holds here: an event of another model may have come first."""
        self._opening = self._overloaded() if self._opening is not None else None
        self._closing = self._within() if self._closing else []

    def act(self, instant: EventTime) -> EventEffect | None:
        """Execute the pending requests, open a grasp at its load limit, or close one.

        Raises:
            RunEnded: A load limit cannot be applied.
        """
        # All that close at one instant do so before the requests that the first of them leads to: no order is preferred.
        if self._closing and (self._goes_on or not (self._requests or self._opening)):
            return self._close(instant)
        if not self._requests:
            return self._break(self._opening, instant) if self._opening is not None else None
        # A release comes before its load limit at the same instant: the object is not let go twice.
        asked, self._requests, self._opening = self._requests, set(), None
        records: list[Any] = []
        accuracy: dict[str, float] = {}
        # Releases first: sites that are let go may be armed again by the same decision.
        for latch in [closed for closed in self._closed.latches if f"{closed.grasp.name}.{RELEASE}" in asked]:
            records.append(self._closed.open(latch, instant))
        released = bool(records)
        for name, latch in self._latches.items():
            if f"{name}.{DISARM}" in asked and latch.armed:
                records += self._disarm(latch, instant)
                for field, spread in latch.closest.accuracy().items() if latch.closest is not None else ():
                    accuracy[field] = max(spread, accuracy.get(field, 0.0))
            # A closed grasp cannot close again, and arming an armed one would lose its closest approach.
            if f"{name}.{ARM}" in asked and not (latch.armed or latch in self._closed.latches):
                records.append(self._arm(latch, instant))
        motion = self._closed.motion if released else None
        # Arming changes nothing in the motion: a law need not be evaluated again.
        effect = EventEffect(tuple(records), motion=motion, triggers_control=released, accuracy=accuracy)
        return effect if records else None

    def _arm(self, latch: Latch, instant: EventTime) -> ArmingRecord:
        latch.arm(instant.time_s)
        return ArmingRecord(grasp=latch.grasp.name, **event_fields(self.scene, instant, self.scene.data.qvel))

    def finish(self, instant: EventTime) -> Sequence[Any]:
        """Disarm all grasps at the end of the run; those still armed produce near-miss records."""
        return [record for latch in self._latches.values() if latch.armed for record in self._disarm(latch, instant)]

    def _close(self, instant: EventTime) -> EventEffect:
        """Close the next of the grasps that close at this instant."""
        latch, *self._closing = self._closing
        # Until all of this instant are closed, requests wait: else the order of names would decide what closes.
        self._goes_on = bool(self._closing)
        latch.disarm()
        return self._closed.close(latch, instant)

    def _break(self, latch: Latch, instant: EventTime) -> EventEffect:
        """Open a grasp at its load limit."""
        self._opening, self._closing = None, []
        load, accuracy = latch.limit.load() if latch.limit is not None else (0.0, 0.0), latch.load_accuracy()
        record = self._closed.open(latch, instant, "load_limit", *load)
        return EventEffect((record,), motion=self._closed.motion, accuracy=accuracy)

    def _disarm(self, latch: Latch, instant: EventTime) -> list[Any]:
        """Disarm the latch; record a near miss if it was armed with bounds and never closed."""
        latch.disarm()
        # One that is disarmed must not close, even if its condition was met at this instant.
        self._closing = [other for other in self._closing if other is not latch]
        closest = latch.end_approach()
        missed = near_miss(self.scene, latch.grasp.name, closest, instant) if closest is not None else None
        return [] if missed is None else [missed]

    def after_event(self, time_s: float) -> None:
        """Record the loads on grasped objects after an event, since they may change discontinuously."""
        self._report.after_event(time_s)

    def restore_state(self, events: Sequence[LoggedEvent] = ()) -> None:
        """Restore the closed grasps from the columns, at the state in ``data``; armed grasps are not logged in columns."""
        # Arming is not in the columns: the events of the log arm the grasps again.
        self.forget()
        records = [record for event in events for record in event.records if isinstance(record, GraspRecord)]
        self._closed.restore(self._report.logged_as_closed(), records)

    def replay(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce a logged event: its records say what is due.

        Raises:
            ValueError: A record names an unknown grasp.
        """
        self._take_as_due(event.records)
        return super().replay(event)

    def _take_as_due(self, records: Sequence[Any]) -> None:
        # The replay may begin in the middle of a log: numbers of events must be those of the run.
        self.scene.numbers.continue_from(records[0].event)
        self._closing, self._goes_on = [], False
        for record in records:
            # Records come from a file: an unknown name must not end the analysis without a word.
            if record.grasp not in self._latches:
                raise ValueError(f"no grasp {record.grasp!r}")
            latch = self._latches[record.grasp]
            if isinstance(record, GraspRecord):
                self._closing.append(latch)
            elif isinstance(record, ReleaseRecord) and record.reason != "request":
                self._opening = latch
            elif isinstance(record, ReleaseRecord):
                self._requests.add(f"{record.grasp}.{RELEASE}")
            elif isinstance(record, ArmingRecord):
                latch.disarm()  # one that waits for a touch was disarmed without a record
                self._requests.add(f"{record.grasp}.{ARM}")
            else:
                # The part of the log in which it was armed may be lost: the closest approach is then taken from the record.
                if not latch.armed:
                    latch.arm(record.least_s)
                if latch.closest is not None and latch.closest.first() is None:
                    near = Nearness(record.position_m, record.angle_rad, record.speed_m_s, record.rate_rad_s)
                    latch.closest.assume(near, record.least_s)
                self._requests.add(f"{record.grasp}.{DISARM}")


def _one_per_sites(latches: Sequence[Latch]) -> list[Latch]:
    """The first of those that join the same two sites, each once."""
    first: list[Latch] = []
    for latch in latches:
        if not any(latch.grasp.joins_sites_of(other.grasp) for other in first):
            first.append(latch)
    return first
