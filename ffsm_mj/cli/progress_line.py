"""Progress line at the bottom of a terminal: stage, bar, amount done and remaining time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.segment import Segment

from ffsm_mj.errors import one_line

_PATIENCE_S = 0.4
"""A stage that takes less time than this shows no line."""
_BAR_CELLS = (8, 40)
_TRUST_S = 1.0
"""Remaining time is estimated from the speed so far after this time."""


class ProgressLine:
    """Progress line, redrawn ten times a second from the last reported amounts, so that reporting is cheap.

    If the terminal goes away, only the line is lost.
    """

    def __init__(self) -> None:
        """Start without a stage; nothing is displayed yet."""
        self._console = Console(stderr=True)
        self._live: Live | None = None
        self._name, self._unit, self._start = "", "", time.monotonic()
        self._state: tuple[float, float | None] = 0.0, None

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Callable[[float, float], None]:
        """See :meth:`ffsm_mj.cli.progress.Progress.stage`."""
        self._name, self._unit, self._start = one_line(name), unit, time.monotonic()
        self._state = 0.0, total
        if self._live is None:
            self._show()

        def report(done: float, total: float) -> None:
            self._state = done, total

        return report

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """See :meth:`ffsm_mj.cli.progress.Progress.hidden`."""
        self.hide()
        try:
            yield
        finally:
            self._show()

    def hide(self) -> None:
        """Remove the line."""
        live, self._live = self._live, None
        if live is not None:
            with suppress(OSError):
                live.stop()

    def _show(self) -> None:
        # stdout carries the command's result: rich must not redirect it to print above the line.
        live = Live(self, console=self._console, refresh_per_second=10, transient=True, redirect_stdout=False)
        with suppress(OSError):
            live.start()
            self._live = live

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the line at the current width of the terminal, without the bar if it does not fit."""
        (done, total), elapsed = self._state, time.monotonic() - self._start
        if elapsed < _PATIENCE_S:
            return
        if total is not None and done >= total:
            total = None  # all counted work is done, but the stage has not ended
        numbers = f"{self._amount(done, total)}{_clock(done, total, elapsed)}"
        room = min(options.max_width - len(self._name) - len(numbers) - 4, _BAR_CELLS[1])
        if room >= _BAR_CELLS[0]:
            bar = Segment.adjust_line_length(list(console.render(ProgressBar(total, done, room), options)), room)
            line = [Segment(f"{self._name}  "), *bar, Segment(f"  {numbers}")]
        elif len(self._name) + 2 + len(numbers) <= options.max_width:
            line = [Segment(f"{self._name}  {numbers}")]
        else:
            share = f"{100.0 * done / total:.0f} %  " if total else ""
            line = [Segment(share + self._name)]
        yield from Segment.adjust_line_length(line, options.max_width, pad=False)

    def _amount(self, done: float, total: float | None) -> str:
        """``12.3 of 30 s  ``; empty if the amount is unknown."""
        if total is None:
            return ""
        return f"{done:.{1 if self._unit == 's' else 0}f} of {total:g} {self._unit}".rstrip() + "  "


def _clock(done: float, total: float | None, elapsed_s: float) -> str:
    """Remaining time if it can be estimated, else time since the start."""
    if total is None or done <= 0.0 or elapsed_s < _TRUST_S:
        return _minutes(elapsed_s)
    return f"{_minutes(elapsed_s * max(0.0, total / done - 1.0))} left"


def _minutes(time_s: float) -> str:
    return f"{int(time_s) // 60}:{int(time_s) % 60:02d}"
