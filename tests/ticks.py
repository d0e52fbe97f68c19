"""Control ticks of a run under test: something done at each of them, or the loop without the core's free flight."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from ffsm_mj.simulation.rows import LogWriter
from ffsm_mj.simulation.steps import FreeFlight


def at_each_tick(monkeypatch: pytest.MonkeyPatch, action: Callable[[float], object]) -> None:
    """Call a function with the time of each row once that is written, whoever takes the tick."""
    row, take = LogWriter.row, FreeFlight.take

    def written(self, time_s):
        row(self, time_s)
        action(time_s)

    def taken(self, command, decide, interrupted, report):
        def reported(time_s):
            action(time_s)
            if report is not None:
                report(time_s)

        return take(self, command, decide, interrupted, reported)

    monkeypatch.setattr(LogWriter, "row", written)
    monkeypatch.setattr(FreeFlight, "take", taken)


def in_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the loop take every tick: methods that a test replaces are called there."""
    monkeypatch.setattr(FreeFlight, "take", lambda *_: (0, 0.0))
