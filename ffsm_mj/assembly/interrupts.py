"""Handling of Ctrl-C and SIGTERM: both stop a run and leave its files intact."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

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
