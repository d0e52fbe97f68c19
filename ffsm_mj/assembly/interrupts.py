"""Ctrl-C and SIGTERM, which mean the same here: stop, and leave everything whole."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def raised() -> Iterator[None]:
    """Both raise KeyboardInterrupt, wherever the program is."""

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    with _handled(stop):
        yield


@contextmanager
def noted() -> Iterator[Callable[[], bool]]:
    """The first is a flag, so that no half-written state is left; a second one raises KeyboardInterrupt.

    Yields:
        Whether it came.
    """
    seen: list[int] = []

    def note(number: int, _: Any) -> None:
        if seen:
            raise KeyboardInterrupt
        seen.append(number)

    with _handled(note):
        yield lambda: bool(seen)


@contextmanager
def _handled(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle both signals here; only the main thread can, in others nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {number: signal.signal(number, handler) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)
