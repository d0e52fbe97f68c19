"""Statistics of the results of a campaign: intervals, convergence, runs without success, sensitivities."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.experiments.results import GOOD, SUCCESS, Results, TableRow, finite, numbers, passed
from ffsm_mj.report.markdown import number, percent

if TYPE_CHECKING:
    from pandas import DataFrame

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

        bounds = binomtest(self.count, self.of).proportion_ci(CONFIDENCE, method="wilson")
        return float(bounds.low), float(bounds.high)

    @property
    def interval_text(self) -> str:
        """The interval as text."""
        low, high = self.interval
        return f"{percent(low)} to {percent(high)}"


def mean_text(values: FloatArray) -> str:
    """Mean of some values with its interval as text."""
    low, high = mean_interval(values)
    if math.isnan(low):
        return number(float(values.mean()))
    mean, low_text, high_text = (number(value, digits_of(low, high)) for value in (float(values.mean()), low, high))
    return f"{mean} ({low_text} to {high_text})"


def digits_of(low: float, high: float) -> int:
    """Digits with which the ends of an interval have two digits of their difference, at least four."""
    if is_constant(np.array([low, high])):
        return 4
    first, differs = (math.floor(math.log10(value)) for value in (max(abs(low), abs(high)), high - low))
    return max(4, first - differs + 2)


_RESAMPLES = 10_000
"""Of these 250 lie beyond each end of a 95 % interval, which is known to 1 / sqrt(250), 6 % of that probability."""
_BLOCK = 500
"""Resamples at once: of 4096 values they take 16 MB."""
_MOST_RESAMPLED = 4096
"""Largest number of values that are resampled: the jackknife of the bootstrap takes a time of order n^2. Beyond, the
skewness s shifts an end by s (1 + 2 z^2) / (6 sqrt(n)) standard errors (z = 1.96), below 0.05 for s = 2, an exponential
distribution."""


def mean_interval(values: FloatArray) -> tuple[float, float]:
    """Interval of a mean at the level CONFIDENCE; NaN below two values.

    Bootstrap, bias-corrected and accelerated (Efron 1987); beyond :data:`_MOST_RESAMPLED` values Student's interval. The
    resamples have a seed of their own: the same values give the same interval. It is expanded as that of a normal sample
    is by Student's distribution and the unbiased variance (Hesterberg 2015, The American Statistician 69(4):371), without
    which intervals of few values are too narrow: some 92 % of those of 16 values contain the mean, not 95 %.
    """
    n = len(values)
    if n < 2:
        return math.nan, math.nan
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    from scipy.stats import bootstrap, norm, sem, t  # slow to import

    quantile_of_t = t.ppf(0.5 * (1.0 + CONFIDENCE), n - 1)
    if n > _MOST_RESAMPLED:
        mean, half = float(values.mean()), float(quantile_of_t * sem(values))
        return mean - half, mean + half
    tail = norm.sf(math.sqrt(n / (n - 1.0)) * quantile_of_t)
    level = 1.0 - 2.0 * max(float(tail), 1.0 / _RESAMPLES)
    random = np.random.default_rng(0)
    resampled = bootstrap((values,), np.mean, n_resamples=_RESAMPLES, batch=_BLOCK, confidence_level=level, rng=random)
    low, high = resampled.confidence_interval
    return float(low), float(high)


@dataclass(frozen=True)
class Estimate:
    """A quantile with a confidence interval between two order statistics, or a fraction with Wilson's.

    Attributes:
        value: The estimate; of a quantile an order statistic.
        low: Lower end of the interval; None if there are too few values for a lower bound.
        high: Upper end of the interval; None if there are too few values for an upper bound.
    """

    value: float
    low: float | None
    high: float | None

    @property
    def width(self) -> float | None:
        """Width of the interval; None if it is unbounded."""
        return None if self.low is None or self.high is None else self.high - self.low


def quantile(values: FloatArray, share: float) -> Estimate:
    """Estimate a quantile of the distribution of values.

    The number of values below the quantile is binomial for every distribution, so an interval ends at two of the values; an
    end beyond the smallest or largest value does not exist.

    Args:
        values: At least one value, no NaN.
        share: Probability of the quantile, in the open interval (0, 1).
    """
    from scipy.stats import quantile_test

    ends = quantile_test(values, p=share).confidence_interval(CONFIDENCE)
    low, high = (None if math.isnan(end) else float(end) for end in ends)
    return Estimate(float(np.quantile(values, share, method="inverted_cdf")), low, high)


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


_FIRST = 8
"""Intervals are estimated at 2^k runs from this number on: the interval of a median needs 6 values for both ends."""


def intervals(results: Results, what: str) -> dict[int, Estimate]:
    """Fraction of good runs (``success``), or median of a metric, from the first 2^k runs, by their number.

    Numbers of runs at which none has the metric are left out.
    """
    complete, points = results.complete_part, dict[int, Estimate]()
    runs = _FIRST
    while runs <= len(complete):
        rows = complete[:runs]
        if what == SUCCESS:
            share = Proportion(int(rows[GOOD].sum()), runs)
            points[runs] = Estimate(share.value, *share.interval)
        elif len(values := finite(passed(rows), what)):
            points[runs] = quantile(values, 0.5)
        runs *= 2
    return points


NO_SUCCESS = "no success"
"""Group of completed runs that pass their checks but do not meet the success condition."""
_LEAST = 5
"""Smallest number of runs on either side for a comparison: 5 of 10 runs have a p-value of 0.008 at the least, 4 of 8 one of
0.03, which Holm's correction for two parameters makes insignificant."""


