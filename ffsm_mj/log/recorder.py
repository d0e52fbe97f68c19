"""Recorder: collects rows in blocks and passes them and events to sinks; sinks that keep a run in memory, and its events."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from types import TracebackType

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.run_log import Rows, RunHeader, RunLog
from ffsm_mj.records.signals import TIME, Layout

RECORDED_ROWS = 1000
"""Number of rows in a full block."""
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
        complete: Callable[[FloatArray], FloatArray] | None,
        *,
        by_clock: bool = True,
    ) -> None:
        """Start with an empty block.

        Args:
            block: Array that the caller fills with rows, (lines, width).
            sinks: Destinations of rows and events.
            complete: Makes the rows of a block, just before they are passed on; None: the sinks do so themselves.
            by_clock: Flush at least once per wall second; otherwise whenever the block is full, so that the bytes of a log
                do not depend on the speed of the machine.
        """
        self._sinks, self._complete = tuple(sinks), complete
        self._block, self.line, self.lines = block, 0, len(block)
        self._by_clock, self.next_flush_s = by_clock, time.monotonic() + _FLUSH_PERIOD_S if by_clock else math.inf
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
        if time.monotonic() >= self.next_flush_s:
            self.flush()

    def event(self, *records: Event) -> None:
        """Pass on all rows so far and then all records of an event, and flush: a log that breaks off has all or none."""
        self.pass_on()
        for record in records:
            for sink in self._sinks:
                sink.event(record)
        self.flush()

    def state(self, time_s: float, state: bytes) -> None:
        """Pass on all rows so far and then the state of the simulation at a time, s."""
        self.pass_on()
        for sink in self._sinks:
            sink.state(time_s, state)

    def flush(self) -> None:
        """Pass on all rows so far and flush every sink."""
        self.pass_on()
        for sink in self._sinks:
            sink.flush()
        if self._by_clock:
            self.next_flush_s = time.monotonic() + _FLUSH_PERIOD_S

    def pass_on(self) -> None:
        """Pass the rows so far to every sink."""
        block, self.line = self._block[: self.line], 0
        if len(block):
            rows = self._complete(block) if self._complete is not None else block
            for sink in self._sinks:
                sink.rows(rows)

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


class Batches(Sink):
    """Passes rows on in full blocks, and each event at once: for sinks that sum over rows at a cost per block.

    These have to take an event before the rows that precede it.
    """

    def __init__(self, sinks: Sequence[Sink]) -> None:
        """Start without rows."""
        self._sinks, self._waiting = tuple(sinks), list[FloatArray]()

    def open(self, header: RunHeader) -> None:
        """Open every sink."""
        for sink in self._sinks:
            sink.open(header)

    def rows(self, block: FloatArray) -> None:
        """Keep a copy of a block, and pass on what fills one."""
        self._waiting.append(block.copy())
        if sum(map(len, self._waiting)) >= RECORDED_ROWS:
            self._pass_on()

    def event(self, event: Event) -> None:
        """Pass on an event."""
        for sink in self._sinks:
            sink.event(event)

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Pass on the rest."""
        if self._waiting:
            self._pass_on()
        for sink in self._sinks:
            sink.close(outcome)

    def _pass_on(self) -> None:
        block, self._waiting = np.concatenate(self._waiting), []
        for sink in self._sinks:
            sink.rows(block)


@dataclass
class MemorySink(Sink):
    """Keeps all events, and optionally the rows.

    Attributes:
        keep_rows: Whether rows are kept.
        columns: Keys of the columns to keep, in addition to the time; None: all.
        complete: Makes rows of the blocks that are passed, when they are asked for; None: they are rows.
    """

    keep_rows: bool = True
    columns: Collection[str] | None = None
    complete: Callable[[FloatArray], FloatArray] | None = None
    header: RunHeader | None = None
    blocks: list[FloatArray] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outcome: OutcomeRecord | None = None
    _places: IntArray | slice = field(init=False)

    def open(self, header: RunHeader) -> None:
        """Begin a run."""
        self.header, self._places = header, slice(None)
        if self.columns is not None:
            kept = [signal for signal in header.layout.signals if signal.key in self.columns or signal.key == TIME]
            self.header = replace(header, layout=Layout(tuple(kept)))
            self._places = header.layout.places(self.header.layout.keys)

    def rows(self, block: FloatArray) -> None:
        """Keep a copy of a block."""
        if self.keep_rows:
            self.blocks.append((block[:, self._places] if self.complete is None else block).copy())

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
            rows = np.concatenate(self.blocks) if self.blocks else np.empty((0, len(self.header.layout.signals)))
            if self.blocks and self.complete is not None:
                rows = self.complete(rows)[:, self._places]
        return RunLog(self.header, rows, tuple(self.events), self.outcome)


class EventTap(Sink):
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
