"""Shares and quantiles of a sample, each with an interval that holds for every distribution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Proportion:
    """So many of so many, with Wilson's interval.

    Attributes:
        count: How many.
        of: Of how many, one or more.
    """

    count: int
    of: int

    @property
    def value(self) -> float:
        """The share."""
        return self.count / self.of

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval, CONFIDENCE two-sided."""
        from scipy.stats import binomtest  # SciPy's statistics cost: for those who use them

        found = binomtest(self.count, self.of).proportion_ci(CONFIDENCE, method="wilson")
        return float(found.low), float(found.high)


@dataclass(frozen=True)
class Quantile:
    """A quantile and its interval between two order statistics.

    Attributes:
        share: Of the values that lie below.
        value: The order statistic that estimates it.
        low: Lower end of the interval; None where so few values have no lower bound.
        high: Upper end; None where so few values have no upper bound.
    """

    share: float
    value: float
    low: float | None
    high: float | None


def quantile(values: FloatArray, share: float) -> Quantile:
    """A quantile of the distribution that values come from.

    The number of values below the quantile is binomial, whatever the distribution: the ranks of the interval are quantiles
    of that. Where an end would lie beyond the least or greatest value there is none.

    Args:
        values: One or more, none of them NaN.
        share: 0 to 1, both excluded.
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
    """How many values it takes for the greatest of them to lie above a quantile with a confidence (Wilks)."""
    return math.ceil(math.log(1.0 - confidence) / math.log(share))


def values_for_upper_end(share: float) -> int:
    """How many values :func:`quantile` needs for an upper end."""
    return values_for_bound(share, 0.5 * (1.0 + CONFIDENCE))


def is_constant(values: FloatArray) -> bool:
    """Whether all values are one, to rounding: no statistics of ranks means anything then."""
    spread = float(np.ptp(values)) if len(values) else 0.0
    return spread <= 1e-12 * float(np.max(np.abs(values), initial=0.0))
