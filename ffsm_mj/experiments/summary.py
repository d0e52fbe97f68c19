"""What the results of a campaign show, in sentences for a terminal; no variant is better where an interval contains zero."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.conditions import Condition
from ffsm_mj.experiments.comparison import (
    LEAST_RUNS,
    Ranking,
    VariantComparison,
    VariantResults,
    compare_variants,
)
from ffsm_mj.experiments.results import Results, is_good, metric_numbers, numbers
from ffsm_mj.experiments.statistics import (
    CONFIDENCE,
    NO_SUCCESS,
    SUCCESS,
    Proportion,
    groups,
    is_constant,
    mean_interval,
    quantile,
    rank_correlation,
)
from ffsm_mj.report.markdown import number, percent

_MOST_CORRELATIONS, _MOST_PAIRS = 3, 3
"""Correlations, and pairs of variants whose differences are printed: more are in the page only."""


def summary_lines(results: Results, conditions: tuple[Condition, ...]) -> list[str]:
    """Success, accuracy, means and quantiles of metrics, and what the first that varies depends on.

    Args:
        results: Results of the campaign.
        conditions: Its success conditions; empty if it has none.
    """
    if not results.rows:
        return []
    return [_success(results, conditions), _accuracy(results), *_metrics(results), _dependence(results)]


def _success(results: Results, conditions: tuple[Condition, ...]) -> str:
    good = Proportion(sum(map(is_good, results.sample)), len(results.sample))
    low, high = good.interval
    what = (
        f"success ({' and '.join(f'{c.metric} {c.comparison} {c.bound:g}' for c in conditions)})" if conditions else "passed"
    )
    level = f"{100 * CONFIDENCE:g} % interval {percent(low)} to {percent(high)}"
    found = [group for group in groups(results) if group.how != NO_SUCCESS]
    why = f"; most frequent failure: {found[0].how}" if found else ""
    return f"{what}: {good.count} of {good.of}, {percent(good.value)}, {level}{why}"


def _accuracy(results: Results) -> str:
    violated = sum(row.get("checks_pass") is False for row in results.rows)
    parts = [f"checks violated in {violated or 'no'} run{'s' if violated > 1 else ''}"]
    for column, what in (("drift", "drift over (1 + scale) at most"), ("deepest_overlap_m", "overlap in m at most")):
        values = numbers(results.rows, column)
        if np.isfinite(values).any():
            parts.append(f"{what} {np.nanmax(values):.2g}")
    return "; ".join(parts)


def _metrics(results: Results) -> Iterator[str]:
    """Mean and quantiles of each metric with numbers."""
    for metric in results.metrics:
        values = metric_numbers(results.sample, metric)
        if is_constant(values):
            if len(values):
                yield f"{metric}: {number(float(values[0]))} in all {len(values)} runs"
            continue
        middle, low, high = (quantile(values, share).value for share in (0.5, 0.05, 0.95))
        quantiles = f"median {number(middle)}, 5 % {number(low)}, 95 % {number(high)}"
        yield f"{metric}: mean {_mean(values)}, {quantiles}, of {len(values)} runs"


def _mean(values: FloatArray) -> str:
    mean, low, high = mean_interval(values)
    return number(mean) + ("" if math.isnan(low) else f" ({number(low)} to {number(high)})")


def _dependence(results: Results) -> str:
    """Rank correlation of the first metric that varies with the parameters."""
    varied = (name for name in results.metrics if not is_constant(metric_numbers(results.sample, name)))
    metric = next(varied, None)
    if metric is None:
        return "no metric varies"
    found = [(name, rank_correlation(results, name, metric)) for name in results.parameters]
    known = sorted(((rho, name) for name, rho in found if rho is not None), key=lambda each: -abs(each[0]))
    shown = ", ".join(f"{name} {rho:.2f}" for rho, name in known[:_MOST_CORRELATIONS])
    return f"rank correlation of {metric} with {shown}" if shown else f"{metric}: too few runs for rank correlations"


def variant_lines(results: VariantResults) -> list[str]:
    """Success and means of each variant, then what their paired differences show.

    Args:
        results: Results of the variants.
    """
    comparison = compare_variants(results)
    lines = [f"{name}: {line}" for name in results.variants if (line := _variant(results, name))]
    lines += sentences(results, comparison)
    if len(comparison.pairs) > _MOST_PAIRS:
        return lines
    shown = [*([SUCCESS] if results.config.conditions else []), *results.metrics]
    for metric in shown:
        for pair in comparison.pairs:
            if metric in pair.differences:
                lines.append(pair.differences[metric].sentence(pair.first, pair.second))
    return lines


def _variant(results: VariantResults, name: str) -> str:
    """Success and means of a variant."""
    parts, counts = [], results.counts(name)
    if counts.successes is not None and counts.done:
        good = Proportion(counts.successes, counts.done)
        low, high = good.interval
        share = f"{percent(good.value)} ({percent(low)} to {percent(high)})"
        parts.append(f"success {good.count} of {good.of}, {share}")
    for metric in results.metrics:
        values = results.values(name, metric)
        if len(known := values[np.isfinite(values)]):
            parts.append(f"{metric} {_mean(known)}")
    return "; ".join(parts)


def sentences(results: VariantResults, comparison: VariantComparison) -> list[str]:
    """What a campaign shows, one sentence each: rankings, runs that are left out, variants and metrics without results."""
    found = [*_rankings(results, comparison), *_left_out(results)]
    found += [f"{name} is not applicable: {reason}" for name, reason in results.not_applicable.items()]
    return found + [each.sentence() for each in results.metric_faults()]


def _rankings(results: VariantResults, comparison: VariantComparison) -> Iterator[str]:
    """A sentence per objective, after one for the fraction of successes."""
    objectives = {SUCCESS: "maximize"} if results.config.conditions else {}
    for metric, direction in (objectives | dict(results.config.objectives)).items():
        ranking = comparison.ranking(metric, direction)
        if ranking is None:
            yield f"{metric} ({direction}): no two variants have a number in the same run, with checks passed in both."
        else:
            yield _ranking(ranking, results, comparison)


def _ranking(ranking: Ranking, results: VariantResults, comparison: VariantComparison) -> str:
    goal, compared = ("least", "less") if ranking.direction == "minimize" else ("most", "more")
    runs = max(each.differences[ranking.metric].n for each in comparison.pairs if ranking.metric in each.differences)
    head = f"{ranking.metric} ({ranking.direction}): "
    if runs < LEAST_RUNS:
        return f"{head}nothing is shown by {runs} run{'' if runs == 1 else 's'}; {LEAST_RUNS} or more are needed."
    reference = results.config.reference
    if reference is not None:
        return head + _against(reference, ranking, comparison)
    if ranking.best:
        return f"{head}{ranking.best} has {compared} than every other variant."
    if not ranking.beaten:
        return f"{head}no difference is shown between {_listed(ranking.unbeaten)}."
    behind = f"; {_listed(ranking.beaten)} {'is' if len(ranking.beaten) == 1 else 'are'} shown to be worse than another"
    return f"{head}no variant has the {goal}: none is shown to be better than {_listed(ranking.unbeaten)}{behind}."


def _against(reference: str, ranking: Ranking, comparison: VariantComparison) -> str:
    """Variants that differ from the reference."""
    better = -1 if ranking.direction == "minimize" else 1
    groups: dict[int, list[str]] = {1: [], -1: [], 0: []}
    for each in comparison.pairs:
        if ranking.metric in each.differences:
            groups[each.differences[ranking.metric].sign * better].append(each.second)
    words = {1: f"better than {reference}: ", -1: f"worse than {reference}: ", 0: "no difference shown: "}
    return "; ".join(words[side] + _listed(names) for side, names in groups.items() if names) + "."


def _left_out(results: VariantResults) -> Iterator[str]:
    """Runs that are missing, did not complete or do not pass their checks."""
    for name in results.variants:
        counts = results.counts(name)
        left = counts.runs - counts.done
        parts = [f"{left} {'has' if left == 1 else 'have'} no result yet"] if left else []
        parts += [f"{count} ended with {outcome}" for outcome, count in counts.outcomes.items() if outcome != "completed"]
        parts += [f"{counts.violated} violate{'s' if counts.violated == 1 else ''} a check"] if counts.violated else []
        if parts:
            yield (
                f"{name}: of {counts.runs} runs {_listed(parts)}; metrics are compared over runs that completed and pass "
                "their checks in both variants."
            )


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def confidence_sentence(pairs: int, metrics: int) -> str:
    """How the intervals are to be read."""
    by_chance, number = (1.0 - CONFIDENCE) * pairs * metrics, pairs * metrics
    return (
        f"Intervals are two-sided, {100 * CONFIDENCE:g} % each: bootstrap of the mean paired difference, bias-corrected, "
        f"accelerated, and expanded for few runs. Of {number} intervals without a true difference {by_chance:.1f} exclude "
        "zero by chance."
    )
