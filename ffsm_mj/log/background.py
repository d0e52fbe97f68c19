"""Sinks that work in a process of their own, so that a run in real time waits neither for files nor for the interpreter.

A thread would not do: Python lets one thread at a time compute, and a tick that is due would wait for the log. On Windows
and macOS a process cannot be forked so that its libraries go on to work; there it is a thread all the same.

Rows go through memory that both share, without a call of the operating system, which takes longer than to copy them and may
give the processor to somebody else. What is rare goes through a pipe.
"""

from __future__ import annotations

import errno
import gc
import os
import pickle
import signal
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from contextvars import copy_context
from functools import partial
from mmap import mmap
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from traceback import format_exception
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import THE_LOG, FfsmError, LogWriteError, described
from ffsm_mj.log.recorder import RECORDED_ROWS, Sink, close_all
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.run_log import RunHeader

try:
    from fcntl import F_SETPIPE_SZ, fcntl
except ImportError:
    HAS_FORK = False
else:
    HAS_FORK = True
"""Whether a process can be forked whose libraries go on to work: on Linux, which is also where a pipe can be enlarged."""

_PIPE_BYTES = 1 << 20
"""Of what the run has sent and the process has not read yet; more is for privileged users."""
_SHARED_ROWS = 2000
"""Rows that the process has not taken yet; the run waits where there are more."""
_LOOK_S = 0.02
"""Time between two looks for what comes, s."""
_NICENESS = 10
"""The run goes first where both have to share a processor."""
_CLOSED = "closed"


class _SharedRows:
    """Rows on their way between two processes: a ring in memory that both have after a fork, one writes and one takes.

    Attributes:
        failed: Whether something has failed in the process that takes, (1,).
    """

    def __init__(self, width: int) -> None:
        """Get memory for rows of some width."""
        memory = mmap(-1, 24 + 8 * _SHARED_ROWS * width)
        self._counts, self.failed = np.split(np.frombuffer(memory, np.int64, 3), [2])  # rows written and taken so far
        self._rows = np.frombuffer(memory, np.float64, offset=24).reshape(_SHARED_ROWS, width)
        self._rows.fill(0.0)  # the operating system gives each page at its first use: not in a tick

    @property
    def written(self) -> int:
        """Number of rows that have been written."""
        return int(self._counts[0])

    def write(self, block: FloatArray) -> bool:
        """Write the next rows; returns False if there is no room for them yet."""
        end, first = self.written + len(block), int(self._counts[1])
        if end - first > _SHARED_ROWS:
            return False
        self._rows[np.arange(self.written, end) % _SHARED_ROWS] = block
        self._counts[0] = end
        return True

    def take(self, end: int) -> FloatArray:
        """A copy of the rows that have not been taken, up to a number of all that are written."""
        rows: FloatArray = self._rows[np.arange(self._counts[1], end) % _SHARED_ROWS]
        self._counts[1] += len(rows)
        return rows


