"""Collection of MuJoCo's warnings, which otherwise go to MUJOCO_LOG.TXT in the current folder and to the console.

MuJoCo calls one handler for the whole process, in the thread of the warning. This handler is installed while any thread
collects, and passes a warning to the collector of its thread; warnings of other threads are handled as without it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import Lock, local

import mujoco

from ffsm_mj.model.files import ModelFiles

_IDLE = ("Attaching a spec with an empty prefix", "Child model has pending keyframes", "Attach conflict when attaching")
"""Starts of irrelevant warnings: models are neither saved nor reset to a keyframe, and :mod:`ffsm_mj.model.settings` says
which settings of attached models matter."""


class _Here(local):
    """Collectors of a thread, innermost last."""

    def __init__(self) -> None:
        self.collectors: list[list[str]] = []


_HERE = _Here()


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
        if _HERE.collectors:
            _HERE.collectors[-1].append(message)
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
    return _HERE.collectors


@contextmanager
def collecting(messages: list[str]) -> Iterator[None]:
    """Append MuJoCo's warnings of this thread to ``messages``, while the handler is installed."""
    here = collectors()
    here.append(messages)
    try:
        yield
    finally:
        here.pop()


@contextmanager
def collected_warnings(messages: list[str]) -> Iterator[None]:
    """Append MuJoCo's warnings of this thread to ``messages``."""
    with handled_warnings(), collecting(messages):
        yield


def warning_lines(warned: Mapping[str, Sequence[str]], files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """MuJoCo's warnings, each once and on one line: those of models with their files, then those of the scene only."""
    # A warning about a model usually comes twice, from the model alone and from the scene: it is reported with the file.
    known = set[str]()
    for name, model in files.items():
        for text in dict.fromkeys(" ".join(text.split()).replace(f"{name}/", "") for text in warned[name]):
            known.add(text)
            if not text.startswith(_IDLE):
                yield f"{model.place}: MuJoCo: {text}"
    for text in dict.fromkeys(" ".join(text.split()) for text in warned[""]):
        if not text.startswith(_IDLE) and not any(text.replace(f"{name}/", "") in known for name in files):
            yield f"MuJoCo: {text}"
