"""Efforts over time: recorded samples, held or joined by straight lines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.controller_protocol import FloatArray

SAME_TIME_S = 1e-9
"""Times closer than this are the same: decimals of a file and multiples of a control period differ by rounding."""


@dataclass(frozen=True)
class EffortRecord:
    """Recorded efforts.

    Attributes:
        times_s: Time of each sample, ascending, (n,), s.
        efforts: Efforts of the samples, (n, number of actuators), N or N m.
        linear: Joined by straight lines; otherwise each sample is held until the next one.
        held_before: Before the first sample its efforts are held; otherwise there are none.
        end_s: End of the record, s: from then on there are no efforts; infinite: the last ones are held.
    """

    times_s: FloatArray
    efforts: FloatArray
    linear: bool
    held_before: bool
    end_s: float

    def sample_at(self, time_s: float) -> int:
        """Position of the last sample at or before a time; -1: there is none."""
        return int(np.searchsorted(self.times_s, time_s + SAME_TIME_S, side="right")) - 1

    def over(self, time_s: float, duration_s: float) -> FloatArray | None:
        """Efforts to hold from a time on for a while, (number of actuators,); None outside of the record.

        Of straight lines it is their mean: held for this time, it has the impulse of the record.
        """
        begin_s = -math.inf if self.held_before else float(self.times_s[0])
        if self.linear:
            from_s, to_s = max(time_s, begin_s), min(time_s + duration_s, self.end_s)
            return self._integral(from_s, to_s) / duration_s if to_s - from_s > SAME_TIME_S else None
        if not begin_s - SAME_TIME_S <= time_s < self.end_s - SAME_TIME_S:
            return None
        return np.asarray(self.efforts[max(self.sample_at(time_s), 0)])

    def _integral(self, from_s: float, to_s: float) -> FloatArray:
        """Integral of the straight lines between two times, with the first and the last efforts outside of them."""
        inside = slice(*np.searchsorted(self.times_s, (from_s, to_s), side="right").tolist())
        knots = np.concatenate(([from_s], self.times_s[inside], [to_s]))
        values = np.array([np.interp(knots, self.times_s, column) for column in self.efforts.T])
        return np.asarray(0.5 * (values[:, 1:] + values[:, :-1]).dot(np.diff(knots)))
