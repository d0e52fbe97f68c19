"""The Rerun viewer as a program: whether it can open here, and how it is called."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

ONLY_HERE = "127.0.0.1"
"""The address that a viewer listens on unless told otherwise: that of this machine, unreachable from any other."""

_VARIABLE = "RUST_LOG"
_ONE_AT_A_TIME = Lock()


def has_display() -> bool:
    """Whether a window can open on this machine."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def viewer_command(*arguments: str, listen: str = ONLY_HERE) -> list[str]:
    """Command line of the viewer that belongs to this Python.

    Args:
        arguments: For the viewer.
        listen: Address it takes data on; its own default is every address of the machine, for anybody in the network.
    """
    return [sys.executable, "-m", "rerun", "--bind", listen, *arguments]


@contextmanager
def rust_log(level: str) -> Iterator[None]:
    """Where Rerun is imported in here it says what a level lets pass, or what the user's environment states.

    The environment is afterwards as it was.
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
