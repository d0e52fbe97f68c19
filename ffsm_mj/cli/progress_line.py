"""Progress line at the bottom of a terminal: stage, bar, amount done and remaining time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress

from rich import progress as rich
from rich.console import Console, RenderableType
from rich.table import Column

from ffsm_mj.cli.progress import Pace, Progress, Report
from ffsm_mj.errors import one_line

_PATIENCE_S = 0.4
"""A stage that takes less time than this shows no line."""
_WINDOW_S = 8.0
"""The remaining time of a run follows from the rate over this time: it has slow parts, such as series of impacts."""
_LEAST_CELLS = 60
"""A narrower terminal shows the percentage and the name of the stage alone."""


def _text(template: str) -> rich.TextColumn:
    """Column of a text, cut where it is too long; names come from files and are no markup."""
    return rich.TextColumn(template, markup=False, table_column=Column(no_wrap=True, overflow="crop"))


_NAME, _AMOUNT = "{task.description}", "{task.completed:.{task.fields[digits]}f} of {task.total:g} {task.fields[unit]}"
_HEAD = (_text(_NAME), rich.BarColumn(), _text(_AMOUNT))
_SIMULATED = (*_HEAD, rich.TimeRemainingColumn(compact=True), _text("left"))
_COUNTED = (*_HEAD, _text("{task.fields[left]} left"))
_UNCOUNTED = (_text(_NAME), rich.BarColumn(), rich.TimeElapsedColumn())


def _clock(left_s: float | None) -> str:
    """A remaining time; unknown: ``-:--``."""
    if left_s is None:
        return "-:--"
    minutes, seconds = divmod(round(left_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes:02}:{seconds:02}"


class ProgressLine(rich.Progress, Progress):
    """Progress line of rich with one task, the stage; redrawn from the last reported amounts, so that reporting is cheap.

    If the terminal goes away, only the line is lost.
    """

    def __init__(self) -> None:
        """Start without a stage; nothing is displayed yet."""
        self._reported: tuple[float, float | None] = 0.0, None
        self._pace = Pace()
        # stdout carries the command's result: rich must not redirect it to print above the line.
        console = Console(stderr=True)
        super().__init__(console=console, transient=True, redirect_stdout=False, speed_estimate_period=_WINDOW_S)

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report:
        """See :meth:`ffsm_mj.cli.progress.Progress.stage`."""
        with suppress(OSError):
            for task in self.task_ids:
                self.remove_task(task)
            self._reported, self._pace = (0.0, total), Pace()
            self.add_task(one_line(name), visible=False, total=total, unit=unit, digits=1 if unit == "s" else 0, left="")
            self.start()

        def report(done: float, total: float) -> None:
            self._reported = done, total
            self._pace.add(done)

        return report

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """See :meth:`ffsm_mj.cli.progress.Progress.hidden`."""
        self.hide()
        try:
            yield
        finally:
            with suppress(OSError):
                self.start()

    def hide(self) -> None:
        """Remove the line."""
        with suppress(OSError):
            self.stop()

    def get_renderables(self) -> Iterable[RenderableType]:
        """Update the task and choose its columns; called by rich at each redraw."""
        done, total = self._reported
        for task in self.tasks:
            # Once all that was counted is done, the stage may still go on: the bar pulses.
            task.total = None if total is None or done >= total else total
            left = "" if task.total is None else _clock(self._pace.left_s(task.total))
            self.update(task.id, completed=done, visible=(task.elapsed or 0.0) >= _PATIENCE_S, left=left)
            of = _SIMULATED if task.fields["unit"] == "s" else _COUNTED
            self.columns = of if task.total is not None else _UNCOUNTED
            if self.console.width < _LEAST_CELLS:
                self.columns = (_text(("{task.percentage:.0f} %  " if task.total is not None else "") + _NAME),)
        return super().get_renderables()
