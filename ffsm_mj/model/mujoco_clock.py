"""MuJoCo's clock, stopped while a run goes: it is read at the start and end of every stage, 8 % of a compiled baseline.

MuJoCo adds up how long its own stages take in ``data.timer``, which is no part of the physics; nobody reads it here. Its
bindings install that clock for the whole process and have no way to take it away (``set_mjcb_time(None)`` puts it back).
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
    """MuJoCo's pointer to its clock: cleared by the first one in, put back by the last one out."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._before: int | None = None

    def stop(self) -> None:
        with self._lock:
            place = _place()
            # A function of Python's that the user has set is left alone.
            if not self._inside and place is not None and mujoco.get_mjcb_time() is None:
                self._before, place.value = place.value, None
            self._inside += 1

    def go_on(self) -> None:
        with self._lock:
            self._inside -= 1
            place = _place()
            if not self._inside and place is not None and place.value is None:  # one that was set meanwhile stays
                place.value = self._before


_CLOCK = _Clock()


@contextmanager
def stopped_clock() -> Iterator[None]:
    """No clock for MuJoCo; the last one out puts it back."""
    _CLOCK.stop()
    try:
        yield
    finally:
        _CLOCK.go_on()


@cache
def _place() -> Any:
    """MuJoCo's pointer to its clock; None where its library is not where it should be."""
    names = {"win32": "mujoco.dll", "darwin": f"libmujoco.{mujoco.__version__}.dylib"}
    path = Path(mujoco.__file__).parent / names.get(sys.platform, f"libmujoco.so.{mujoco.__version__}")
    try:
        return ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_time") if path.is_file() else None
    except (OSError, ValueError):
        return None
