"""Real time: control ticks wait for a monotonic clock, and how well that succeeds is measured.

Tick k of a run whose first command was known at wall time w is due at w + t_k / factor. What it is late is the jitter of the
clock and of the operating system, or, where the computation of the period before took longer than the period, an overrun.
Ticks that are late do not shift those after them: a run that fell behind catches up.
"""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.records.signals import Signal

_ASLEEP_S = 2e-4
"""Wall time before a tick is due at which the process is awake: Linux wakes it some 60 us late, rarely more than 200."""
_SWITCH_S = 2e-5
"""Longest time for which another thread of Python keeps the interpreter from a tick."""
_LONGEST_SLEEP_S = 0.1
"""Longest time between two looks for an interrupt, s."""
_SIGNALS = (
    ("late_s", "s", "wall time from when this tick was due to when it began"),
    ("law_s", "s", "wall time from the beginning of this tick to its command"),
    ("busy_s", "s", "wall time that the control period before this tick took to compute"),
    ("overruns", "", "control periods so far that took longer to compute than they last"),
)


@contextmanager
def prompt_process() -> Iterator[None]:
    """Context in which nothing of Python holds a tick up that can be done before: imports, and a look at all objects."""
    # What parts of a run import where they first need it, which takes up to a second.
    import scipy.integrate
    import scipy.linalg.lapack
    import scipy.optimize
    import scipy.sparse.linalg
    import scipy.spatial
    import scipy.special  # noqa: F401 (they all)

    switch_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()  # collections look at what is made from here on
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(switch_s)


class WallClock:
    """Paces control ticks.

    Attributes:
        columns: What it measures, by tick.
        runs: Whether it has begun.
    """

    def __init__(self, factor: float, most_late_s: float | None, period_s: float) -> None:
        """Set the pace; nothing is measured yet.

        Args:
            factor: Simulated seconds per second.
            most_late_s: A tick that begins later than this ends the run, s; None: none does.
            period_s: Control period, s.
        """
        self._rate, self._most_late_s = 1.0 / factor, most_late_s
        self._most_busy_s = period_s * self._rate
        self._values = np.zeros(len(_SIGNALS))
        self.columns = Columns(tuple(Signal("clock", *signal) for signal in _SIGNALS), live=self._values)
        self._zero_s, self._began_s, self._first_s = math.nan, math.nan, math.nan
        self.runs, self._is_first = False, False

    def begin(self, time_s: float) -> None:
        """Begin with the decision at a simulation time: now, or if it is at a tick, when its command is known."""
        self.runs = self._is_first = True
        self._first_s, self._values[:] = time_s, 0.0
        self._set_out()

    def _set_out(self) -> None:
        self._began_s = time.perf_counter()
        self._zero_s = self._began_s - self._first_s * self._rate

    def wait(self, time_s: float, poll: Callable[[], object]) -> None:
        """Wait until a simulation time is due; ``poll`` may raise, to end the run.

        Raises:
            RunEnded: It is later than allowed.
        """
        self._is_first, due_s = False, self._zero_s + time_s * self._rate
        self._values[2] = busy_s = time.perf_counter() - self._began_s
        self._values[3] += busy_s > self._most_busy_s
        while (left_s := due_s - time.perf_counter()) > _ASLEEP_S:
            time.sleep(min(left_s - _ASLEEP_S, _LONGEST_SLEEP_S))
            poll()
        while time.perf_counter() < due_s:  # a sleep ends late, a loop does not
            pass
        self._began_s = time.perf_counter()
        self._values[0] = late_s = self._began_s - due_s
        if self._most_late_s is not None and late_s > self._most_late_s:
            text = f"the tick at t = {time_s:.9g} s began {late_s:.3g} s late; allowed are {self._most_late_s:g} s"
            raise RunEnded(Outcome.OVERRUN, text)

    def decided(self) -> None:
        """The command of the tick is known."""
        self._values[1] = time.perf_counter() - self._began_s
        if self._is_first:
            self._set_out()  # a law has all the time to begin: its first evaluation takes many times what others do