class BackgroundSink(Sink):
    """Passes everything on to other sinks in a process, in order. What fails there is raised at a later call."""

    def __init__(
        self, sinks: Sequence[Sink], folder: RunFolder | None, complete: Callable[[FloatArray], FloatArray], width: int
    ) -> None:
        """Bind to the sinks.

        Args:
            sinks: The sinks, for the process to write to.
            folder: Folder that they write, which is told its final path.
            complete: Makes rows of the blocks that are passed.
            width: Width of these blocks.
        """
        self._sinks, self._folder, self._complete = tuple(sinks), folder, complete
        self._rows, self._unsent = _SharedRows(width), list[tuple[int, str, tuple[Any, ...]]]()
        self._join: Callable[[], object] | None = None

    def open(self, header: RunHeader) -> None:
        """Start the process, and open the sinks in it."""
        tasks, self._tasks = Pipe(duplex=False)
        self._answers, answers = Pipe(duplex=False)

        def work() -> None:
            _Worker(self._sinks, self._complete, self._rows, tasks, answers).work(header, self._folder)

        if HAS_FORK:
            fcntl(self._tasks.fileno(), F_SETPIPE_SZ, _PIPE_BYTES)
            self._join = _forked(work, (self._tasks, self._answers))
            tasks.close()
            answers.close()
        else:
            # What NumPy warns of is set for the run, and a thread would begin without that.
            thread = Thread(target=copy_context().run, args=(work,), name="ffsm log", daemon=True)
            thread.start()
            self._join = thread.join
        path = self._answer()
        if self._folder is not None:
            self._folder.path = path  # a number may have been appended

    def _answer(self) -> Any:
        """What the process says; raises what has failed in it."""
        try:
            answer = self._answers.recv()
        except (EOFError, OSError):
            raise self._gone() from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _gone(self) -> LogWriteError:
        place = THE_LOG if self._folder is None else self._folder.log
        return LogWriteError(place, OSError(errno.EPIPE, "the process that wrote it is gone"))

    def _add(self, task: str, *arguments: Any) -> None:
        self._unsent.append((self._rows.written, task, arguments))

    def _send(self) -> None:
        unsent, self._unsent = self._unsent, []
        self._tasks.send(unsent)

    def rows(self, block: FloatArray) -> None:
        """Pass on a block."""
        while not self._rows.write(block):
            self.flush()  # raises if nobody takes them any more
            time.sleep(_LOOK_S)

    def event(self, event: Event) -> None:
        """Pass on an event, with the next flush."""
        self._add("event", event)

    def state(self, time_s: float, state: bytes) -> None:
        """Pass on a state of the simulation, with the next flush."""
        self._add("state", time_s, state)

    def flush(self) -> None:
        """Flush the sinks when they have taken all that came before."""
        if self._rows.failed[0] and self._answers.poll():  # which takes a while
            self._answer()
        self._add("flush")
        try:
            self._send()
        except OSError:
            raise self._gone() from None

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Wait until everything is written and every sink is closed; the first failure is raised."""
        if self._join is None:
            return
        failures: list[Exception] = []
        self._add("close", outcome)
        with suppress(OSError):  # if the process is gone, its answers end without the last one
            self._send()
        self._tasks.close()
        answer = None
        with suppress(EOFError, OSError):
            while True:
                answer = self._answers.recv()
                failures += [answer] if isinstance(answer, Exception) else []
        self._join()
        self._answers.close()
        if answer != _CLOSED:
            failures.append(self._gone())
        if failures:
            raise failures[0]


class _Worker:
    """Performs in another process what the sink of the run is asked to do."""

    def __init__(
        self,
        sinks: Sequence[Sink],
        complete: Callable[[FloatArray], FloatArray],
        rows: _SharedRows,
        tasks: Connection,
        answers: Connection,
    ) -> None:
        """Bind to the sinks, to what makes their rows of those that are shared, and to the ends of the pipes."""
        self._sinks, self._complete, self._rows, self._tasks, self._answers = sinks, complete, rows, tasks, answers
        self._received: SimpleQueue[tuple[str, tuple[Any, ...]] | None] = SimpleQueue()
        self._blocks: list[FloatArray] = []

    def work(self, header: RunHeader, folder: RunFolder | None) -> None:
        """Open the sinks, and do what comes until they are closed."""
        # The run must not wait until a sink is ready to go on.
        Thread(target=self._receive, daemon=True).start()
        self._attempt(lambda: self._open(header, folder))
        while (received := self._received.get()) is not None:
            task, arguments = received
            self._attempt(partial(self._perform, task, *arguments))
            if task == "close":
                self._answer(_CLOSED)
                break
        self._answers.close()

    def _receive(self) -> None:
        seen = 0
        with suppress(EOFError, OSError):
            while True:
                # Not to wait for what comes: who sends it would have to wake who waits, which takes 0.1 ms.
                time.sleep(_LOOK_S)
                while self._tasks.poll():
                    for written, task, arguments in self._tasks.recv():
                        self._take_rows(written)
                        self._received.put((task, arguments))
                # A processor may see the number of rows before it sees the rows, but not for as long as that.
                self._take_rows(seen)
                seen = self._rows.written
        self._received.put(None)  # the run was killed: as without a process, its log has what was flushed

    def _take_rows(self, end: int) -> None:
        rows = self._rows.take(end)
        if len(rows):
            self._received.put(("rows", (rows,)))

    def _attempt(self, act: Callable[[], None]) -> None:
        try:
            act()
        except Exception as failure:  # noqa: BLE001 (raised in the run)
            self._answer(_portable(failure))

    def _answer(self, answer: Any) -> None:
        with suppress(OSError):  # a run that was killed asks for nothing
            self._answers.send(answer)
        self._rows.failed[0] |= isinstance(answer, Exception)

    def _open(self, header: RunHeader, folder: RunFolder | None) -> None:
        for sink in self._sinks:
            sink.open(header)
        self._answer(None if folder is None else folder.path)

    def _perform(self, task: str, *arguments: Any) -> None:
        if task == "rows":
            self._blocks += arguments
            if sum(map(len, self._blocks)) < RECORDED_ROWS:
                return  # sinks take many rows at once, which costs a part of what one block by one does
        if self._blocks:
            blocks, self._blocks = self._blocks, []
            rows = self._complete(np.concatenate(blocks))
            for sink in self._sinks:
                sink.rows(rows)
        if task == "close":
            for failure in close_all(self._sinks, *arguments):
                self._answer(_portable(failure))
        for sink in self._sinks if task in ("event", "state", "flush") else ():
            getattr(sink, task)(*arguments)


def _forked(work: Callable[[], None], of_the_run: Sequence[Connection]) -> Callable[[], object]:
    """Do some work in a copy of this process, which closes the ends of pipes that are not its own.

    Returns:
        A function that waits for its end.
    """
    with warnings.catch_warnings():
        # Python warns of other threads, which may hold locks: of those that the work needs, it frees its own in the copy.
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if process:
        return partial(_wait_for, process)
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: None)  # they reach every process of a terminal; the run decides how it ends
        for connection in of_the_run:
            connection.close()
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # only the run is in a hurry
        os.nice(_NICENESS)
        gc.freeze()  # to look at objects of the run would copy them
        work()
    finally:
        os._exit(0)  # nothing of the run may go on in its copy


def _wait_for(process: int) -> None:
    with suppress(ChildProcessError):  # a handler of the program may have waited for it
        os.waitpid(process, 0)


def _portable(failure: Exception) -> Exception:
    """An exception as it can be passed to another process: with its traceback as a note, or described."""
    failure.add_note("".join(format_exception(failure)))
    try:
        if str(pickle.loads(pickle.dumps(failure))) == str(failure):
            return failure
    except Exception:  # noqa: BLE001 (whatever a class does not allow)
        pass
    return FfsmError(described(failure))
