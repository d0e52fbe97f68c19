"""Sinks that work in a thread of their own, so that a run in real time does not wait for files and viewers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Event as Flag
from threading import Thread

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.recorder import RECORDED_ROWS, Sink, close_all
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.run_log import RunHeader

BACKGROUND_ROWS = 20
"""Rows of a block: what is computed of a whole block takes a part of a control period."""
_LONGEST_WAIT_S = 0.05
"""Longest time for which a task waits for a run that is not idle, s: one that falls behind still has a log."""


class BackgroundSink(Sink):
    """Passes everything on to other sinks in a thread, in order. What fails there is raised at the next call."""

    def __init__(self, sinks: Sequence[Sink], idle: Flag) -> None:
        """Bind to the sinks, which are opened in the caller's thread; ``idle`` is set while the run waits."""
        self._sinks, self._idle = tuple(sinks), idle
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._blocks: list[FloatArray] = []
        self._failure: Exception | None = None
        self._thread: Thread | None = None

    def open(self, header: RunHeader) -> None:
        """Open the sinks, and start the thread."""
        for sink in self._sinks:
            sink.open(header)
        self._thread = Thread(target=self._work, name="ffsm log", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            self._idle.wait(_LONGEST_WAIT_S)
            try:
                if self._failure is None:
                    task()
            except Exception as failure:  # noqa: BLE001 (raised in the thread of the run)
                self._failure = failure

    def _pass_on(self, task: Callable[[Sink], None]) -> None:
        def perform() -> None:
            for sink in self._sinks:
                task(sink)

        self._pass_on_rows()
        self._put(perform)

    def _put(self, task: Callable[[], None]) -> None:
        self._raise_failure()
        self._tasks.put(task)

    def _raise_failure(self) -> None:
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def rows(self, block: FloatArray) -> None:
        """Keep a copy of a block: sinks take many at once, which costs a part of what one by one does."""
        self._raise_failure()
        self._blocks.append(block.copy())
        if len(self._blocks) * BACKGROUND_ROWS >= RECORDED_ROWS:
            self._pass_on_rows()

    def _pass_on_rows(self) -> None:
        if blocks := self._blocks:
            self._blocks = []
            self._put(lambda: self._write(blocks))

    def _write(self, blocks: list[FloatArray]) -> None:
        block = np.concatenate(blocks)
        for sink in self._sinks:
            sink.rows(block)

    def event(self, event: Event) -> None:
        """Pass on an event."""
        self._pass_on(lambda sink: sink.event(event))

    def state(self, time_s: float, state: bytes) -> None:
        """Pass on a state of the simulation."""
        self._pass_on(lambda sink: sink.state(time_s, state))

    def flush(self) -> None:
        """Flush the sinks when they have taken all that came before."""
        self._pass_on(lambda sink: sink.flush())

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Wait until everything is written, and close every sink; the first failure is raised."""
        failures = []
        if self._thread is not None:
            try:
                self._pass_on_rows()
            except Exception as failure:  # noqa: BLE001 (raised below, after every sink is closed)
                failures.append(failure)
            self._tasks.put(None)
            self._thread.join()
        if self._failure is not None:
            failures.append(self._failure)
        failures += close_all(self._sinks, outcome)
        if failures:
            raise failures[0]
