"""Efforts over time: recorded samples, held or joined by straight lines, and their means over control ticks."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ffsm_mj.controller_protocol import FloatArray
from ffsm_mj.tolerances import SCHEDULED_S

Interpolation = Literal["held", "mean", "linear"]


@dataclass(frozen=True)
class EffortRecord:
    """Recorded efforts.

    Attributes:
        times_s: Time of each sample, ascending, (n,), s.
        efforts: Efforts of the samples, (n, number of actuators), N or N m.
        interpolation: ``held``: each sample is held until the next one; ``mean``: the same, and a control tick has the mean
            over its period; ``linear``: joined by straight lines, with means likewise.
        end_s: End of the record, s.
        hold_before: Before the first sample its efforts are held; otherwise there are none.
        hold_after: After the end the last efforts are held; otherwise there are none.
    """

    times_s: FloatArray
    efforts: FloatArray
    interpolation: Interpolation
    end_s: float
    hold_before: bool = False
    hold_after: bool = False

    def sample_at(self, time_s: float) -> int:
        """Position of the last sample at or before a time; -1: there is none."""
        return bisect_right(self._times, time_s + SCHEDULED_S) - 1

    @cached_property
    def _times(self) -> list[float]:
        """Times as a list, in which a search for a single number is faster than in an array."""
        times: list[float] = self.times_s.tolist()
        return times

    def over(self, time_s: float, duration_s: float) -> FloatArray | None:
        """Efforts to hold from a time on for a while, (number of actuators,); None outside of the record.

        A mean that is held for this time has the impulse of the record.
        """
        begin_s = -math.inf if self.hold_before else self._times[0]
        end_s = math.inf if self.hold_after else self.end_s
        if self.interpolation == "held":
            inside = begin_s - SCHEDULED_S <= time_s < end_s - SCHEDULED_S
            return self.efforts[max(self.sample_at(time_s), 0)] if inside else None
        from_s, to_s = max(0.0, begin_s - time_s), min(duration_s, end_s - time_s)
        return self._integral(time_s, from_s, to_s) / duration_s if to_s - from_s > SCHEDULED_S else None

    def _integral(self, time_s: float, from_s: float, to_s: float) -> FloatArray:
        """Integral between two times after a third; outside of the samples, the first or the last efforts are held.

        Differences of times are taken first: at large times, their rounding would be that of the times.
        """
        begin, end = (bisect_right(self._times, time_s + after_s) for after_s in (from_s, to_s))
        knots = np.concatenate(([from_s], np.clip(self.times_s[begin:end] - time_s, from_s, to_s), [to_s]))
        if self.interpolation == "mean":
            samples = np.maximum(np.arange(begin - 1, end), 0)
            return np.asarray(np.diff(knots).dot(self.efforts[samples]))
        near = slice(max(begin - 1, 0), end + 1)
        times = self.times_s[near] - time_s
        values = np.array([np.interp(knots, times, column) for column in self.efforts[near].T])
        return np.asarray((0.5 * (values[:, 1:] + values[:, :-1])).dot(np.diff(knots)))
