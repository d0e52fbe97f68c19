"""Progress on a terminal; silence elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Report = Callable[[float, float], None]


@contextmanager
def progress(name: str) -> Iterator[Report | None]:
    """Yield what a run is to call with (simulation time, duration) in s, or None where nobody watches."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(name), BarColumn(), TextColumn("{task.completed:.1f} of {task.total:g} s"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=None)
        calls = 0

        def report(time_s: float, duration_s: float) -> None:
            nonlocal calls
            if calls % 100 == 0:  # the bar repaints ten times a second on its own
                bar.update(task, completed=time_s, total=duration_s)
            calls += 1

        yield report


@contextmanager
def counter(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Yield what is to be called with (done, of how many), or None where nobody watches."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TextColumn("runs"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)
