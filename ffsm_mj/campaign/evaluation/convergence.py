"""Confidence intervals as a function of the number of runs, at powers of 2."""

from __future__ import annotations

from dataclasses import dataclass

from ffsm_mj.campaign.evaluation.results import Results, is_good, metric_numbers
from ffsm_mj.campaign.evaluation.statistics import Proportion, quantile

SUCCESS = "success"
_FIRST = 8


@dataclass(frozen=True)
class IntervalAtRuns:
    """Estimate from the first runs, with its confidence interval.

    Attributes:
        runs: Number of runs.
        value: Fraction of good runs, or median of a metric.
        low: Lower end of the interval; None if unbounded.
        high: Upper end of the interval; None if unbounded.
    """

    runs: int
    value: float
    low: float | None
    high: float | None

    @property
    def width(self) -> float | None:
        """Width of the interval; None if it is unbounded."""
        return None if self.low is None or self.high is None else self.high - self.low


def interval_at(results: Results, what: str, runs: int) -> IntervalAtRuns | None:
    """Estimate of ``success`` or of the median of a metric from the first runs; None if none has the metric."""
    rows = results.complete_part[:runs]
    if what == SUCCESS:
        share = Proportion(sum(map(is_good, rows)), len(rows))
        return IntervalAtRuns(runs, share.value, *share.interval)
    values = metric_numbers(rows, what)
    if not len(values):
        return None
    median = quantile(values, 0.5)
    return IntervalAtRuns(runs, median.value, median.low, median.high)


def intervals(results: Results, what: str) -> list[IntervalAtRuns]:
    """Estimates at all powers of 2 from 8 runs."""
    counts = []
    runs = _FIRST
    while runs <= len(results.complete_part):
        counts.append(runs)
        runs *= 2
    return [found for runs in counts if (found := interval_at(results, what, runs)) is not None]


def narrow_enough(results: Results, what: str, width: float) -> bool:
    """Whether the interval at the largest power of 2 is at most this wide."""
    found = intervals(results, what)
    return bool(found) and found[-1].width is not None and found[-1].width <= width
