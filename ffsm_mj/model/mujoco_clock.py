"""Removal of MuJoCo's clock during a run: reading it at every stage takes 8 % of a compiled baseline.

MuJoCo measures its stages in ``data.timer``, which is not used here. Its Python bindings install the clock for the whole
process and cannot remove it (``set_mjcb_time(None)`` restores it), so the pointer is cleared through ctypes.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

import mujoco


class _Clock:
    """MuJoCo's pointer to its clock, cleared while any thread is inside :func:`stopped_clock`."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._before: int | None = None

    def stop(self) -> None:
        with self._lock:
            place = _place()
            # A Python function set by the user is kept.
            if not self._inside and place is not None and mujoco.get_mjcb_time() is None:
                self._before, place.value = place.value, None
            self._inside += 1

    def restore(self) -> None:
        with self._lock:
            self._inside -= 1
            place = _place()
            if (
                not self._inside and place is not None and place.value is None
            ):  # a clock that was set in the meantime is kept
                place.value = self._before


_CLOCK = _Clock()


@contextmanager
def stopped_clock() -> Iterator[None]:
    """Remove MuJoCo's clock in this context; the last thread to leave restores it."""
    _CLOCK.stop()
    try:
        yield
    finally:
        _CLOCK.restore()


@cache
def _place() -> Any:
    """MuJoCo's pointer to its clock; None if its library is not found."""
    try:
        return ctypes.c_void_p.in_dll(library(), "mjcb_time")
    except (OSError, ValueError):
        return None


@cache
def library() -> ctypes.CDLL:
    """MuJoCo's library, for what the Python bindings have not.

    Raises:
        OSError: It is not in MuJoCo's package.
    """
    names = {"win32": "mujoco.dll", "darwin": f"libmujoco.{mujoco.__version__}.dylib"}
    return ctypes.CDLL(str(Path(mujoco.__file__).parent / names.get(sys.platform, f"libmujoco.so.{mujoco.__version__}")))
