"""Output of a command together with its progress display."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ffsm_mj.cli.progress import Progress, Report, progress
from ffsm_mj.cli.standard_streams import Output

Say = Callable[[str], None]
"""Prints one or more lines on stdout."""
Stage = Callable[[str, str], Report | None]
"""Begins a stage, given its name and the unit of its progress; see :class:`ffsm_mj.cli.progress.Progress`."""


@contextmanager
def display(output: Output) -> Iterator[tuple[Say, Progress]]:
    """Progress, and a function that prints while progress is displayed."""
    with progress() as shown:

        def say(text: str) -> None:
            with shown.hidden():
                output.say(text)

        yield say, shown
