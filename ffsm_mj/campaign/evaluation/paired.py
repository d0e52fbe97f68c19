"""Differences of the metrics of two campaigns with the same samples, run by run, with bootstrap intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.evaluation.results import Results, TableRow, is_good, numbers
from ffsm_mj.campaign.evaluation.statistics import CONFIDENCE
from ffsm_mj.errors import InputError

LEAST_RUNS = 6
"""Number of runs that must differ for a difference to be shown: even if all of n differences have one sign, the p-value of
the sign test, 2^(1 - n), is above 1 - CONFIDENCE for fewer."""
_RESAMPLES = 10_000
_BLOCK = 500
_ROUNDING = 1e-12


@dataclass(frozen=True)
class PairedDifference:
    """Differences of a metric, second campaign less first, over the runs in which both have a number.

    Attributes:
        metric: Name of the metric.
        n: Number of these runs.
        first: Mean of the metric in the first campaign.
        second: Mean in the second one.
        mean: Mean difference.
        low: Lower end of the bootstrap interval of the mean difference, at the level CONFIDENCE; NaN below two runs.
        high: Its upper end.
        lower: Number of runs in which the second campaign has less.
        higher: Number of runs in which it has more.
    """

    metric: str
    n: int
    first: float
    second: float
    mean: float
    low: float
    high: float
    lower: int
    higher: int

    @property
    def sign(self) -> int:
        """-1 or 1 where the second campaign is shown to have less or more; 0 where the interval contains zero.

        If fewer than :data:`LEAST_RUNS` runs differ, nothing is shown, whatever the interval.
        """
        return int(self.low > 0.0) - int(self.high < 0.0) if self.lower + self.higher >= LEAST_RUNS else 0

    def reversed(self) -> PairedDifference:
        """The same difference, first campaign less second."""
        mean, low, high = (0.0 - value for value in (self.mean, self.high, self.low))
        return PairedDifference(self.metric, self.n, self.second, self.first, mean, low, high, self.higher, self.lower)

    def sentence(self, names: tuple[str, str]) -> str:
        """What the numbers say; no campaign has less or more where the interval contains zero."""
        says = {-1: f"less in {names[1]}", 0: "no difference shown", 1: f"more in {names[1]}"}[self.sign]
        return (
            f"{self.metric}: {says}; {self.first:.4g} and {self.second:.4g}, difference {self.mean:.3g} "
            f"[{self.low:.3g}, {self.high:.3g}], less in {self.lower} and more in {self.higher} of {self.n} runs"
        )


@dataclass(frozen=True)
class CampaignComparison:
    """Two campaigns with the same samples.

    Attributes:
        names: Their names.
        n: Number of runs that both have.
        outcomes: Number of these runs by outcome, of each campaign.
        good: Of these runs: good in both, in the first one only, in the second one only, in none.
        differences: Metrics that both have.
    """

    names: tuple[str, str]
    n: int
    outcomes: tuple[Mapping[str, int], Mapping[str, int]]
    good: tuple[int, int, int, int]
    differences: tuple[PairedDifference, ...]

    def __getitem__(self, metric: str) -> PairedDifference:
        """The difference of a metric.

        Raises:
            KeyError: Not both have it.
        """
        for each in self.differences:
            if each.metric == metric:
                return each
        raise KeyError(metric)

    def lines(self) -> list[str]:
        """The comparison as text."""
        one, other = self.names
        outcomes = ("; ".join(f"{count} {name}" for name, count in each.items()) for each in self.outcomes)
        both, first, second, none = self.good
        return [
            f"{one} and {other}: {self.n} runs with the same samples",
            *(f"outcomes of {name}: {text}" for name, text in zip(self.names, outcomes, strict=True)),
            f"good in both: {both}, in {one} only: {first}, in {other} only: {second}, in none: {none}",
            *(each.sentence(self.names) for each in self.differences),
        ]


def paired_comparison(one: Results, other: Results, names: tuple[str, str]) -> CampaignComparison:
    """Compare two campaigns run by run.

    Metrics are compared over the runs in which both have a number: of a run that failed early this may be none.

    Args:
        one: The first campaign.
        other: The second one.
        names: What they are called.

    Raises:
        InputError: They have no run in common, or their samples differ.
    """
    rows = {row["run"]: row for row in other.rows}
    pairs = [(row, rows[row["run"]]) for row in one.rows if row["run"] in rows]
    if not pairs:
        raise InputError(f"{names[0]} and {names[1]} have no run in common")
    _refuse_other_samples(one, other, pairs, names)
    first, second = ([pair[i] for pair in pairs] for i in (0, 1))
    good = [(is_good(a), is_good(b)) for a, b in pairs]
    both = [name for name in one.metrics if name in other.metrics]
    found = (paired_difference(name, numbers(first, name), numbers(second, name)) for name in both)
    return CampaignComparison(
        names,
        len(pairs),
        (_outcomes(first), _outcomes(second)),
        (good.count((True, True)), good.count((True, False)), good.count((False, True)), good.count((False, False))),
        tuple(each for each in found if each is not None),
    )


def _refuse_other_samples(
    one: Results, other: Results, pairs: Sequence[tuple[TableRow, TableRow]], names: tuple[str, str]
) -> None:
    """Refuse campaigns whose runs of the same number are not of the same sample.

    Raises:
        InputError: Parameters or their values differ.
    """
    if set(one.parameters) != set(other.parameters):
        only = ", ".join(sorted(set(one.parameters) ^ set(other.parameters)))
        raise InputError(f"{names[0]} and {names[1]} do not have the same parameters: {only}; use the same dispersions")
    for a, b in pairs:
        for name in one.parameters:
            if a.get(name) != b.get(name):
                raise InputError(
                    f"run {a['run']}: {name} is {a.get(name)} in {names[0]} and {b.get(name)} in {names[1]}; campaigns are "
                    "compared run by run: use the same dispersions, kind of samples and seed"
                )


def _outcomes(rows: Sequence[TableRow]) -> dict[str, int]:
    """Number of runs by outcome, the most frequent first."""
    texts: list[Any] = [row["outcome"] for row in rows]
    return {name: texts.count(name) for name in sorted(set(texts), key=lambda text: (-texts.count(text), text))}


def paired_difference(metric: str, first: FloatArray, second: FloatArray) -> PairedDifference | None:
    """The difference of a metric; None if no run has a number in both.

    Args:
        metric: Name of the metric.
        first: Its values in the first campaign, NaN where a run has none.
        second: Those of the same runs in the second one.
    """
    known = np.isfinite(first) & np.isfinite(second)
    first, second = first[known], second[known]
    if not len(first):
        return None
    apart = second - first
    # Rounding of another processor is no difference.
    apart[np.abs(apart) <= _ROUNDING * np.maximum(np.abs(first), np.abs(second))] = 0.0
    low, high = bootstrap_interval(apart)
    means = float(first.mean()), float(second.mean()), float(apart.mean())
    return PairedDifference(metric, len(apart), *means, low, high, int((apart < 0.0).sum()), int((apart > 0.0).sum()))


def bootstrap_interval(values: FloatArray) -> tuple[float, float]:
    """Bias-corrected and accelerated interval of a mean at the level CONFIDENCE (Efron 1987); NaN below two values.

    The resamples have a seed of their own: the same values give the same interval. It is expanded as that of a normal sample
    is by Student's distribution and the unbiased variance (Hesterberg 2015, The American Statistician 69(4):371), without
    which intervals of few values are too narrow: some 92 % of those of 16 values contain the mean, not 95 %.
    """
    n = len(values)
    if n < 2:
        return float("nan"), float("nan")
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    from scipy.stats import bootstrap, norm, t  # slow to import

    tail = norm.sf(math.sqrt(n / (n - 1.0)) * t.ppf(0.5 * (1.0 + CONFIDENCE), n - 1))
    level = 1.0 - 2.0 * max(float(tail), 1.0 / _RESAMPLES)
    random = np.random.default_rng(0)
    found = bootstrap((values,), np.mean, n_resamples=_RESAMPLES, batch=_BLOCK, confidence_level=level, rng=random)
    low, high = found.confidence_interval
    return float(low), float(high)
