"""MuJoCo's warnings, kept: by itself it writes them to MUJOCO_LOG.TXT where the user stands, and on the console.

MuJoCo calls one handler for the whole process, in the thread that warns. Ours is there while any thread collects, and hands
each warning to those who collect in its own thread; in all others everything stays as it is without us.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import Lock, local

import mujoco

from ffsm_mj.model.files import ModelFiles

_IDLE = ("Attaching a spec with an empty prefix", "Child model has pending keyframes")
"""How warnings begin of what is never done here: a model is not saved, and nothing begins at a keyframe."""


class _Here(local):
    """Who collects in this thread, the latest last."""

    def __init__(self) -> None:
        self.collectors: list[list[str]] = []


_HERE = _Here()


class _Handler:
    """What MuJoCo calls while anybody collects; the handler that was there before is put back by the last one out."""

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
            # One that somebody has set meanwhile stays.
            if not self._collecting and mujoco.get_mju_user_warning() == self.handle:
                mujoco.set_mju_user_warning(self._before)

    def handle(self, message: str) -> None:
        if _HERE.collectors:
            _HERE.collectors[-1].append(message)
        elif self._before is not None:
            self._before(message)
        else:  # as MuJoCo does where there is no handler
            mujoco.mju_writeLog("WARNING", message)
            print(f"WARNING: {message}", file=sys.stderr)


_HANDLER = _Handler()


@contextmanager
def collected_warnings(messages: list[str]) -> Iterator[None]:
    """Add what MuJoCo warns of in this thread to some messages instead."""
    _HANDLER.enter()
    _HERE.collectors.append(messages)
    try:
        yield
    finally:
        _HERE.collectors.pop()
        _HANDLER.leave()


def warning_lines(warned: Mapping[str, Sequence[str]], files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """What MuJoCo warned of, each once on a line: of a model with its file, of the scene what no model has alone."""
    known = set[str]()
    for name, model in files.items():
        for text in dict.fromkeys(" ".join(text.split()).replace(f"{name}/", "") for text in warned[name]):
            known.add(text)
            if not text.startswith(_IDLE):
                yield f"{model.place}: MuJoCo: {text}"
    for text in dict.fromkeys(" ".join(text.split()) for text in warned[""]):
        if not text.startswith(_IDLE) and not any(text.replace(f"{name}/", "") in known for name in files):
            yield f"MuJoCo: {text}"
