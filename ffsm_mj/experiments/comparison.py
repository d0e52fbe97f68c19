"""Paired comparison of variants, or of two campaigns, over the same samples, and sentences that say what it shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, plural
from ffsm_mj.experiments.results import GOOD, SUCCESS, VariantResults, finite, numbers, passed
from ffsm_mj.experiments.statistics import Proportion, mean_interval, mean_text
from ffsm_mj.report.markdown import percent

LEAST_RUNS = 6
"""Number of runs that must differ for a difference to be shown: even if all of n differences have one sign, the p-value of
the sign test, 2^(1 - n), is above 1 - CONFIDENCE for fewer."""
_MOST_PAIRS = 3
"""Pairs of variants whose differences are told: more are in a table only."""
_ROUNDING = 1e-12
"""Relative difference that is rounding of another processor, not one of the variants."""


@dataclass(frozen=True)
class PairedDifference:
    """Differences of a metric, second variant less first, over the runs in which both have a number.

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
        details = (
            f"({numbers} [{self.low:.3g}, {self.high:.3g}]; {self.n} runs, less in {self.lower} and more in {self.higher})"
        )
        if not self.sign:
            return f"{self.metric}: no difference is shown between {second} and {first} {details}."
        return f"{self.metric}: {'less' if self.sign < 0 else 'more'} in {second} than in {first} {details}."


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
    low, high = mean_interval(apart)
    means = float(first.mean()), float(second.mean()), float(apart.mean())
    return PairedDifference(metric, len(apart), *means, low, high, int((apart < 0.0).sum()), int((apart > 0.0).sum()))