@dataclass(frozen=True)
class FailureGroup:
    """Runs that failed in the same way.

    Attributes:
        how: Outcome, with the type of an ``error`` or ``internal_error``; for completed runs, what they do not pass.
        phase: Last phase that began; empty if none did.
        runs: Indices of the runs.
        message: Message of the first run.
    """

    how: str
    phase: str
    runs: tuple[int, ...]
    message: str


def groups(results: Results) -> list[FailureGroup]:
    """Groups of runs that are not good, the largest group first."""
    bad = results.frame[~results.frame[GOOD]]
    how = [_how(row) for row in bad.to_dict("records")]
    failure_groups = [
        FailureGroup(name, phase, tuple(rows.index.tolist()), rows["message"].iloc[0])
        for (name, phase), rows in bad.assign(how=how).groupby(["how", "phase"], sort=False)
    ]
    return sorted(failure_groups, key=lambda group: (-len(group.runs), group.runs))


def _how(row: TableRow) -> str:
    if row["outcome"] == "completed":
        short = row.get("fails_by_truncation") is True
        how = "checks fail by the truncation of the step alone" if short else "a check fails"
        return how if row["failed"] else NO_SUCCESS
    error = ""
    if row["outcome"] == "error":
        error = row["message"].partition(":")[0]
    elif row["outcome"] == "internal_error":  # "at t = 0.3 s: ZeroDivisionError: ..."
        error = row["message"].partition(": ")[2].partition(":")[0]
    return f"{row['outcome']} ({error})" if error else str(row["outcome"])


def parameter_differences(results: Results) -> DataFrame:
    """Differences between good and other runs by parameter, the smallest p-value first.

    Returns:
        By parameter ``statistic``, that of Kolmogorov and Smirnov, the largest distance of the two distribution functions,
        and ``probability``, the p-value corrected for the number of parameters; empty if there are too few runs on either
        side.
    """
    import pandas as pd  # slow to import
    from scipy.stats import ks_2samp  # slow to import

    good = results.sample[GOOD].to_numpy(np.bool_)
    compared: dict[str, tuple[float, float]] = {}
    for parameter in results.parameters:
        values = numbers(results.sample, parameter)
        sides = [values[side & np.isfinite(values)] for side in (good, ~good)]
        if min(map(len, sides)) >= _LEAST:
            compared[parameter] = tuple(ks_2samp(*sides))
    frame = pd.DataFrame.from_dict(compared, orient="index", columns=["statistic", "probability"])
    frame = frame.assign(probability=holm(frame["probability"].to_numpy(np.float64)))
    return frame.sort_values(["probability", "statistic"], ascending=[True, False])


