"""The events of a log at which a contact model changed the motion, in order, handed out step by step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.agreement import AGREES, Agreement, Discrepancy


@dataclass(frozen=True)
class LoggedEvent:
    """One event of the log.

    Attributes:
        kind: Name of the kind of its records.
        name: ``impact 1``, for people.
        number: Its place among the events of its kind, from 0.
        records: Its records.
        state: Coordinates and rates before, (nq + nv,).
        state_after: The same after.
        efforts: What acts from there on, (nu,).
    """

    kind: str
    name: str
    number: int
    records: tuple[Any, ...]
    state: FloatArray
    state_after: FloatArray
    efforts: FloatArray

    @property
    def time_s(self) -> float:
        """When it happened."""
        return float(self.records[0].time_s)

    @property
    def step(self) -> int:
        """The integration step in which it happened."""
        return int(self.records[0].step)


def _order(event: LoggedEvent) -> tuple[int, float, int]:
    """In time; at one instant as they are numbered."""
    return event.step, event.time_s, int(getattr(event.records[0], "event", 0))


def _in_order(events: Sequence[LoggedEvent]) -> list[LoggedEvent]:
    """Events in the order in which they happened.

    Impacts have numbers of their own: at one instant nothing but the states tells where among the others each of them was.
    """
    out: list[LoggedEvent] = []
    for _, group in groupby(sorted(events, key=_order), key=lambda event: (event.step, event.time_s)):
        at_once = list(group)
        impacts = [event for event in at_once if event.kind == "impact"]
        out += _chained(impacts, [event for event in at_once if event.kind != "impact"])
    return out


def _chained(impacts: Sequence[LoggedEvent], others: Sequence[LoggedEvent]) -> list[LoggedEvent]:
    """Two sequences as one, in which the state after each event is nearest to that before the next.

    Nearest, not the same: drift may be taken out between the two. The sum of all jumps is least, found by dynamic
    programming over how many of each sequence have happened; where sums tie, impacts go first.
    """
    if not impacts or not others:
        return [*impacts, *others]
    sums: dict[tuple[int, int, int], float] = {}
    before: dict[tuple[int, int, int], tuple[int, int, int]] = {}
    counts = len(impacts), len(others)
    for i, j, which in product(range(counts[0] + 1), range(counts[1] + 1), (0, 1)):
        if (i, j)[which]:
            event, rest = (impacts[i - 1], (i - 1, j)) if which == 0 else (others[j - 1], (i, j - 1))
            ways = [(*rest, last) for last in (1, 0) if rest[last]]
            found = [sums[way] + _jump((impacts, others)[way[2]][rest[way[2]] - 1], event) for way in ways]
            sums[i, j, which] = min(found, default=0.0)
            if found:
                before[i, j, which] = ways[found.index(min(found))]
    place: tuple[int, int, int] | None = min(((*counts, last) for last in (1, 0)), key=lambda end: sums[end])
    out = []
    while place is not None:
        out.append((impacts, others)[place[2]][place[place[2]] - 1])
        place = before.get(place)
    return out[::-1]


def _jump(event: LoggedEvent, after: LoggedEvent) -> float:
    """How far the state changes from one event to the next."""
    return float(np.linalg.norm(after.state - event.state_after))


class LoggedEvents:
    """The events of a log.

    Attributes:
        pending: Those not met yet, in order.
    """

    def __init__(
        self, system: System, log: RunLog, step_s: float, found: Agreement, fault_of: Callable[[LoggedEvent], str]
    ) -> None:
        """Read them; one whose state is not of these models, or with a fault of its own, is left out and a difference.

        Args:
            system: The models of the log.
            log: What was read.
            step_s: Integration step.
            found: Takes differences.
            fault_of: What else is wrong with an event, in a word; empty where nothing is.
        """
        self._system, self._step_s, self._found, self._fault_of = system, step_s, found, fault_of
        met = [event for kind in log.event_kinds for event in self._of_kind(kind, log)]
        self.pending = _in_order(met)

    def _of_kind(self, kind: RecordKind, log: RunLog) -> Iterator[LoggedEvent]:
        records = log.records.get(kind.plural, ())
        groups = groupby(enumerate(records), key=lambda pair: getattr(pair[1], "event", pair[0]))
        for number, (_, group) in enumerate(groups):
            event = self._encounter(kind, number, tuple(record for _, record in group))
            fault = self._fault_of(event) if event is not None else "state"
            if event is None or fault:
                self.refuse(f"{kind.name} {number + 1} {fault}", float(records[0].time_s))
            else:
                yield event

    def _encounter(self, kind: RecordKind, number: int, records: tuple[Any, ...]) -> LoggedEvent | None:
        """An event of the log; None where its state is not one of these models."""
        system, first = self._system, records[0]
        joints = [*system.joints.values()]
        try:
            before, after = (
                np.concatenate([np.asarray(qvel[joint.name], dtype=np.float64) for joint in joints])
                for qvel in (first.qvel_before, first.qvel_after)
            )
            efforts = np.array([first.efforts_after[actuator][0] for actuator in system.names("actuator")])
        except LookupError:
            return None
        qpos = np.asarray(first.qpos, dtype=np.float64)
        sizes = (qpos.size, before.size, after.size, efforts.size)
        if sizes != (system.mj.nq, system.mj.nv, system.mj.nv, system.mj.nu):
            return None
        state, state_after = np.concatenate((qpos, before)), np.concatenate((qpos, after))
        if not all(np.isfinite(numbers).all() for numbers in (state, after, efforts)):
            return None
        return LoggedEvent(kind.name, f"{kind.name} {number + 1}", number, records, state, state_after, efforts)

    def refuse(self, what: str, time_s: float) -> None:
        """Note that something of an event is wrong as a whole."""
        self._found.keep(Discrepancy(what, math.inf, AGREES, "", time_s))

    def skip_to(self, step: int) -> None:
        """Leave out what happened before a step: there is no sample to fly from."""
        while self.pending and self.pending[0].step < step:
            self.pending.pop(0)

    def within(self, step: int) -> Iterator[LoggedEvent]:
        """The next events, as far as they happened in this step; one that states another time than its step is refused."""
        start, end, slack = step * self._step_s, (step + 1) * self._step_s, 1e-6 * self._step_s
        while self.pending and self.pending[0].step <= step:
            event = self.pending.pop(0)
            if event.step == step and start - slack <= event.time_s <= end + slack:
                start = event.time_s
                yield event
            else:
                self.refuse(f"{event.name} time_s", event.time_s)

    def compare_state(self, event: LoggedEvent, predicted: FloatArray) -> None:
        """Compare the state before an event with the end of the flight to it."""
        nq = self._system.mj.nq
        for what, part in (("qpos", slice(None, nq)), ("qvel_before", slice(nq, None))):
            self._found.vector(f"{event.name} {what}", event.state[part], predicted[part], predicted[part], "", event.time_s)
