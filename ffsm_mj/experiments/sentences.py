"""What the results of a campaign without variants show, in sentences for a terminal and for the page."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ffsm_mj.conditions import Condition
from ffsm_mj.errors import plural
from ffsm_mj.experiments.results import GOOD, Results, finite, numbers
from ffsm_mj.experiments.statistics import (
    CONFIDENCE,
    LEAST_RANKED,
    NO_SUCCESS,
    Proportion,
    digits_of,
    groups,
    is_constant,
    mean_text,
    quantile,
    rank_correlation,
)
from ffsm_mj.report.markdown import number, percent

_MOST_CORRELATIONS = 3
"""Correlations that are printed: more are in the page only."""


def sentences_of(results: Results, conditions: tuple[Condition, ...]) -> list[str]:
    """Success, accuracy, means and quantiles of metrics, and what the first that varies depends on.

    Args:
        results: Results of the campaign.
        conditions: Its success conditions; empty if it has none.
    """
    if results.frame.empty:
        return []
    return [_success(results, conditions), _accuracy(results), *_metric_sentences(results), _dependence(results)]


def _success(results: Results, conditions: tuple[Condition, ...]) -> str:
    good = Proportion(int(results.sample[GOOD].sum()), len(results.sample))
    what = (
        f"success ({' and '.join(f'{c.metric} {c.comparison} {c.bound:g}' for c in conditions)})" if conditions else "passed"
    )
    level = f"{100 * CONFIDENCE:g} % interval {good.interval_text}"
    failures = [group for group in groups(results) if group.how != NO_SUCCESS]
    why = f"; most frequent failure: {failures[0].how}" if failures else ""
    return f"{what}: {good.count} of {good.of}, {percent(good.value)}, {level}{why}"


def _accuracy(results: Results) -> str:
    violated = int((numbers(results.frame, "checks_pass") == 0.0).sum())
    parts = [f"checks violated in {plural(violated, 'run') if violated else 'no run'}"]
    for column, what in (("drift", "drift over (1 + scale) at most"), ("deepest_overlap_m", "overlap in m at most")):
        values = numbers(results.frame, column)
        if np.isfinite(values).any():
            parts.append(f"{what} {np.nanmax(values):.2g}")
    return "; ".join(parts)


def _metric_sentences(results: Results) -> Iterator[str]:
    """Mean and quantiles of each metric with numbers."""
    for metric in results.metrics:
        values = finite(results.valid, metric)
        if is_constant(values):
            if len(values):
                yield f"{metric}: {number(float(values[0]))} in all {plural(len(values), 'run')}"
            continue
        middle, low, high = (quantile(values, share).value for share in (0.5, 0.05, 0.95))
        median, *ends = (number(value, digits_of(low, high)) for value in (middle, low, high))
        quantiles = f"median {median}, 5 % {ends[0]}, 95 % {ends[1]}"
        yield f"{metric}: mean {mean_text(values)}, {quantiles}, of {plural(len(values), 'run')}"


def _dependence(results: Results) -> str:
    """Rank correlation of the first metric that varies with the parameters."""
    varied = (name for name in results.metrics if not is_constant(finite(results.valid, name)))
    metric = next(varied, None)
    if metric is None:
        return "no metric varies"
    ranks = [(name, rank_correlation(results, name, metric)) for name in results.parameters]
    known = sorted(((rho, name) for name, rho in ranks if rho is not None), key=lambda entry: -abs(entry[0]))
    shown = ", ".join(f"{name} {rho:.2f}" for rho, name in known[:_MOST_CORRELATIONS])
    count = len(finite(results.valid, metric))
    if not shown:
        why = (
            f"{plural(count, 'run')}, {LEAST_RANKED} are needed"
            if count < LEAST_RANKED
            else "no parameter is a number that varies"
        )
        return f"{metric}: no rank correlation ({why})"
    return f"rank correlation of {metric} with {shown}, of {plural(count, 'run')}"
