"""What a run changes in its process, and restores: handlers of signals and threads of BLAS; and what it takes from there.

Ctrl-C and SIGTERM stop a run and leave its files intact. While simulators step they do so within a step. To install handlers
at each step would take as long as the step: they stay as long as there is a simulator with a run, and a signal between two
steps goes where it went before. BLAS has one thread during a run: for small matrices more threads only cost time.

``SOURCE_DATE_EPOCH``, as for reproducible builds: the same run then gives the same log, byte for byte. If it is set, it is
the creation time of logs, wall times are 0, and logs are flushed by rows instead of by the clock.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from threading import Event, Lock, Thread, get_ident, main_thread
from types import FrameType
from typing import Any

from ffsm_mj.errors import InputError

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def raised() -> Iterator[None]:
    """Context in which both signals raise KeyboardInterrupt."""

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    with _handled(stop):
        yield


@contextmanager
def noted(most: int = 1) -> Iterator[Callable[[], bool]]:
    """Context in which the first signal sets a flag, so that no write is cut short; a second one raises KeyboardInterrupt.

    Args:
        most: Number of signals that only set the flag; with more than one, a key that is hit twice is no second request.

    Yields:
        A function that says whether a signal was received.
    """
    seen: list[int] = []

    def note(number: int, _: Any) -> None:
        if len(seen) >= most:
            raise KeyboardInterrupt
        seen.append(number)

    with _handled(note):
        yield lambda: bool(seen)


@contextmanager
def _handled(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Install a handler for both signals; without effect in other threads than the main one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {number: signal.signal(number, handler) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


class StepInterrupts:
    """Signals of one simulator; without effect outside the main thread. A context manager around the steps of a run.

    Attributes:
        is_noted: Whether a signal has come in this step.
    """

    _open: list[StepInterrupts] = []

    def __init__(self) -> None:
        """Nothing is installed yet."""
        self._is_within, self.is_noted, self._main = False, False, main_thread().ident

    def __enter__(self) -> StepInterrupts:
        """Install the handlers, unless they are there: of another simulator, or of one that another thread has closed."""
        if _in_main_thread():
            for number in _SIGNALS:
                before = signal.getsignal(number)
                if not isinstance(before, _Handler):
                    signal.signal(number, _Handler(before))
            self._open.append(self)
        return self

    def __exit__(self, *_: Any) -> None:
        """Restore the handlers, if this is the last simulator; a handler that was set in the meantime is kept."""
        if self not in self._open:
            return
        self._open.remove(self)
        if not self._open and _in_main_thread():
            for number in _SIGNALS:
                handler = signal.getsignal(number)
                if isinstance(handler, _Handler):
                    signal.signal(number, handler.before)

    def begin_step(self) -> None:
        """A step begins: signals are noted from now on."""
        self.is_noted, self._is_within = False, get_ident() == self._main

    def end_step(self) -> None:
        """The step is over."""
        self._is_within = False

    def noted(self) -> bool:
        """Whether a signal has come in this step, for those who ask again and again."""
        return self.is_noted

    @classmethod
    def note(cls) -> bool:
        """Note a signal in the simulators that are within a step; a second one raises KeyboardInterrupt.

        Returns:
            Whether there are any.
        """
        within = [interrupt for interrupt in cls._open if interrupt._is_within]
        if any(interrupt.is_noted for interrupt in within):
            raise KeyboardInterrupt
        for interrupt in within:
            interrupt.is_noted = True
        return bool(within)


class _Handler:
    """Hands a signal to the simulators, or on to the handler that it replaces."""

    def __init__(self, before: Any) -> None:
        self.before = before

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if StepInterrupts.note() or self.before == signal.SIG_IGN:
            return
        if callable(self.before):
            self.before(number, frame)
        else:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)


def _in_main_thread() -> bool:
    return get_ident() == main_thread().ident


class _Limit:
    """Limit for the whole process: set at the first entry, lifted at the last exit.

    threadpoolctl lets only the thread that set a limit lift it, and the last exit may be in another thread: a dedicated
    thread holds the limit.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._modules = Lock(), 0, 0

    def enter(self) -> Any:
        """Set the limit, if no other thread has; returns what can limit the libraries that are loaded."""
        from threadpoolctl import ThreadpoolController

        with self._lock:
            if not self._inside:
                if self._modules != len(sys.modules):  # only a module that is imported loads a library
                    self._libraries, self._modules = ThreadpoolController(), len(sys.modules)
                self._over, started = Event(), Event()
                self._holder = Thread(target=self._hold, args=(started,), name="BLAS limit", daemon=True)
                self._holder.start()
                started.wait()
            self._inside += 1
            return self._libraries

    def leave(self) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._over.set()
                self._holder.join()

    def _hold(self, started: Event) -> None:
        with self._libraries.limit(limits=1, user_api="blas"):
            started.set()
            self._over.wait()


_LIMIT = _Limit()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context with one thread for every loaded BLAS; the previous limit is restored at the last exit."""
    libraries = _LIMIT.enter()
    try:
        with libraries.limit(limits=1, user_api="blas"):  # for those that count by thread, as with OpenMP
            yield
    finally:
        _LIMIT.leave()


VARIABLE = "SOURCE_DATE_EPOCH"


def source_date() -> datetime | None:
    """Time in the environment variable, UTC; None if it is not set.

    Raises:
        InputError: It is not an integer number of seconds since 1970, or beyond the year 9999.
    """
    text = os.environ.get(VARIABLE, "")
    if not text:
        return None
    try:
        if text.isascii() and text.isdigit():
            return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=int(text))
    except (OverflowError, ValueError):  # ValueError: more digits than Python turns into a number
        pass
    raise InputError(f"{VARIABLE}={text}: must be a whole number of seconds since 1970, at most to the year 9999")
