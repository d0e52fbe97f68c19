"""Progress of many runs as lines on stderr, for output that is not a terminal."""

from __future__ import annotations

import time

from ffsm_mj.cli.standard_streams import complain

_LINE_EVERY_S = 30.0


class BatchProgress:
    """Progress as lines on stderr, if it is not a terminal."""

    def __init__(self, name: str) -> None:
        """Start the clock.

        Args:
            name: What is being run.
        """
        self._name, self._begun, self._first = name, time.monotonic(), -1.0
        self._next = self._begun + _LINE_EVERY_S

    def __call__(self, done: float, total: float) -> None:
        """Print a line every 30 s.

        Args:
            done: Number of runs that have a row.
            total: Number of runs.
        """
        now = time.monotonic()
        self._first = done if self._first < 0.0 else self._first
        if now < self._next or done >= total:
            return
        self._next = now + _LINE_EVERY_S
        per_s = (done - self._first) / (now - self._begun)
        left = f", {(total - done) / per_s / 60.0:.0f} min left" if per_s > 0.0 else ""
        complain(f"{self._name}: {done:.0f} of {total:.0f} runs, {per_s * 60.0:.0f} a minute{left}")
