"""Ctrl-C and SIGTERM while simulators step: within a step they end the run and leave its files intact, see ``interrupts``.

To install handlers at each step would take as long as the step. They stay as long as there is a simulator with a run, and a
signal between two steps goes where it went before.
"""

from __future__ import annotations

import os
import signal
from threading import get_ident, main_thread
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


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
        within = [each for each in cls._open if each._is_within]
        if any(each.is_noted for each in within):
            raise KeyboardInterrupt
        for each in within:
            each.is_noted = True
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