@dataclass(frozen=True)
class VariantPair:
    """Two variants, run by run.

    Attributes:
        first: Name of one variant.
        second: Name of the other one; differences are second less first.
        common: Number of runs that have a row in both.
        compared: Number of these that completed and pass their checks in both: metrics are compared over these.
        good: Of the common runs: good in both, in the first one only, in the second one only, in none.
        differences: Differences by metric; of ``success`` over all common runs.
    """

    first: str
    second: str
    common: int
    compared: int
    good: tuple[int, int, int, int]
    differences: Mapping[str, PairedDifference]

    def goodness(self) -> str:
        """In how many of the common runs which of both is good."""
        both, first, second, none = self.good
        return (
            f"{self.first} and {self.second}: {self.common} runs with the same samples, good in both {both}, "
            f"in {self.first} only {first}, in {self.second} only {second}, in none {none}."
        )

    def reversed(self) -> VariantPair:
        """The same comparison, first less second."""
        differences = {name: difference.reversed() for name, difference in self.differences.items()}
        both, first, second, none = self.good
        good = (both, second, first, none)
        return VariantPair(self.second, self.first, self.common, self.compared, good, differences)


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
        results: Their results.
        pairs: Each pair once, in the order of the campaign file, with the reference first if there is one.
    """

    results: VariantResults
    pairs: tuple[VariantPair, ...]

    def pair(self, first: str, second: str) -> VariantPair:
        """The comparison of two variants, second less first.

        Raises:
            KeyError: They are not compared.
        """
        for candidate in self.pairs:
            if (candidate.first, candidate.second) == (first, second):
                return candidate
            if (candidate.second, candidate.first) == (first, second):
                return candidate.reversed()
        raise KeyError((first, second))

    def sentences(self) -> list[str]:
        """What is shown, one sentence each: rankings, runs that are left out, variants and metrics without results."""
        results = self.results
        texts = [*self._rankings(), *_left_out(results)]
        texts += [f"{name} is not applicable: {reason}" for name, reason in results.not_applicable.items()]
        for metric, variant, runs, message in results.metric_faults():
            more = f" and {len(runs) - 1} more" if len(runs) > 1 else ""
            texts.append(f"metric {metric} has no value in run {runs[0]}{more} of {variant}: {message}")
        return texts

    def lines(self) -> list[str]:
        """Success and means of each variant, what is shown, and of a few pairs all differences."""
        lines = [f"{name}: {line}" for name in self.results.variants if (line := _means(self.results, name))]
        lines += self.sentences()
        if len(self.pairs) > _MOST_PAIRS:
            return lines
        lines += [compared.goodness() for compared in self.pairs]
        return lines + [
            pair.differences[metric].sentence(pair.first, pair.second)
            for metric in self.results.compared
            for pair in self.pairs
            if metric in pair.differences
        ]

    def _rankings(self) -> Iterator[str]:
        """A sentence per objective, after one for the fraction of successes."""
        objectives = {SUCCESS: "maximize"} if self.results.config.conditions else {}
        for metric, direction in (objectives | dict(self.results.config.objectives)).items():
            ranking = self.ranking(metric, direction)
            if ranking is None:
                yield f"{metric} ({direction}): no two variants have a number in the same run, with checks passed in both."
            else:
                yield f"{metric} ({direction}): {self._shown(ranking)}"

    def _shown(self, ranking: Ranking) -> str:
        goal, compared = ("least", "less") if ranking.direction == "minimize" else ("most", "more")
        runs = max(one.differences[ranking.metric].n for one in self.pairs if ranking.metric in one.differences)
        if runs < LEAST_RUNS:
            return f"nothing is shown by {plural(runs, 'run')}; {LEAST_RUNS} or more are needed."
        reference = self.results.config.reference
        if reference is not None:
            return self._against(reference, ranking)
        if ranking.best:
            return f"{ranking.best} has {compared} than every other variant."
        if not ranking.beaten:
            return f"no difference is shown between {_joined(ranking.unbeaten)}."
        behind = f"; {_joined(ranking.beaten)} {'is' if len(ranking.beaten) == 1 else 'are'} shown to be worse than another"
        return f"no variant has the {goal}: none is shown to be better than {_joined(ranking.unbeaten)}{behind}."

    def _against(self, reference: str, ranking: Ranking) -> str:
        """Variants that differ from the reference."""
        better = -1 if ranking.direction == "minimize" else 1
        groups: dict[int, list[str]] = {1: [], -1: [], 0: []}
        for compared in self.pairs:
            if ranking.metric in compared.differences:
                groups[compared.differences[ranking.metric].sign * better].append(compared.second)
        words = {1: f"better than {reference}: ", -1: f"worse than {reference}: ", 0: "no difference shown: "}
        return "; ".join(words[side] + _joined(names) for side, names in groups.items() if names) + "."

    def ranking(self, metric: str, direction: str) -> Ranking | None:
        """What the differences of a metric show; None if fewer than two variants have it."""
        better = -1 if direction == "minimize" else 1
        names = dict.fromkeys(
            name for compared in self.pairs if metric in compared.differences for name in (compared.first, compared.second)
        )
        wins: dict[str, set[str]] = {name: set() for name in names}
        for compared in self.pairs:
            if metric in compared.differences and (sign := compared.differences[metric].sign):
                winner, loser = (compared.second, compared.first) if sign == better else (compared.first, compared.second)
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
    return VariantComparison(results, tuple(one for pair in pairs if (one := _compared(results, *pair)) is not None))


def _compared(results: VariantResults, first: str, second: str) -> VariantPair | None:
    """Two variants run by run; None if they have no run in common.

    The difference is computed in the order of the names: the bits of an interval do not depend on the order of the variants.
    """
    if second < first:
        compared = _compared(results, second, first)
        return compared.reversed() if compared is not None else None
    frames = [results.variants[name].frame for name in (first, second)]
    common = frames[0].index.intersection(frames[1].index)
    if common.empty:
        return None
    one, other = (frame.loc[common] for frame in frames)
    valid = ~(one["failed"] | other["failed"]).astype(bool)
    differences = {}
    for metric in results.compared:
        rows = common if metric == SUCCESS else common[valid]
        apart = paired_difference(metric, numbers(one.loc[rows], metric), numbers(other.loc[rows], metric))
        if apart is not None:
            differences[metric] = apart
    a, b = one[GOOD], other[GOOD]
    good = (int((a & b).sum()), int((a & ~b).sum()), int((~a & b).sum()), int((~a & ~b).sum()))
    return VariantPair(first, second, len(common), int(valid.sum()), good, differences)


def refuse_other_samples(results: VariantResults) -> None:
    """Refuse two campaigns that have no run in common, or whose runs of the same number are not of the same sample.

    Raises:
        InputError: Parameters or their values differ.
    """
    (one, other), names = results.variants.values(), [*results.variants]
    if set(one.parameters) != set(other.parameters):
        only = ", ".join(sorted(set(one.parameters) ^ set(other.parameters)))
        raise InputError(f"{names[0]} and {names[1]} do not have the same parameters: {only}; use the same dispersions")
    common = one.frame.index.intersection(other.frame.index)
    if common.empty:
        raise InputError(f"{names[0]} and {names[1]} have no run in common")
    for name in one.parameters:
        a, b = (results.frame.loc[common, name] for results in (one, other))
        for run in common[a.ne(b)]:
            raise InputError(
                f"run {run}: {name} is {a[run]} in {names[0]} and {b[run]} in {names[1]}; campaigns are compared run by "
                "run: use the same dispersions, kind of samples and seed"
            )


def _means(results: VariantResults, name: str) -> str:
    """Success and means of a variant."""
    parts, frame = [], results.variants[name].frame
    if results.config.conditions and len(frame):
        good = Proportion(int(frame[GOOD].sum()), len(frame))
        parts.append(f"success {good.count} of {good.of}, {percent(good.value)} ({good.interval_text})")
    for metric in results.metrics:
        if len(values := finite(passed(frame), metric)):
            parts.append(f"{metric} {mean_text(values)}")
    return "; ".join(parts)


def _left_out(results: VariantResults) -> Iterator[str]:
    """Runs that are missing, did not complete or do not pass their checks."""
    for name, variant in results.variants.items():
        left, outcomes = variant.runs - len(variant.frame), variant.frame["outcome"]
        violated = int((variant.frame["failed"].astype(bool) & (outcomes == "completed")).sum())
        ended = outcomes[outcomes != "completed"].value_counts()
        parts = [f"{left} {'has' if left == 1 else 'have'} no result yet"] if left else []
        parts += [f"{count} ended with {outcome}" for outcome, count in ended.items()]
        parts += [f"{violated} violate{'s' if violated == 1 else ''} a check"] if violated else []
        if parts:
            yield (
                f"{name}: of {variant.runs} runs {_joined(parts)}; metrics are compared over runs that completed and pass "
                "their checks in both variants."
            )


def _joined(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
