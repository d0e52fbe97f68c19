"""Progress display of a command on a terminal; nothing is displayed elsewhere."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol

Report = Callable[[float, float], None]
"""Callback (amount done, total amount), called as often as convenient."""


class Progress(Protocol):
    """Progress of a command, in stages."""

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report | None:
        """Begin the next stage.

        Args:
            name: Name of the stage.
            unit: Unit of the reported amounts: ``s``, or what is counted.
            total: Total amount, if it is known in advance.

        Returns:
            Callback for the progress of the stage; None if progress is not displayed.
        """

    def hidden(self) -> AbstractContextManager[None]:
        """Hide the display while something else is printed."""


class Silence:
    """Progress that is not displayed."""

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report | None:  # noqa: ARG002
        """Return None: no progress is reported."""
        return None

    def hidden(self) -> AbstractContextManager[None]:
        """Do nothing: there is no display."""
        return nullcontext()


@contextmanager
def progress() -> Iterator[Progress]:
    """Display progress on the last line of the terminal; the line is removed at exit of the context."""
    if not _watched():
        yield Silence()
        return
    from ffsm_mj.cli.progress_line import ProgressLine  # rich is slow to import

    line = ProgressLine()
    try:
        yield line
    finally:
        line.hide()


def _watched() -> bool:
    """Whether standard error is a terminal that can redraw a line."""
    if sys.stderr is None or not sys.stderr.isatty():
        return False
    return os.name == "nt" or os.environ.get("TERM", "").lower() not in ("", "dumb", "unknown")
