"""How intervals narrow with the number of runs, looked at where that is a power of 2."""

from __future__ import annotations

from dataclasses import dataclass

from ffsm_mj.campaign.evaluation.results import Results, is_good, measured
from ffsm_mj.campaign.evaluation.statistics import Proportion, quantile

SUCCESS = "success"
_FIRST = 8


@dataclass(frozen=True)
class IntervalAtRuns:
    """What the first runs tell.

    Attributes:
        runs: How many of them.
        value: Share of good runs, or median of a metric.
        low: Lower end of its interval; None where there is none.
        high: Upper end; None where there is none.
    """

    runs: int
    value: float
    low: float | None
    high: float | None

    @property
    def width(self) -> float | None:
        """Width of the interval; None where an end is missing."""
        return None if self.low is None or self.high is None else self.high - self.low


def interval_at(results: Results, what: str, runs: int) -> IntervalAtRuns | None:
    """What the first runs tell of ``success`` or of the median of a metric; None where none of them has it."""
    rows = results.beginning[:runs]
    if what == SUCCESS:
        share = Proportion(sum(map(is_good, rows)), len(rows))
        return IntervalAtRuns(runs, share.value, *share.interval)
    values = measured(rows, what)
    if not len(values):
        return None
    median = quantile(values, 0.5)
    return IntervalAtRuns(runs, median.value, median.low, median.high)


def intervals(results: Results, what: str) -> list[IntervalAtRuns]:
    """The same at all powers of 2, from 8 runs on."""
    counts = []
    runs = _FIRST
    while runs <= len(results.beginning):
        counts.append(runs)
        runs *= 2
    return [found for runs in counts if (found := interval_at(results, what, runs)) is not None]


def narrow_enough(results: Results, what: str, width: float) -> bool:
    """Whether the interval was as narrow at the last power of 2 of runs."""
    found = intervals(results, what)
    return bool(found) and found[-1].width is not None and found[-1].width <= width
