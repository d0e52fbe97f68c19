"""Recorder: collects rows in blocks and passes them and events to sinks; sinks that keep a run in memory, and its events."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from operator import methodcaller
from types import TracebackType

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.run_log import Rows, RunHeader, RunLog
from ffsm_mj.records.signals import TIME, Layout

RECORDED_ROWS = 1000
"""Number of rows in a full block."""
_SPARE_ROWS = 50
"""Rows that a run in real time passes on when it has time."""
_STEP_S, _SAFETY, _FORGOTTEN = 5e-4, 1.3, 0.8
"""First guess of how long a step of that takes, s; the guess by how long one took, and by the guess before."""
_FLUSH_PERIOD_S = 1.0


class Sink:
    """Destination of a run; what a sink does not override does nothing.

    Order of calls: ``open``, then ``rows``, ``event`` and ``state`` in order of time, then ``close``.
    """

    def open(self, header: RunHeader) -> None:
        """Start a run."""

    def rows(self, block: FloatArray) -> None:
        """Take rows, (n, number of signals); the caller reuses the array afterwards."""

    def event(self, event: Event) -> None:
        """Take an event; all earlier rows have been passed."""

    def state(self, time_s: float, state: bytes) -> None:
        """Take a state of the simulation at a time, s; all earlier rows and events have been passed."""

    def flush(self) -> None:
        """Write everything so far, such that it survives a kill."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """End the run; ``outcome`` is None if it is unknown (an error outside the simulation)."""


class Recorder:
    """Passes rows and events to sinks. A context manager: leaving it closes every sink.

    Attributes:
        line: Index of the row of the block to fill next, before :meth:`commit`.
        lines: Number of rows of a full block.
        next_flush_s: Monotonic time from which :meth:`commit` flushes, s.
    """

    def __init__(
        self,
        block: FloatArray,
        sinks: Sequence[Sink],
        complete: Callable[[FloatArray], None],
        tap: Callable[[Event], None] | None = None,
        *,
        by_clock: bool = True,
        paced: bool = False,
    ) -> None:
        """Start with an empty block.

        Args:
            block: Array that the caller fills with rows, (lines, number of signals).
            sinks: Destinations of rows and events.
            complete: Computes the columns that are evaluated for a whole block, just before the block is passed on.
            tap: Called with each event at once.
            by_clock: Flush at least once per wall second; otherwise whenever the block is full, so that the bytes of a log
                do not depend on the speed of the machine.
            paced: Rows and events wait until there is time for them, see :meth:`use`; those of a full block do not.
        """
        self._sinks, self._complete, self._tap = tuple(sinks), complete, tap
        self._block, self.line, self.lines = block, 0, len(block)
        self._by_clock, self.next_flush_s = by_clock, time.monotonic() + _FLUSH_PERIOD_S if by_clock else math.inf
        self._paced, self._step_s = paced, _STEP_S
        self._events: list[tuple[int, Event]] = []
        self._ready: deque[Callable[[Sink], None]] = deque()
        self.outcome: OutcomeRecord | None = None

    def open(self, header: RunHeader) -> None:
        """Open every sink."""
        for sink in self._sinks:
            sink.open(header)

    def commit(self) -> None:
        """Mark the current row as complete."""
        self.line += 1
        if self.line == self.lines:
            self.pass_on()
            if not self._by_clock:
                self.flush()
        if not self._paced and time.monotonic() >= self.next_flush_s:
            self.flush()

    def event(self, *records: Event) -> None:
        """Pass on all rows so far and then all records of an event, and flush: a log that breaks off has all or none."""
        for record in records:
            if self._tap is not None:
                self._tap(record)
            self._events.append((self.line, record))
        if not self._paced:
            self.flush()

    def use(self, left_s: float) -> None:
        """Take a step of passing on what waits, if that is expected to take less than some wall time, s."""
        act: Callable[[], None]
        overdue_s = time.monotonic() - self.next_flush_s
        if overdue_s > _FLUSH_PERIOD_S:
            self.flush()  # a run that never has time has a log, too
            return
        if self._ready:
            act = self._pass_on_first
        elif self._events or overdue_s >= 0.0:
            act = self._make_all_ready
        elif self.line >= _SPARE_ROWS:
            act = self._make_ready
        else:
            return
        if left_s < self._step_s:
            self._step_s *= _FORGOTTEN
            return
        started = time.perf_counter()
        act()
        self._step_s = max(_SAFETY * (time.perf_counter() - started), _FORGOTTEN * self._step_s)

    def state(self, time_s: float, state: bytes) -> None:
        """Pass on all rows so far and then the state of the simulation at a time, s."""
        self.pass_on()
        for sink in self._sinks:
            sink.state(time_s, state)

    def flush(self) -> None:
        """Pass on all rows so far and flush every sink."""
        self._make_all_ready()
        self.pass_on()

    def pass_on(self) -> None:
        """Pass the rows so far to every sink."""
        self._make_ready()
        try:
            while self._ready:
                self._pass_on_first()
        finally:
            self._ready.clear()  # of a sink that has failed: the rows are overwritten

    def _make_all_ready(self) -> None:
        self._make_ready()
        self._ready.append(methodcaller("flush"))
        if self._by_clock:
            self.next_flush_s = time.monotonic() + _FLUSH_PERIOD_S

    def _make_ready(self) -> None:
        """Complete the rows so far: they and the events are ready for the sinks, in their order."""
        block, self.line = self._block[: self.line], 0
        events, self._events = self._events, []
        if len(block):
            self._complete(block)
        if self._paced:
            block = block.copy()  # the next rows come before these are passed on
        first = 0
        for line, event in (*events, (len(block), None)):
            if line > first:
                self._ready.append(methodcaller("rows", block[first:line]))
            if event is not None:
                self._ready.append(methodcaller("event", event))
            first = line

    def _pass_on_first(self) -> None:
        pass_on = self._ready.popleft()
        for sink in self._sinks:
            pass_on(sink)

    def __enter__(self) -> Recorder:
        """Return the recorder itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close every sink, even if an earlier one fails; the first failure is raised."""
        failures: list[Exception] = []
        try:
            self.pass_on()
        except Exception as failure:  # noqa: BLE001 (raised below, after every sink is closed)
            failures.append(failure)
        failures += close_all(self._sinks, self.outcome)
        if failures and error is None:
            raise failures[0]


def close_all(sinks: Iterable[Sink], outcome: OutcomeRecord | None) -> list[Exception]:
    """Close every sink, even if an earlier one fails; returns what failed."""
    failures = []
    for sink in sinks:
        try:
            sink.close(outcome)
        except Exception as failure:  # noqa: BLE001 (of the caller, when every sink is closed)
            failures.append(failure)
    return failures


@dataclass
class MemorySink(Sink):
    """Keeps all events, and optionally the rows.

    Attributes:
        keep_rows: Whether rows are kept.
        columns: Keys of the columns to keep, in addition to the time; None: all.
    """

    keep_rows: bool = True
    columns: Collection[str] | None = None
    header: RunHeader | None = None
    blocks: list[FloatArray] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outcome: OutcomeRecord | None = None
    _places: IntArray | None = None

    def open(self, header: RunHeader) -> None:
        """Begin a run."""
        self.header, self._places = header, None
        if self.columns is not None:
            kept = [signal for signal in header.layout.signals if signal.key in self.columns or signal.key == TIME]
            self.header = replace(header, layout=Layout(tuple(kept)))
            self._places = header.layout.places(self.header.layout.keys)

    def rows(self, block: FloatArray) -> None:
        """Keep a copy of a block."""
        if self.keep_rows:
            self.blocks.append(block.copy() if self._places is None else block[:, self._places])

    def event(self, event: Event) -> None:
        """Keep an event."""
        self.events.append(event)

    def close(self, outcome: OutcomeRecord | None) -> None:
        """End the run."""
        self.outcome = outcome

    def log(self, rows: Rows | None = None) -> RunLog:
        """The run so far.

        Args:
            rows: Its rows, if the sink does not keep them.

        Raises:
            ValueError: The sink was never opened.
        """
        if self.header is None:
            raise ValueError("no run was recorded")
        if rows is None:
            rows = np.concatenate((np.empty((0, len(self.header.layout.signals))), *self.blocks))
        return RunLog(self.header, rows, tuple(self.events), self.outcome)


class EventTap:
    """Keeps events until they are taken."""

    def __init__(self) -> None:
        """Start without events."""
        self._events: list[Event] = []

    def take(self) -> tuple[Event, ...]:
        """Events since the last call, in the order of the log."""
        if not self._events:
            return ()
        events, self._events = tuple(self._events), []
        return events

    def event(self, event: Event) -> None:
        """Keep an event."""
        self._events.append(event)
