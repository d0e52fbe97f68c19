"""Summary of a campaign in five lines, for a terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from ffsm_mj.campaign.evaluation.failures import NO_SUCCESS, groups
from ffsm_mj.campaign.evaluation.results import Results, is_good, metric_numbers, numbers
from ffsm_mj.campaign.evaluation.sensitivity import rank_correlation
from ffsm_mj.campaign.evaluation.statistics import CONFIDENCE, Proportion, is_constant, quantile
from ffsm_mj.conditions import Condition
from ffsm_mj.report.markdown_text import number, percent

_MOST_CORRELATIONS = 3


def summary_lines(results: Results, conditions: tuple[Condition, ...]) -> list[str]:
    """Runs and outcomes, success, accuracy, a metric that varies, and what it depends on.

    Args:
        results: Results of the campaign.
        conditions: Its success conditions; empty if it has none.
    """
    if not results.rows:
        return [f"{results.name}: 0 of {results.runs} runs have a result"]
    names = [*(each.metric for each in conditions), *results.metrics]
    metric = next((name for name in names if not is_constant(metric_numbers(results.sample, name))), None)
    return [_runs(results), _success(results, conditions), _accuracy(results), *_metric(results, metric)]


def _runs(results: Results) -> str:
    counts = Counter(str(row["outcome"]) for row in results.rows).most_common()
    return f"{results.name}: {len(results.rows)} of {results.runs} runs: {', '.join(f'{n} {name}' for name, n in counts)}"


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


def _metric(results: Results, metric: str | None) -> Iterator[str]:
    if metric is None:
        yield "no metric varies"
        yield "no parameter matters to a metric"
        return
    values = metric_numbers(results.sample, metric)
    middle, low, high = (quantile(values, share).value for share in (0.5, 0.05, 0.95))
    yield f"{metric}: median {number(middle)}, 5 % {number(low)}, 95 % {number(high)}, of {len(values)} runs"
    found = [(name, rank_correlation(results, name, metric)) for name in results.parameters]
    known = sorted(((rho, name) for name, rho in found if rho is not None), key=lambda each: -abs(each[0]))
    shown = ", ".join(f"{name} {rho:.2f}" for rho, name in known[:_MOST_CORRELATIONS])
    yield f"rank correlation of {metric} with {shown}" if shown else f"{metric}: too few runs for rank correlations"
