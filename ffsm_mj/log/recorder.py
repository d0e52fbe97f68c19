"""Rows into blocks, blocks to the sinks; flushed at every event and at least once per wall second."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from types import TracebackType

import numpy as np

from ffsm_mj.events import Event, OutcomeRecord
from ffsm_mj.log.sink import RunHeader, Sink
from ffsm_mj.model import FloatArray
from ffsm_mj.signals import Layout

BLOCK_ROWS = 1000
"""Rows that are passed on together."""
_FLUSH_PERIOD_S = 1.0


class Recorder:
    """Hands out the next row to fill and passes full blocks on. A context manager: leaving it closes every sink."""

    def __init__(self, layout: Layout, sinks: Sequence[Sink], complete: Callable[[FloatArray], None]) -> None:
        """Prepare an empty block.

        Args:
            layout: Columns of a row.
            sinks: Where rows and events go.
            complete: Fills in what is worked out for a block of rows at once, just before it is passed on.
        """
        self._sinks, self._complete = tuple(sinks), complete
        self._block = np.zeros((BLOCK_ROWS, len(layout.signals)))
        self._used = 0
        self._next_flush = time.monotonic() + _FLUSH_PERIOD_S
        self.outcome: OutcomeRecord | None = None

    def open(self, header: RunHeader) -> None:
        """Open every sink."""
        for sink in self._sinks:
            sink.open(header)

    def row(self) -> FloatArray:
        """The next row, to be filled by the caller and then passed to :meth:`commit`."""
        return self._block[self._used]  # type: ignore[no-any-return]

    def commit(self) -> None:
        """The row handed out last is complete."""
        self._used += 1
        if self._used == BLOCK_ROWS:
            self._pass_on()
        if time.monotonic() >= self._next_flush:
            self.flush()

    def event(self, event: Event) -> None:
        """Pass an event on, after all rows before it, and flush."""
        self._pass_on()
        for sink in self._sinks:
            sink.event(event)
        self.flush()

    def flush(self) -> None:
        """Make everything survive a kill."""
        self._pass_on()
        for sink in self._sinks:
            sink.flush()
        self._next_flush = time.monotonic() + _FLUSH_PERIOD_S

    def _pass_on(self) -> None:
        block, self._used = self._block[: self._used], 0
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
            self._pass_on()
        except Exception as failure:  # noqa: BLE001 (raised below, once every sink is closed)
            failures.append(failure)
        for sink in self._sinks:
            try:
                sink.close(self.outcome)
            except Exception as failure:  # noqa: BLE001 (raised below, once every sink is closed)
                failures.append(failure)
        if failures and error is None:
            raise failures[0]
