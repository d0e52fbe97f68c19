"""Events of a log, in its order, and their check: the contact model of each reproduces it."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from itertools import groupby
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.interface import EventEffect, EventSource, LoggedEvent
from ffsm_mj.dynamics.rigid_body import with_signs_of
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.model.system import System
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.ties import instant_s
from ffsm_mj.tolerances import EVENT_TIME
from ffsm_mj.verification.agreement import Agreement, impossible, is_text, numbers_of


class LoggedEvents:
    """The events of a log.

    Attributes:
        pending: Events not yet replayed, in order.
        agreement: Collects differences.
    """

    def __init__(
        self,
        system: System,
        log: RunLog,
        step_s: float,
        agreement: Agreement,
        fault_of: Callable[[RecordKind, Sequence[Any]], str],
    ) -> None:
        """Read the events; an event that does not fit the models is omitted and counts as a difference.

        Args:
            system: The system of the log.
            log: The log.
            step_s: Integration step.
            agreement: Collects differences.
            fault_of: Returns why records of one event do not fit the models, in one word; empty if they do.
        """
        self._system, self._step_s, self.agreement, self._fault_of = system, step_s, agreement, fault_of
        self._all = list(self._events_of(log))
        self.pending = list(self._all)

    def _events_of(self, log: RunLog) -> Iterator[LoggedEvent]:
        """The events of a log: adjacent records of one series and number are one event."""
        kinds = {kind.record: kind for kind in log.event_kinds}
        logged = [(kinds[type(record)], i, record) for i, record in enumerate(log.events) if type(record) in kinds]
        counts, goes_on = Counter[str](), logged_start_s(log.header.metadata) > 0.0
        for _, group in groupby(logged, key=lambda item: (item[0].series, getattr(item[2], "event", -1 - item[1]))):
            members = list(group)
            kind, records = members[0][0], tuple(record for *_, record in members)
            series = kind.series or kind.name
            # Events before the start of the log and lost ones have numbers too.
            if (goes_on and series not in counts) or log.lost:
                counts[series] = int(getattr(records[0], "event", counts[series]))
            number, counts[series] = counts[series], counts[series] + 1
            event = self._event_of(kind, number, records)
            fault = self._fault_of(kind, event.records) if event is not None else "state"
            if event is None or fault:
                self.refuse(f"{kind.name} {number + 1} {fault}", float(records[0].time_s))
            else:
                yield event

    def _event_of(self, kind: RecordKind, number: int, records: tuple[Any, ...]) -> LoggedEvent | None:
        """An event of the log; None if its state does not fit the models."""
        system, first = self._system, records[0]
        joints = [*system.joints.values()]
        try:
            before, after = (
                np.concatenate([np.asarray(qvel[joint.name], dtype=np.float64) for joint in joints])
                for qvel in (first.qvel_before, first.qvel_after)
            )
            efforts = np.array([first.efforts_after[actuator][0] for actuator in system.names("actuator")])
        # A log of another model has no such joint or actuator: the event is a difference, not an error.
        except LookupError:
            return None
        qpos = np.asarray(first.qpos, dtype=np.float64)
        sizes = (qpos.size, before.size, after.size, efforts.size)
        # A record of another size would be spread over the wrong joints.
        if sizes != (system.mj.nq, system.mj.nv, system.mj.nv, system.mj.nu):
            return None
        state, state_after = np.concatenate((qpos, before)), np.concatenate((qpos, after))
        # NaN differs from every number, and MuJoCo would reset such a state to that of the model file.
        if not all(np.isfinite(numbers).all() for numbers in (state, after, efforts)):
            return None
        return LoggedEvent(kind.name, f"{kind.name} {number + 1}", number, records, state, state_after, efforts)

    def refuse(self, what: str, time_s: float) -> None:
        """Add an infinite difference: part of an event is invalid as a whole."""
        self.agreement.keep(impossible(what, time_s))

    def before(self, step: int) -> Sequence[LoggedEvent]:
        """All events before a step."""
        return self._all[: bisect_left(self._all, step, key=lambda event: event.step)]

    def skip_to(self, step: int) -> None:
        """Discard events before a step: no logged state precedes them to start from."""
        while self.pending and self.pending[0].step < step:
            self.pending.pop(0)

    def within(self, step: int) -> Iterator[LoggedEvent]:
        """The next events in this step; an event whose time is outside its step is refused."""
        start, end = step * self._step_s, (step + 1) * self._step_s
        # Times of events and multiples of the step are rounded each on their own.
        slack = instant_s(end)
        while self.pending and self.pending[0].step <= step:
            event = self.pending.pop(0)
            if event.step == step and start - slack <= event.time_s <= end + slack:
                # Events within a step are in the order of time: one before the last could not be integrated to.
                start = event.time_s
                yield event
            else:
                self.refuse(f"{event.name} time_s", event.time_s)

    def compare_state(self, event: LoggedEvent, predicted: FloatArray, acceleration: float) -> None:
        """Compare the logged state before an event with the integrated one.

        Args:
            event: The event.
            predicted: The integrated state.
            acceleration: Largest mean acceleration since the state before: velocities are known to that times the rounding
                of times. It counts under a force of 1e9 N, at a contact that runs along an edge.
        """
        logged, again = (np.split(state, [self._system.mj.nq]) for state in (event.state, predicted))
        # q and -q are one rotation: the signs of quaternions may differ without a difference of the state.
        again[0] = with_signs_of(self._system.mj, again[0], logged[0])
        # What is left of the step is rounded as the time of its end is.
        accuracy = 0.0, EVENT_TIME * (event.step + 1) * self._step_s * acceleration
        for what, value, recomputed, least in zip(("qpos", "qvel_before"), logged, again, accuracy, strict=True):
            self.agreement.vector(f"{event.name} {what}", value, recomputed, recomputed, "", event.time_s, least)


class EventCheck:
    """Reproduces logged events, and compares their records with the logged ones.

    Attributes:
        agreement: Collects differences.
    """

    def __init__(self, contact_models: Sequence[EventSource], agreement: Agreement) -> None:
        """Find the contact model of each kind of record; differences are added to ``found``."""
        self.agreement = agreement
        self._models = {kind.name: contact_model for contact_model in contact_models for kind in contact_model.records}

    def fault_of(self, kind: RecordKind, records: Sequence[Any]) -> str:
        """Why the records of one event do not fit the models, in one word; empty if they do."""
        contact_model = self._models[kind.name]
        if not {kind.record for kind in contact_model.records}.issuperset(map(type, records)):
            return "event"  # one number of events of two contact models
        return contact_model.record_fault(records)

    def reproduce(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce the event at the state in ``data``, and compare its records; None if the models do not allow it."""
        effect = self._effect(event)
        # Records of other kinds or numbers have no fields to compare one by one.
        if effect is None or [*map(type, effect.records)] != [*map(type, event.records)]:
            self.agreement.keep(impossible(f"{event.name} records", event.time_s))
            return effect
        for i, (mine, theirs) in enumerate(zip(effect.records, event.records, strict=True)):
            # Time and efforts are inputs of the replay: they are checked where they are used.
            again = replace(mine, time_s=theirs.time_s, efforts_after=theirs.efforts_after)
            accuracy = dict(effect.accuracy) | _spread(mine, [records[i] for records in effect.varied])
            self.agreement.record(event.name, theirs, again, theirs.time_s, accuracy)
        return effect

    def _effect(self, event: LoggedEvent) -> EventEffect | None:
        try:
            return self._models[event.kind].replay(event)
        # What the models refuse cannot have happened in the run: that is the difference, and the replay goes on with the
        # logged state.
        except (RunEnded, UnsupportedContactError, ValueError, ArithmeticError):
            return None


def _spread(record: Any, varied: Sequence[Any]) -> dict[str, float]:
    """How far the numbers of a record change in its variations together, by field."""
    names = [field.name for field in fields(record) if not is_text(getattr(record, field.name))] if varied else []
    numbers = {name: numbers_of(getattr(record, name)) for name in names}
    return {
        name: sum(float(np.abs(numbers_of(getattr(item, name)) - number).max(initial=0.0)) for item in varied)
        for name, number in numbers.items()
    }
