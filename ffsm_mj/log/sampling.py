"""Completeness of the samples of a log: one per control period, none missing, none repeated."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.ties import instant_s

BETWEEN = -2
"""Tick of a sample between two ticks, which ends a run at an event."""
NOWHERE = -1
"""Tick of a sample with a time that is not finite or is negative."""
_MOST_SENTENCES = 5


class Sampling:
    """Assigns control ticks to samples block by block, and collects gaps and repetitions.

    Attributes:
        breaks: The first few gaps and repetitions, as sentences.
        count: Number of all gaps and repetitions.
    """

    def __init__(self, log: RunLog, period_s: float) -> None:
        """Expect the first sample at the start of a run and one after every control period.

        A run that stops at an event has a sample there, between two ticks. From a state at an event the first sample of a
        run is at the next tick.

        Args:
            log: The log of the run.
            period_s: Its control period.

        Raises:
            ValueError: The period is not positive.
        """
        if not period_s > 0.0:
            raise ValueError(f"a control period of {period_s} s")
        self._period, self._last = period_s, math.ceil(logged_start_s(log.header.metadata) / period_s - 1e-6) - 1
        self._instants, self._end_s = np.array(sorted(log.instants_s)), log.outcome.end_s if log.outcome else None
        self.breaks: list[str] = []
        self.count = 0

    def ticks(self, times: FloatArray) -> npt.NDArray[np.int64]:
        """Control tick of each sample; gaps and repetitions are collected.

        Args:
            times: Times of the next samples, s, (n,).

        Returns:
            The tick nearest to each time; ``NOWHERE`` for no finite time, ``BETWEEN`` for an event between two ticks.
        """
        known = np.where(np.isfinite(times), times, NOWHERE * self._period)
        ratios = np.clip(known / self._period, NOWHERE, 1e15)
        ticks = np.rint(ratios).astype(np.int64)
        between = np.isin(times, self._instants) & (
            np.abs(known - ticks * self._period) > instant_s(float(known.max(initial=0.0)))
        )
        # A sample between two ticks, which ends a run at an event, counts as the next tick.
        marks = np.concatenate(([self._last], np.where(between, np.floor(ratios).astype(np.int64) + 1, ticks)))
        for i in np.flatnonzero(np.diff(marks) != 1):
            self._add_break(int(marks[i]), int(marks[i + 1]))
        self._last = int(marks[-1])
        return np.where(between, BETWEEN, ticks)

    def end(self) -> None:
        """Check that the samples reach the end of the run, if it is known."""
        if self._end_s is not None and self._end_s - self._last * self._period > 1.5 * self._period:
            self._add_sentence(f"samples are missing from {max(self._last, 0) * self._period:.9g} to {self._end_s:.9g} s")

    def _add_break(self, before: int, after: int) -> None:
        was, now = max(before, 0) * self._period, max(after, 0) * self._period
        if after > before:
            self._add_sentence(f"samples are missing from {was:.9g} to {now:.9g} s")
        elif after == before:
            self._add_sentence(f"the sample at {now:.9g} s occurs twice")
        else:
            self._add_sentence(f"the sample at {now:.9g} s follows the one at {was:.9g} s")

    def _add_sentence(self, text: str) -> None:
        self.count += 1
        if len(self.breaks) < _MOST_SENTENCES:
            self.breaks.append(text)

    def sentence(self) -> str:
        """The first gaps and repetitions in one line; empty if there are none."""
        more = [f"and {self.count - len(self.breaks)} more"] if self.count > len(self.breaks) else []
        return "; ".join(self.breaks + more)
