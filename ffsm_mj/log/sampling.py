"""Whether the samples of a log follow each other by the control period, none missing, none twice."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray

BETWEEN = -2
"""Stands for the tick of a sample that ends a run between two ticks."""
NOWHERE = -1
"""Stands for the tick of a sample whose time is not finite, or before t = 0."""
_MOST_TOLD = 5


class Sampling:
    """Counts the control ticks of samples, given a block at a time.

    Attributes:
        breaks: Places at which the samples do not follow each other, as sentences; the first few.
        count: How many such places there are.
    """

    def __init__(self, period_s: float, instants: Iterable[float] = ()) -> None:
        """Expect the first sample at t = 0 and one every period after it.

        Args:
            period_s: Control period.
            instants: Times of impacts, s: a run that stops at one has a sample there, between two ticks.

        Raises:
            ValueError: The period is not positive.
        """
        if not period_s > 0.0:
            raise ValueError(f"a control period of {period_s} s")
        self._period, self._last = period_s, NOWHERE
        self._instants = np.array(sorted(instants))
        self.breaks: list[str] = []
        self.count = 0

    def ticks(self, times: FloatArray) -> npt.NDArray[np.int64]:
        """Number of the control tick of each sample; notes what does not follow.

        Args:
            times: Times of the next samples, s, (n,).

        Returns:
            The tick nearest to each time, -1 where it is not finite, BETWEEN where it is that of an impact and of no tick.
        """
        known = np.where(np.isfinite(times), times, NOWHERE * self._period)
        ratios = np.clip(known / self._period, NOWHERE, 1e15)
        ticks = np.rint(ratios).astype(np.int64)
        between = np.isin(times, self._instants) & (np.abs(ratios - ticks) > 1e-6)
        marks = np.concatenate(([self._last], np.where(between, np.floor(ratios).astype(np.int64) + 1, ticks)))
        for i in np.flatnonzero(np.diff(marks) != 1):
            self._note(int(marks[i]), int(marks[i + 1]))
        self._last = int(marks[-1])
        return np.where(between, BETWEEN, ticks)

    def end(self, end_s: float | None) -> None:
        """Say when the run ended, where that is known: the samples must reach it."""
        if end_s is not None and end_s - self._last * self._period > 1.5 * self._period:
            self._tell(f"samples are missing from {max(self._last, 0) * self._period:.9g} to {end_s:.9g} s")

    def _note(self, before: int, after: int) -> None:
        was, now = max(before, 0) * self._period, max(after, 0) * self._period
        if after > before:
            self._tell(f"samples are missing from {was:.9g} to {now:.9g} s")
        elif after == before:
            self._tell(f"the sample at {now:.9g} s is there twice")
        else:
            self._tell(f"the sample at {now:.9g} s comes after that at {was:.9g} s")

    def _tell(self, text: str) -> None:
        self.count += 1
        if len(self.breaks) < _MOST_TOLD:
            self.breaks.append(text)

    def sentence(self) -> str:
        """What does not follow, in a line; empty where every sample follows the one before."""
        more = [f"and {self.count - len(self.breaks)} more"] if self.count > len(self.breaks) else []
        return "; ".join(self.breaks + more)
