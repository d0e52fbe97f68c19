"""Proportions and quantiles of a sample with distribution-free confidence intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Proportion:
    """A proportion with Wilson's confidence interval.

    Attributes:
        count: Number of successes.
        of: Number of trials, at least one.
    """

    count: int
    of: int

    @property
    def value(self) -> float:
        """The proportion."""
        return self.count / self.of

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's two-sided interval at the level CONFIDENCE."""
        from scipy.stats import binomtest  # slow to import

        found = binomtest(self.count, self.of).proportion_ci(CONFIDENCE, method="wilson")
        return float(found.low), float(found.high)


@dataclass(frozen=True)
class Quantile:
    """A quantile with a confidence interval between two order statistics.

    Attributes:
        share: Probability of the quantile.
        value: Order statistic that estimates it.
        low: Lower end of the interval; None if there are too few values for a lower bound.
        high: Upper end of the interval; None if there are too few values for an upper bound.
    """

    share: float
    value: float
    low: float | None
    high: float | None


def quantile(values: FloatArray, share: float) -> Quantile:
    """Estimate a quantile of the distribution of values.

    The number of values below the quantile is binomial for every distribution; the ranks of the interval are quantiles of
    that number. An end beyond the smallest or largest value does not exist.

    Args:
        values: At least one value, no NaN.
        share: Probability of the quantile, in the open interval (0, 1).
    """
    from scipy.stats import binom

    ordered = np.sort(values)
    n, tail = len(ordered), 0.5 * (1.0 - CONFIDENCE)
    lower, upper = int(binom.ppf(tail, n, share)), int(binom.ppf(1.0 - tail, n, share)) + 1  # ranks, from 1
    return Quantile(
        share,
        float(ordered[max(math.ceil(n * share), 1) - 1]),
        float(ordered[lower - 1]) if lower >= 1 else None,
        float(ordered[upper - 1]) if upper <= n else None,
    )


def values_for_bound(share: float, confidence: float) -> int:
    """Number of values whose largest exceeds a quantile with this confidence (Wilks)."""
    return math.ceil(math.log(1.0 - confidence) / math.log(share))


def values_for_upper_end(share: float) -> int:
    """Number of values that :func:`quantile` needs for an upper end."""
    return values_for_bound(share, 0.5 * (1.0 + CONFIDENCE))


def is_constant(values: FloatArray) -> bool:
    """Whether all values agree to rounding, which makes rank statistics meaningless."""
    spread = float(np.ptp(values)) if len(values) else 0.0
    return spread <= 1e-12 * float(np.max(np.abs(values), initial=0.0))
