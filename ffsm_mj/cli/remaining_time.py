"""Estimate of the time that a stage of a command still takes, from the amounts that it reports."""

from __future__ import annotations

import time
from collections import deque

_FIRST_S = 1.0
"""Time from the first report to the first estimate: shorter, it would be that of the first, slow steps."""
_WINDOW_S = 8.0
"""The rate is that of this time: a run has slow parts, such as series of impacts."""


class RemainingTime:
    """Rate of progress over the last seconds. Time before the first report, such as imports, does not count."""

    def __init__(self) -> None:
        """Start without a report."""
        self._reports: deque[tuple[float, float]] = deque()
        self._first_s: float | None = None

    def add(self, done: float, now_s: float | None = None) -> None:
        """Note an amount done.

        Args:
            done: Amount done so far.
            now_s: Time in s of any clock; None: now.
        """
        now_s = time.monotonic() if now_s is None else now_s
        self._first_s = now_s if self._first_s is None else self._first_s
        self._reports.append((now_s, done))
        while len(self._reports) > 2 and self._reports[1][0] <= now_s - _WINDOW_S:
            self._reports.popleft()

    def seconds(self, total: float) -> float | None:
        """Remaining time, s; None if it is not known yet."""
        if self._first_s is None:
            return None
        (then_s, before), (now_s, done) = self._reports[0], self._reports[-1]
        if now_s - self._first_s < _FIRST_S or not done > before:
            return None
        return max(0.0, total - done) * (now_s - then_s) / (done - before)


def clock(seconds: float | None) -> str:
    """Text of a remaining time, e.g. ``0:18 left`` or ``2:05:00 left``; empty if it is not known."""
    if seconds is None or not seconds < 1e6:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d} left" if hours else f"{minutes}:{rest:02d} left"