def holm(probabilities: FloatArray) -> FloatArray:
    """p-values with Holm's correction, which bounds the probability of any false positive, (n,)."""
    order, corrected = np.argsort(probabilities, kind="stable"), np.empty(len(probabilities))
    falling = np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(probabilities[order] * falling), 1.0)
    return corrected


_BOOTSTRAPS = 999
"""Of these 25 lie beyond each end of a 95 % interval: enough for the two digits that are printed."""
_LEAST_POINTS = 8
"""Below, resamples of the points repeat a few of them, and the intervals say nothing."""
LEAST_RANKED = 10
"""Smallest number of runs for a rank correlation: of 10 independent pairs 5 % have one above 0.65 in magnitude."""


def rank_correlation(results: Results, parameter: str, metric: str) -> float | None:
    """Spearman's rank correlation over the runs that did not fail and have both values.

    Returns:
        -1 to 1; None if a column is constant, or there are fewer than :data:`LEAST_RANKED` such runs.
    """
    from scipy.stats import spearmanr  # slow to import

    x, y = numbers(results.valid, parameter), numbers(results.valid, metric)
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    if len(x) < LEAST_RANKED or is_constant(x) or is_constant(y):
        return None
    return float(spearmanr(x, y).statistic)


def sobol_indices(results: Results, metric: str) -> dict[str, tuple[Estimate, Estimate]]:
    """Sobol indices from a Saltelli design, with bootstrap intervals.

    Returns:
        By parameter the first-order index, the fraction of the variance due to the parameter alone, and the total index,
        the fraction that remains if all other parameters are fixed.

    Raises:
        ValueError: The design is of another kind, the metric is constant, or a run failed, has no row or lacks the metric:
            the estimators need all values. The message gives the reason.
    """
    blocks = _all_values(results, metric).reshape(len(results.parameters) + 2, results.n)
    rng, tail = np.random.default_rng(0), 0.5 * (1.0 - CONFIDENCE)
    again = [_estimates(blocks[:, rng.integers(results.n, size=results.n)]) for _ in range(_BOOTSTRAPS)]
    ends = np.quantile(again, (tail, 1.0 - tail), axis=0)
    first, total = ([Estimate(*map(float, one)) for one in of.T] for of in np.stack((_estimates(blocks), *ends), axis=1))
    return dict(zip(results.parameters, zip(first, total, strict=True), strict=True))


def _estimates(blocks: FloatArray) -> FloatArray:
    """First-order and total indices, (2, d), from values at the points of a Saltelli design, (d + 2, n)."""
    from scipy import stats

    parts = {"f_A": blocks[None, 0], "f_B": blocks[None, 1], "f_AB": blocks[2:, None]}
    indices = stats.sobol_indices(func=parts, n=blocks.shape[1])
    return np.array([np.ravel(indices.first_order), np.ravel(indices.total_order)])


def _all_values(results: Results, metric: str) -> FloatArray:
    if results.kind != "saltelli":
        raise ValueError(f"Sobol indices need samples of kind saltelli, not {results.kind}")
    if results.n < _LEAST_POINTS:
        raise ValueError(f"n = {results.n} is too small for Sobol indices; at least {_LEAST_POINTS}, 128 give an estimate")
    if not results.complete:
        raise ValueError(f"{results.runs - len(results.frame)} runs have no result yet")
    failed = results.frame.index[results.frame["failed"].astype(bool)]
    if len(failed):
        raise ValueError(f"{len(failed)} runs failed, first run {failed[0]}; Sobol indices need every run")
    values = numbers(results.frame, metric)
    lacking = np.flatnonzero(~np.isfinite(values))
    if len(lacking):
        raise ValueError(f"{len(lacking)} runs have no {metric}, first run {lacking[0]}; Sobol indices need every run")
    if is_constant(values[: 2 * results.n]):
        raise ValueError("constant")
    return values
