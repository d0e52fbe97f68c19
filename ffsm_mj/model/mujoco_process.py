"""What MuJoCo keeps for a whole process: the handler of its warnings, and its clock.

Warnings otherwise go to MUJOCO_LOG.TXT in the current folder and to the console. MuJoCo calls one handler for the whole
process, in the thread of the warning. This handler is installed while any thread collects, and passes a warning to the
collector of its thread; warnings of other threads are handled as without it.

MuJoCo measures its stages in ``data.timer``, which is not used here, and reading its clock at every stage takes 8 % of a
compiled baseline. Its Python bindings install the clock for the whole process and cannot remove it
(``set_mjcb_time(None)`` restores it), so the pointer is cleared through ctypes.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock, local
from typing import Any

import mujoco

_IDLE = ("Attaching a spec with an empty prefix", "Child model has pending keyframes", "Attach conflict when attaching")
"""Starts of irrelevant warnings: models are neither saved nor reset to a keyframe, and :mod:`ffsm_mj.model.settings` says
which settings of attached models matter."""


class _ThreadCollectors(local):
    """Collectors of a thread, innermost last."""

    def __init__(self) -> None:
        self.collectors: list[list[str]] = []


_THREAD = _ThreadCollectors()


class _Handler:
    """The handler that MuJoCo calls while any thread collects; the last one to leave restores the previous handler."""

    def __init__(self) -> None:
        self._lock, self._collecting = Lock(), 0
        self._before: Callable[[str], None] | None = None

    def enter(self) -> None:
        with self._lock:
            there = mujoco.get_mju_user_warning()
            if there != self.handle:
                self._before = there
                mujoco.set_mju_user_warning(self.handle)
            self._collecting += 1

    def leave(self) -> None:
        with self._lock:
            self._collecting -= 1
            # A handler that was set in the meantime is kept.
            if not self._collecting and mujoco.get_mju_user_warning() == self.handle:
                mujoco.set_mju_user_warning(self._before)

    def handle(self, message: str) -> None:
        if _THREAD.collectors:
            _THREAD.collectors[-1].append(message)
        elif self._before is not None:
            self._before(message)
        else:  # as MuJoCo without a handler
            mujoco.mju_writeLog("WARNING", message)
            print(f"WARNING: {message}", file=sys.stderr)


_HANDLER = _Handler()


@contextmanager
def handled_warnings() -> Iterator[None]:
    """Install the handler, so that :func:`collecting` costs little; it changes nothing for others."""
    _HANDLER.enter()
    try:
        yield
    finally:
        _HANDLER.leave()


def collectors() -> list[list[str]]:
    """Collectors of this thread, the innermost last: the one that MuJoCo's warnings of this thread are appended to."""
    return _THREAD.collectors


@contextmanager
def collecting(messages: list[str]) -> Iterator[None]:
    """Append MuJoCo's warnings of this thread to ``messages``, while the handler is installed."""
    lists = collectors()
    lists.append(messages)
    try:
        yield
    finally:
        lists.pop()


@contextmanager
def collected_warnings(messages: list[str]) -> Iterator[None]:
    """Append MuJoCo's warnings of this thread to ``messages``."""
    with handled_warnings(), collecting(messages):
        yield


def warning_lines(warned: Mapping[str, Sequence[str]], places: Mapping[str, str]) -> Iterator[str]:
    """MuJoCo's warnings, each once and on one line: those of models with their files, then those of the scene only.

    Args:
        warned: Warnings by model; those of the scene under the empty name.
        places: Names of the files of each model in messages.
    """
    # A warning about a model usually comes twice, from the model alone and from the scene: it is reported with the file.
    known = set[str]()
    for name, place in places.items():
        for text in dict.fromkeys(" ".join(text.split()).replace(f"{name}/", "") for text in warned[name]):
            known.add(text)
            if not text.startswith(_IDLE):
                yield f"{place}: MuJoCo: {text}"
    for text in dict.fromkeys(" ".join(text.split()) for text in warned[""]):
        if not text.startswith(_IDLE) and not any(text.replace(f"{name}/", "") in known for name in places):
            yield f"MuJoCo: {text}"


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
