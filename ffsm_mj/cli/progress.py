"""Progress of a command: a line on a terminal; of many runs also lines on stderr where it is none."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from ffsm_mj.errors import plural

Report = Callable[[float, float], None]
"""Callback (amount done, total amount), called as often as convenient."""
Stage = Callable[..., Report | None]
"""Begins a stage; see :meth:`Progress.stage`."""
_LINE_EVERY_S = 30.0


class Progress:
    """Progress of a command, in stages; this one is not displayed."""

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report | None:  # noqa: ARG002
        """Begin the next stage.

        Args:
            name: Name of the stage.
            unit: Unit of the reported amounts: ``s``, or what is counted.
            total: Total amount, if it is known in advance.

        Returns:
            Callback for the progress of the stage; None if progress is not displayed.
        """
        return None

    def hidden(self) -> AbstractContextManager[None]:
        """Hide the display while something else is printed."""
        return nullcontext()


class Pace:
    """Remaining time of a stage that counts, such as the runs of a campaign, at its mean rate.

    The first runs come late: processes start and compile models before them, and their neighbours are half done. The rate is
    therefore that since something was done for the first time, and unknown until that is as long ago as it took.
    Between two reports the remaining time counts down, so that it is steady however seldom something is done.
    """

    def __init__(self) -> None:
        """Begin without reports."""
        self._begun: tuple[float, float] | None = None
        self._first: tuple[float, float] | None = None
        self._last = 0.0, 0.0

    def add(self, done: float) -> None:
        """Note an amount that is done."""
        now = time.monotonic()
        if self._begun is None:
            self._begun = self._last = done, now
        elif done != self._last[0]:
            self._last = done, now
            self._first = self._first or self._last

    def per_s(self) -> float | None:
        """Mean rate; None: unknown."""
        if self._begun is None or self._first is None:
            return None
        (_, begun_s), (first, first_s), (done, done_s) = self._begun, self._first, self._last
        return (done - first) / (done_s - first_s) if done_s - first_s >= first_s - begun_s and done > first else None

    def left_s(self, total: float) -> float | None:
        """Remaining time, s; None: unknown."""
        rate, (done, done_s) = self.per_s(), self._last
        return None if rate is None else max((total - done) / rate - (time.monotonic() - done_s), 0.0)


def lines_of_runs(name: str, complain: Callable[[str], None]) -> Report:
    """Callback that prints a line every 30 s: runs done, rate and remaining time."""
    pace, due = Pace(), time.monotonic() + _LINE_EVERY_S

    def report(done: float, total: float) -> None:
        nonlocal due
        pace.add(done)
        if (now := time.monotonic()) < due or done >= total:
            return
        due = now + _LINE_EVERY_S
        rate, left_s = pace.per_s(), pace.left_s(total)
        known = "" if rate is None or left_s is None else f", {rate * 60.0:.0f} a minute, {left_s / 60.0:.0f} min left"
        complain(f"{name}: {done:.0f} of {plural(round(total), 'run')}{known}")

    return report
