"""Progress line at the bottom of a terminal: stage, bar, amount done and remaining time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress

from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.table import Column

from ffsm_mj.cli.remaining_time import RemainingTime, clock
from ffsm_mj.errors import one_line

_PATIENCE_S = 0.4
"""A stage that takes less time than this shows no line."""
_BAR_CELLS = (8, 40)
_NUMBERS_CELLS = 30  # amount, time and the blanks between the columns


class ProgressLine(Progress):
    """Progress line of rich with one task, the stage; redrawn from the last reported amounts, so that reporting is cheap.

    If the terminal goes away, only the line is lost.
    """

    def __init__(self) -> None:
        """Start without a stage; nothing is displayed yet."""
        self._reported: tuple[float, float | None] = 0.0, None
        self._remaining = RemainingTime()
        self._started = False
        # stdout carries the command's result: rich must not redirect it to print above the line.
        super().__init__(console=Console(stderr=True), transient=True, redirect_stdout=False)

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Callable[[float, float], None]:
        """See :meth:`ffsm_mj.cli.progress.Progress.stage`."""
        with suppress(OSError):
            for task in self.task_ids:
                self.remove_task(task)
            self._reported = 0.0, total
            self._remaining, self._started = RemainingTime(), False
            self.add_task(one_line(name), visible=False, total=total, unit=unit, digits=1 if unit == "s" else 0)
            self.start()

        def report(done: float, total: float) -> None:
            self._reported, self._started = (done, total), True

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
        """Update the task and fit the columns to the current width of the terminal; called by rich at each redraw."""
        done, total = self._reported
        if self._started:
            self._remaining.add(done)
        for task in self.tasks:
            # Once all that was counted is done, the stage may still go on: the bar pulses.
            task.total = None if total is None or done >= total else total
            self.update(task.id, completed=done, visible=(task.elapsed or 0.0) >= _PATIENCE_S)
            self.columns = self._columns(task)
        return super().get_renderables()

    def _columns(self, task: Task) -> tuple[ProgressColumn, ...]:
        """Columns that fit: without the bar, or the percentage and the name alone, on a narrow terminal."""
        counted = task.total is not None
        room = self.console.width - cell_len(task.description) - _NUMBERS_CELLS
        if room < 0:
            return (_text(("{task.percentage:.0f} %  " if counted else "") + "{task.description}"),)
        bar = (BarColumn(min(room, _BAR_CELLS[1])),) if room >= _BAR_CELLS[0] else ()
        if not counted:
            return (_text("{task.description}"), *bar, TimeElapsedColumn())
        amount = _text("{task.completed:.{task.fields[digits]}f} of {task.total:g} {task.fields[unit]}")
        left = clock(self._remaining.seconds(task.total or 0.0))
        return (_text("{task.description}"), *bar, amount, _text(left))


def _text(template: str) -> TextColumn:
    """Column of a text, cut where it is too long; names come from files and are no markup."""
    return TextColumn(template, markup=False, table_column=Column(no_wrap=True, overflow="crop"))
