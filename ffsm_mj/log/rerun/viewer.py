"""The Rerun viewer as a program: its command line, whether it can open a window, and the log level of its SDK."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

LOCAL_ADDRESS = "127.0.0.1"
"""Default address on which a viewer listens: not reachable from other machines."""

_VARIABLE = "RUST_LOG"
_ONE_AT_A_TIME = Lock()


def has_display() -> bool:
    """Whether a window can open on this machine."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def viewer_command(*arguments: str, listen: str = LOCAL_ADDRESS) -> list[str]:
    """Command line of the viewer installed with this Python.

    Args:
        arguments: Arguments of the viewer.
        listen: Address on which it accepts data; the viewer's own default is all addresses of the machine.
    """
    return [sys.executable, "-m", "rerun", "--bind", listen, *arguments]


@contextmanager
def rust_log(level: str) -> Iterator[None]:
    """Set the log level of Rerun's SDK if it is first imported in this context; a ``RUST_LOG`` of the user wins.

    The SDK reads ``RUST_LOG`` once, at import. The environment is restored.
    """
    with _ONE_AT_A_TIME:
        if _VARIABLE in os.environ:
            yield
            return
        os.environ[_VARIABLE] = level
        try:
            yield
        finally:
            del os.environ[_VARIABLE]
