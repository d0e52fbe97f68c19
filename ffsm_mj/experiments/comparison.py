"""Paired comparison of variants, or of two campaigns, over the same samples, and sentences that say what it shows."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.metrics import FAULT
from ffsm_mj.experiments.results import Results, TableRow, column_of, is_good, numbers
from ffsm_mj.experiments.statistics import CONFIDENCE, SUCCESS

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

    def sentence(self, first: str, second: str) -> str:
        """What the difference shows; nothing is less or more where the interval contains zero.

        Args:
            first: Name of the first campaign or variant.
            second: Name of the second one.
        """
        numbers = f"{self.second:.4g} and {self.first:.4g}, difference {self.mean:.3g}"
        if self.n < 2:
            return f"{self.metric}, {second} and {first}: {numbers} in one run."
        if not self.lower and not self.higher:
            return f"{self.metric}: equal in {second} and {first} ({self.second:.4g}; {self.n} runs)."
        found = (
            f"({numbers} [{self.low:.3g}, {self.high:.3g}]; {self.n} runs, less in {self.lower} and more in {self.higher})"
        )
        if not self.sign:
            return f"{self.metric}: no difference is shown between {second} and {first} {found}."
        return f"{self.metric}: {'less' if self.sign < 0 else 'more'} in {second} than in {first} {found}."


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
            *(each.sentence(*self.names) for each in self.differences),
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


@dataclass(frozen=True)
class VariantCounts:
    """Counts of the runs of a variant.

    Attributes:
        runs: Number of runs of the design.
        done: Number of runs that have a row.
        outcomes: Number of runs by outcome, the most frequent first.
        violated: Completed runs of which a check fails.
        met: Completed runs that meet the success condition, whether or not their checks pass; None without a condition.
        successes: Of these, runs whose checks pass; None without a condition.
    """

    runs: int
    done: int
    outcomes: Mapping[str, int]
    violated: int
    met: int | None
    successes: int | None

    @property
    def completed(self) -> int:
        """Number of completed runs."""
        return self.outcomes.get("completed", 0)


@dataclass(frozen=True)
class MetricFault:
    """A metric of the caller that raised an exception, or gave no valid number, in some runs of a variant.

    Attributes:
        metric: Name of the metric.
        variant: Name of the variant.
        runs: Indices of these runs.
        message: What was wrong in the first of them.
    """

    metric: str
    variant: str
    runs: tuple[int, ...]
    message: str

    def sentence(self) -> str:
        """The fault in one line."""
        more = f" and {len(self.runs) - 1} more" if len(self.runs) > 1 else ""
        return f"metric {self.metric} has no value in run {self.runs[0]}{more} of {self.variant}: {self.message}"


@dataclass(frozen=True)
class VariantResults:
    """Rows of all variants so far.

    Attributes:
        config: The campaign file.
        variants: Results by variant, in the order of the campaign file.
        not_applicable: Why the other variants have none.
    """

    config: CampaignFile
    variants: Mapping[str, Results]
    not_applicable: Mapping[str, str]

    @property
    def metrics(self) -> tuple[str, ...]:
        """Columns of the metrics of the campaign."""
        return next(iter(self.variants.values())).metrics

    @property
    def complete(self) -> bool:
        """Whether every run of every variant has a row."""
        return all(each.complete for each in self.variants.values())

    def counts(self, variant: str) -> VariantCounts:
        """Counts of the runs of a variant."""
        rows = self.variants[variant].rows
        completed = [row for row in rows if row["outcome"] == "completed"]
        met = [row for row in completed if self._is_met(row, rows)]
        has_condition = bool(self.config.conditions)
        return VariantCounts(
            self.variants[variant].runs,
            len(rows),
            dict(Counter(str(row["outcome"]) for row in rows).most_common()),
            sum(row["failed"] for row in completed),
            len(met) if has_condition else None,
            sum(not row["failed"] for row in met) if has_condition else None,
        )

    def _is_met(self, row: TableRow, rows: Sequence[TableRow]) -> bool:
        conditions = self.config.conditions
        return all(each.holds({each.metric: row.get(column_of(each.metric, "metric", rows))}) for each in conditions)

    def values(self, variant: str, metric: str) -> FloatArray:
        """Values of a metric over the runs of a variant that completed and pass their checks; NaN where a run has none."""
        return numbers([row for row in self.variants[variant].rows if not row["failed"]], metric)

    def metric_faults(self) -> list[MetricFault]:
        """Metrics of the caller that had no value, by metric and variant."""
        found: dict[tuple[str, str], list[TableRow]] = {}
        for variant, results in self.variants.items():
            for row in results.rows:
                for name in row:
                    if name.startswith(FAULT):
                        found.setdefault((name, variant), []).append(row)
        return [
            MetricFault(name.removeprefix(FAULT), variant, tuple(row["run"] for row in rows), str(rows[0][name]))
            for (name, variant), rows in found.items()
        ]


@dataclass(frozen=True)
class VariantPair:
    """Two variants, run by run.

    Attributes:
        first: Name of one variant.
        second: Name of the other one; differences are second less first.
        common: Number of runs that have a row in both.
        compared: Number of these that completed and pass their checks in both: metrics are compared over these.
        differences: Differences by metric; of ``success`` over all common runs.
    """

    first: str
    second: str
    common: int
    compared: int
    differences: Mapping[str, PairedDifference]

    def reversed(self) -> VariantPair:
        """The same comparison, first less second."""
        differences = {name: each.reversed() for name, each in self.differences.items()}
        return VariantPair(self.second, self.first, self.common, self.compared, differences)


@dataclass(frozen=True)
class Ranking:
    """What the paired differences of a metric show, given whether less or more of it is better.

    Attributes:
        metric: Name of the metric.
        direction: ``minimize`` or ``maximize``.
        best: The variant that is shown to be better than every other one; empty if there is none.
        unbeaten: Variants than which none is shown to be better, in the order of the campaign file.
        beaten: Variants than which at least one is shown to be better.
    """

    metric: str
    direction: str
    best: str
    unbeaten: tuple[str, ...]
    beaten: tuple[str, ...]


@dataclass(frozen=True)
class VariantComparison:
    """All pairs of variants.

    Attributes:
        pairs: Each pair once, in the order of the campaign file, with the reference first if there is one.
    """

    pairs: tuple[VariantPair, ...]

    def pair(self, first: str, second: str) -> VariantPair:
        """The comparison of two variants, second less first.

        Raises:
            KeyError: They are not compared.
        """
        for each in self.pairs:
            if (each.first, each.second) == (first, second):
                return each
            if (each.second, each.first) == (first, second):
                return each.reversed()
        raise KeyError((first, second))

    def ranking(self, metric: str, direction: str) -> Ranking | None:
        """What the differences of a metric show; None if fewer than two variants have it."""
        better = -1 if direction == "minimize" else 1
        names = dict.fromkeys(
            name for each in self.pairs if metric in each.differences for name in (each.first, each.second)
        )
        wins: dict[str, set[str]] = {name: set() for name in names}
        for each in self.pairs:
            if metric in each.differences and (sign := each.differences[metric].sign):
                winner, loser = (each.second, each.first) if sign == better else (each.first, each.second)
                wins[winner].add(loser)
        beaten = set().union(*wins.values())
        best = [name for name in names if len(wins[name]) == len(names) - 1 and name not in beaten]
        if len(names) < 2:
            return None
        return Ranking(
            metric,
            direction,
            best[0] if best else "",
            tuple(name for name in names if name not in beaten),
            tuple(name for name in names if name in beaten),
        )


def compare_variants(results: VariantResults) -> VariantComparison:
    """Compare the variants run by run: all pairs, or each with the reference if the campaign has one."""
    reference = results.config.reference
    names = [*results.variants]
    if reference is not None and reference in results.variants:
        pairs = [(reference, name) for name in names if name != reference]
    else:
        pairs = list(combinations(names, 2))
    return VariantComparison(tuple(each for pair in pairs if (each := _compared(results, *pair)) is not None))


def _compared(results: VariantResults, first: str, second: str) -> VariantPair | None:
    """Two variants run by run; None if they have no run in common.

    The difference is computed in the order of the names: the bits of an interval do not depend on the order of the variants.
    """
    if second < first:
        found = _compared(results, second, first)
        return found.reversed() if found is not None else None
    rows = {row["run"]: row for row in results.variants[second].rows}
    pairs = [(row, rows[row["run"]]) for row in results.variants[first].rows if row["run"] in rows]
    if not pairs:
        return None
    valid = [pair for pair in pairs if not pair[0]["failed"] and not pair[1]["failed"]]
    differences = {each.metric: each for each in _differences(results, pairs, valid)}
    return VariantPair(first, second, len(pairs), len(valid), differences)


def _differences(
    results: VariantResults, pairs: list[tuple[TableRow, TableRow]], valid: list[tuple[TableRow, TableRow]]
) -> Iterator[PairedDifference]:
    metrics = ([(SUCCESS, pairs)] if results.config.conditions else []) + [(name, valid) for name in results.metrics]
    for metric, of in metrics:
        first, second = (numbers([pair[i] for pair in of], metric) for i in (0, 1))
        if (found := paired_difference(metric, np.asarray(first), np.asarray(second))) is not None:
            yield found
