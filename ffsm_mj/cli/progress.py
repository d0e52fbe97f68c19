"""Progress of a command on its terminal; silence where nobody watches."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol

Report = Callable[[float, float], None]
"""Told (how much is done, of how much), as often as the work likes."""


class Progress(Protocol):
    """What a command is doing, part by part."""

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report | None:
        """The next part of the work begins.

        Args:
            name: What is being done.
            unit: Of the numbers that will be reported: ``s``, or what is counted.
            total: How much there is to do, where it is known now.

        Returns:
            What the work is to tell how far it is; None where nobody watches.
        """

    def hidden(self) -> AbstractContextManager[None]:
        """The terminal is free for something else to be printed."""


class Silence:
    """Progress that nobody watches."""

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report | None:  # noqa: ARG002
        """Nobody is to be told."""
        return None

    def hidden(self) -> AbstractContextManager[None]:
        """The terminal is always free."""
        return nullcontext()


@contextmanager
def progress() -> Iterator[Progress]:
    """Show what is done within, on the last line of the terminal; the line is gone when it ends."""
    if not _watched():
        yield Silence()
        return
    from ffsm_mj.cli.progress_line import ProgressLine  # rich: for those who watch

    line = ProgressLine()
    try:
        yield line
    finally:
        line.hide()


def _watched() -> bool:
    """Whether standard error is a terminal on which a line can be painted again."""
    if sys.stderr is None or not sys.stderr.isatty():
        return False
    return os.name == "nt" or os.environ.get("TERM", "").lower() not in ("", "dumb", "unknown")
