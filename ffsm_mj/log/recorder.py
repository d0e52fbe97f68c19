"""Rows into blocks, blocks to the sinks; flushed at every event and at least once per wall second."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Protocol

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader

BLOCK_ROWS = 1000
"""Rows that are passed on together."""
_FLUSH_PERIOD_S = 1.0


class Sink(Protocol):
    """A destination. Calls come in order: ``open``, then ``rows`` and ``event`` as they happen, then ``close``."""

    def open(self, header: RunHeader) -> None:
        """Begin a run."""

    def rows(self, block: FloatArray) -> None:
        """Take rows, (n, number of signals); the array is reused afterwards."""

    def event(self, event: Event) -> None:
        """Take an event; all earlier rows have been handed over."""

    def flush(self) -> None:
        """Make everything taken so far survive a kill."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """End the run; ``None`` when its end is not known (an error outside the simulation)."""


class Recorder:
    """Passes full blocks of rows on. A context manager: leaving it closes every sink.

    Attributes:
        line: The line of the block that is to be filled next, before :meth:`commit`.
    """

    def __init__(
        self, block: FloatArray, sinks: Sequence[Sink], complete: Callable[[FloatArray], None], *, by_clock: bool = True
    ) -> None:
        """Start with an empty block.

        Args:
            block: Where rows are filled in, (lines, number of signals).
            sinks: Where rows and events go.
            complete: Fills in what is worked out for a block of rows at once, just before it is passed on.
            by_clock: Flush at least once per wall second; otherwise whenever the block is full, so that the same rows
                give the same bytes at any speed.
        """
        self._sinks, self._complete = tuple(sinks), complete
        self._block, self.line = block, 0
        self._by_clock, self._next_flush = by_clock, time.monotonic() + _FLUSH_PERIOD_S
        self.outcome: OutcomeRecord | None = None

    def open(self, header: RunHeader) -> None:
        """Open every sink."""
        for sink in self._sinks:
            sink.open(header)

    def commit(self) -> None:
        """The line is complete."""
        self.line += 1
        if self.line == len(self._block):
            self.pass_on()
            if not self._by_clock:
                self.flush()
        if self._by_clock and time.monotonic() >= self._next_flush:
            self.flush()

    def event(self, event: Event) -> None:
        """Pass an event on, after all rows before it, and flush."""
        self.pass_on()
        for sink in self._sinks:
            sink.event(event)
        self.flush()

    def flush(self) -> None:
        """Make everything survive a kill."""
        self.pass_on()
        for sink in self._sinks:
            sink.flush()
        self._next_flush = time.monotonic() + _FLUSH_PERIOD_S

    def pass_on(self) -> None:
        """Hand the rows so far to every sink."""
        block, self.line = self._block[: self.line], 0
        if len(block):
            self._complete(block)
            for sink in self._sinks:
                sink.rows(block)

    def __enter__(self) -> Recorder:
        """Start recording."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close every sink, the later ones too when an earlier one fails; the first failure is raised."""
        failures: list[Exception] = []
        try:
            self.pass_on()
        except Exception as failure:  # noqa: BLE001 (raised below, once every sink is closed)
            failures.append(failure)
        for sink in self._sinks:
            try:
                sink.close(self.outcome)
            except Exception as failure:  # noqa: BLE001 (raised below, once every sink is closed)
                failures.append(failure)
        if failures and error is None:
            raise failures[0]
