"""Report page of a campaign as Markdown."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.experiments.results import Results, is_good, metric_numbers, numbers
from ffsm_mj.experiments.statistics import (
    CONFIDENCE,
    SUCCESS,
    Proportion,
    differences,
    groups,
    intervals,
    is_constant,
    quantile,
    rank_correlation,
    sobol_indices,
    values_for_upper_end,
)
from ffsm_mj.report.markdown import code, escaped, markdown_table, number, percent

_SHARES = (0.05, 0.5, 0.95)
_SHOWN_RUNS = 6
_ACCURACY = {
    "drift": "Drift of energy and momenta over (1 + scale)",
    "deepest_overlap_m": "Deepest overlap, m",
}
_NOMINAL = {
    "lhs": "points of a Latin hypercube are",
    "sobol": "Sobol points are",
    "saltelli": "Sobol points are",
    "grid": "combinations of a grid are",
}


def report_page(results: Results, description: str, success: str | None, figures: Sequence[tuple[str, str]]) -> str:
    """Markdown text of the report.

    Args:
        results: Results of the campaign.
        description: Description in the campaign file.
        success: Success condition in the campaign file.
        figures: Title of each figure, and its path relative to the page.
    """
    if not results.rows:
        return f"# {escaped(results.name)}\n\n0 of {results.runs} runs have a result.\n"
    parts = [
        f"# {escaped(results.name)}",
        *([html.escape(description, quote=False)] if description else []),
        _head(results, success),
        "## Outcomes",
        _outcomes(results),
        "## Metrics",
        _metrics(results),
        "## Convergence",
        _convergence(results),
        "## Sensitivity",
        *_sensitivity(results),
        "## Failures",
        *_failures(results),
        "## Samples",
        samples(results),
        *(["## Figures", "A mark at the lower edge is a run without the metric."] if figures else []),
        *(f"![{what}]({file})" for what, file in figures),
    ]
    return "\n\n".join(parts) + "\n"


def _head(results: Results, success: str | None) -> str:
    made = f"{len(results.rows)} of {results.runs} runs" if not results.complete else f"{results.runs} runs"
    sentences = [f"{made}, samples of kind `{results.kind}`, {len(results.parameters)} parameters."]
    if success is not None:
        sentences.append(f"A run is a success if {code(success)}.")
    sentences.append(f"Confidence intervals are two-sided, {100 * CONFIDENCE:g} %.")
    if results.kind in _NOMINAL:
        sentences.append(f"They are approximate: {_NOMINAL[results.kind]} not independent samples.")
    if results.kind == "saltelli":
        sentences.append(
            f"Fractions and quantiles are those of the first {2 * results.n} runs; the others combine parameters of these."
        )
    return " ".join(sentences)


def _outcomes(results: Results) -> str:
    sample = results.sample
    counts = Counter(str(row["outcome"]) for row in sample)
    rows = [_share_row(f"outcome {code(outcome)}", count, len(sample)) for outcome, count in counts.most_common()]
    rows.append(_share_row("failed (not completed, or a check fails)", sum(r["failed"] for r in sample), len(sample)))
    if short := sum(row.get("fails_by_truncation") is True for row in sample):
        how = "a check fails by the truncation of the step alone (remedy: accuracy in the scenario)"
        rows.append(_share_row(how, short, len(sample)))
    if results.has_success:
        rows.append(_share_row("success", sum(map(is_good, sample)), len(sample)))
    parts = [markdown_table(("", "runs", "fraction", "interval"), rows)]
    for column, what in _ACCURACY.items():
        values = numbers(results.rows, column)  # of all runs, failed ones included
        if np.isfinite(values).any():
            lack = int((~np.isfinite(values)).sum())
            but = f"; {lack} of {len(values)} runs have no value" if lack else ""
            parts.append(f"{what}: at most {number(float(np.nanmax(values)))}{but}.")
    return "\n\n".join(parts)


def _share_row(name: str, count: int, of: int) -> list[str]:
    share = Proportion(count, of)
    low, high = share.interval
    return [name, f"{count} of {of}", percent(share.value), f"{percent(low)} to {percent(high)}"]


def _metrics(results: Results) -> str:
    head = ("metric", "runs", "minimum", "5 %", "median", "95 %", "maximum")
    rows = []
    for metric in results.metrics:
        values = metric_numbers(results.sample, metric)
        if not len(values):
            cells = ["no run has a number", *[""] * 4]
        elif is_constant(values):
            cells = [number(float(values[0])), "constant", "", "", ""]
        else:
            cells = [
                number(float(values.min())),
                *(_quantile(values, share) for share in _SHARES),
                number(float(values.max())),
            ]
        rows.append([code(metric), str(len(values)), *cells])
    return "Over the runs that did not fail and have the metric; quantiles with confidence intervals.\n\n" + markdown_table(
        head, rows
    )


def _quantile(values: FloatArray, share: float) -> str:
    found = quantile(values, share)
    if found.low is not None and found.high is not None:
        return f"{number(found.value)} ({number(found.low)} to {number(found.high)})"
    if found.low is not None:
        needed = values_for_upper_end(share)
        return f"{number(found.value)} (from {number(found.low)}, no upper bound with fewer than {needed} runs)"
    if found.high is not None:
        needed = values_for_upper_end(1.0 - share)
        return f"{number(found.value)} (to {number(found.high)}, no lower bound with fewer than {needed} runs)"
    return f"{number(found.value)} (no bounds)"


def _convergence(results: Results) -> str:
    shown_metrics = [*([SUCCESS] if results.has_success else []), *results.metrics]
    found = {what: {each.runs: each for each in intervals(results, what)} for what in shown_metrics}
    found = {what: by for what, by in found.items() if by}
    counts = sorted({runs for by in found.values() for runs in by})
    if not counts:
        return "Fewer than 8 runs."
    rows = [
        [code(what) if what != SUCCESS else what, *(_width(by[runs].width) if runs in by else "" for runs in counts)]
        for what, by in found.items()
    ]
    head = ("interval width after", *(f"{runs} runs" for runs in counts))
    return "Intervals of the fraction of successes, and of the medians of metrics.\n\n" + markdown_table(head, rows)


def _width(width: float | None) -> str:
    return "none" if width is None else number(width)


def _sensitivity(results: Results) -> Iterator[str]:
    count = sum(not row["failed"] for row in results.sample)
    rows = []
    for metric in results.metrics:
        values = metric_numbers(results.sample, metric)
        constant = len(values) == 0 or is_constant(values)
        found = [None if constant else rank_correlation(results, name, metric) for name in results.parameters]
        rows.append([code(metric), *("constant" if constant else "" if rho is None else f"{rho:.2f}" for rho in found)])
    chance = (
        f" Without correlation, magnitudes are below {1.96 / math.sqrt(count - 1):.2f} in 95 % of cases."
        if count > 2
        else ""
    )
    yield f"Spearman's rank correlation coefficients.{chance}"
    yield markdown_table(("metric", *map(code, results.parameters)), rows)
    if results.kind == "saltelli":
        yield "Sobol indices: first order, the fraction of the variance due to the parameter alone, and total."
        yield markdown_table(
            ("metric", *map(code, results.parameters)), (_indices(results, metric) for metric in results.metrics)
        )


def _indices(results: Results, metric: str) -> list[str]:
    try:
        found = sobol_indices(results, metric)
    except ValueError as reason:
        return [code(metric), str(reason), *[""] * (len(results.parameters) - 1)]
    cells = [
        f"{each.first:.2f} ({each.first_interval[0]:.2f} to {each.first_interval[1]:.2f}), "
        f"total {each.total:.2f} ({each.total_interval[0]:.2f} to {each.total_interval[1]:.2f})"
        for each in found
    ]
    return [code(metric), *cells]


def _failures(results: Results) -> Iterator[str]:
    found = groups(results)
    if not found:
        yield "None."
        return
    rows = [
        [escaped(each.how), escaped(each.phase), str(len(each.runs)), _runs(each.runs), escaped(each.message)]
        for each in found
    ]
    yield markdown_table(("failure", "last phase", "number", "runs", "message of the first"), rows)
    differing = differences(results)
    if not differing:
        yield "Too few runs on one side for a comparison of their parameters."
        return
    yield (
        "Parameters by which they differ from the others: Kolmogorov-Smirnov distance of the distribution functions, and "
        "p-value, corrected for the number of parameters (Holm)."
    )
    yield markdown_table(
        ("parameter", "distance", "p-value"),
        ([code(each.parameter), f"{each.statistic:.2f}", f"{each.probability:.2g}"] for each in differing),
    )


def _runs(runs: Sequence[int]) -> str:
    shown = ", ".join(map(str, runs[:_SHOWN_RUNS]))
    return shown if len(runs) <= _SHOWN_RUNS else f"{shown}, ..."


def samples(results: Results) -> str:
    """Table of the sampled parameters."""
    rows = []
    for name in results.parameters:
        values = numbers(results.sample, name)
        if np.isfinite(values).all():
            rows.append([code(name), *(number(float(f(values))) for f in (np.min, np.median, np.max))])
        else:
            counts = Counter(str(row[name]) for row in results.sample)
            rows.append(
                [code(name), ", ".join(f"{escaped(value)}: {count}" for value, count in counts.most_common()), "", ""]
            )
    return markdown_table(("parameter", "minimum", "median", "maximum"), rows)
