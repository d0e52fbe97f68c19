"""The page of a campaign's report."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.evaluation.convergence import SUCCESS, intervals
from ffsm_mj.campaign.evaluation.failures import differences, groups
from ffsm_mj.campaign.evaluation.results import Results, is_good, measured, numbers
from ffsm_mj.campaign.evaluation.sensitivity import rank_correlation, sobol_indices
from ffsm_mj.campaign.evaluation.statistics import CONFIDENCE, Proportion, is_constant, quantile, values_for_upper_end
from ffsm_mj.errors import one_line
from ffsm_mj.report.text_table import markdown_table

_SHARES = (0.05, 0.5, 0.95)
_SHOWN_RUNS = 6
_ACCURACY = {
    "drift": "Drift of energy and momenta over (1 + scale) of each",
    "deepest_overlap_m": "The deepest overlap, in m,",
}
_NOMINAL = {
    "lhs": "points of a Latin hypercube are",
    "sobol": "Sobol points are",
    "saltelli": "Sobol points are",
    "grid": "combinations of a grid are",
}


def report_page(results: Results, description: str, success: str | None, figures: Sequence[tuple[str, str]]) -> str:
    """Markdown.

    Args:
        results: What the campaign came to.
        description: What it says of itself.
        success: When a run is a success, as the file has it.
        figures: What each shows, and its file beside the page.
    """
    if not results.rows:
        return f"# {_cell(results.name)}\n\n0 of {results.runs} runs: there is nothing to tell yet.\n"
    parts = [
        f"# {_cell(results.name)}",
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
        "## What was drawn",
        _drawn(results),
        *(["## Pictures", "A mark at the lower edge is a run that has no such metric."] if figures else []),
        *(f"![{what}]({file})" for what, file in figures),
    ]
    return "\n\n".join(parts) + "\n"


def _head(results: Results, success: str | None) -> str:
    made = f"{len(results.rows)} of {results.runs} runs" if not results.complete else f"{results.runs} runs"
    told = [f"{made}, samples of kind `{results.kind}`, {len(results.parameters)} parameters."]
    if success is not None:
        told.append(f"A run is a success where {_code(success)}.")
    told.append(f"Intervals are two-sided, {100 * CONFIDENCE:g} %.")
    if results.kind in _NOMINAL:
        told.append(f"They are nominal: {_NOMINAL[results.kind]} not independent draws.")
    if results.kind == "saltelli":
        told.append(f"Shares and quantiles are of the first {2 * results.n} runs; the others mix parameters of these.")
    return " ".join(told)


def _outcomes(results: Results) -> str:
    sample = results.sample
    counts = Counter(str(row["outcome"]) for row in sample)
    rows = [_share_row(f"outcome {_code(outcome)}", count, len(sample)) for outcome, count in counts.most_common()]
    rows.append(
        _share_row("failed (did not come to the end, or fails a check)", sum(r["failed"] for r in sample), len(sample))
    )
    if short := sum(row.get("fails_by_truncation") is True for row in sample):
        how = "fails a check by the truncation of the step alone; write accuracy in the scenario"
        rows.append(_share_row(how, short, len(sample)))
    if results.judges:
        rows.append(_share_row("success", sum(map(is_good, sample)), len(sample)))
    parts = [markdown_table(("", "runs", "share", "interval"), rows)]
    for column, what in _ACCURACY.items():
        values = numbers(results.rows, column)  # of every run, those that failed above all
        if np.isfinite(values).any():
            lack = int((~np.isfinite(values)).sum())
            but = f"; {lack} of {len(values)} runs do not tell it" if lack else ""
            parts.append(f"{what} is {_number(float(np.nanmax(values)))} at most{but}.")
    return "\n\n".join(parts)


def _share_row(name: str, count: int, of: int) -> list[str]:
    share = Proportion(count, of)
    low, high = share.interval
    return [name, f"{count} of {of}", _percent(share.value), f"{_percent(low)} to {_percent(high)}"]


def _metrics(results: Results) -> str:
    head = ("metric", "runs", "least", "5 %", "median", "95 %", "greatest")
    rows = []
    for metric in results.metrics:
        values = measured(results.sample, metric)
        if not len(values):
            told = ["no run has it as a number", *[""] * 4]
        elif is_constant(values):
            told = [_number(float(values[0])), "constant", "", "", ""]
        else:
            told = [
                _number(float(values.min())),
                *(_quantile(values, share) for share in _SHARES),
                _number(float(values.max())),
            ]
        rows.append([_code(metric), str(len(values)), *told])
    return "Over the runs that did not fail and have the metric; each quantile with its interval.\n\n" + markdown_table(
        head, rows
    )


def _quantile(values: FloatArray, share: float) -> str:
    found = quantile(values, share)
    if found.low is not None and found.high is not None:
        return f"{_number(found.value)} ({_number(found.low)} to {_number(found.high)})"
    if found.low is not None:
        return f"{_number(found.value)} (from {_number(found.low)}, no upper bound under {values_for_upper_end(share)} runs)"
    if found.high is not None:
        needed = values_for_upper_end(1.0 - share)
        return f"{_number(found.value)} (to {_number(found.high)}, no lower bound under {needed} runs)"
    return f"{_number(found.value)} (no bounds)"


def _convergence(results: Results) -> str:
    watched = [*([SUCCESS] if results.judges else []), *results.metrics]
    found = {what: {each.runs: each for each in intervals(results, what)} for what in watched}
    found = {what: by for what, by in found.items() if by}
    counts = sorted({runs for by in found.values() for runs in by})
    if not counts:
        return "Fewer than 8 runs."
    rows = [
        [_code(what) if what != SUCCESS else what, *(_width(by[runs].width) if runs in by else "" for runs in counts)]
        for what, by in found.items()
    ]
    head = ("width of the interval at", *(f"{runs} runs" for runs in counts))
    return "Of the share of successes, else of the median.\n\n" + markdown_table(head, rows)


def _width(width: float | None) -> str:
    return "none" if width is None else _number(width)


def _sensitivity(results: Results) -> Iterator[str]:
    count = sum(not row["failed"] for row in results.sample)
    rows = []
    for metric in results.metrics:
        values = measured(results.sample, metric)
        constant = len(values) == 0 or is_constant(values)
        found = [None if constant else rank_correlation(results, name, metric) for name in results.parameters]
        rows.append([_code(metric), *("constant" if constant else "" if rho is None else f"{rho:.2f}" for rho in found)])
    chance = f" By chance alone one stays below {1.96 / math.sqrt(count - 1):.2f} in 95 % of cases." if count > 2 else ""
    yield f"Spearman's rank correlations.{chance}"
    yield markdown_table(("metric", *map(_code, results.parameters)), rows)
    if results.kind == "saltelli":
        yield "Sobol's indices: first order, the share of the variance that a parameter explains by itself, and total."
        yield markdown_table(
            ("metric", *map(_code, results.parameters)), (_indices(results, metric) for metric in results.metrics)
        )


def _indices(results: Results, metric: str) -> list[str]:
    try:
        found = sobol_indices(results, metric)
    except ValueError as reason:
        return [_code(metric), str(reason), *[""] * (len(results.parameters) - 1)]
    told = [
        f"{each.first:.2f} ({each.first_interval[0]:.2f} to {each.first_interval[1]:.2f}), "
        f"total {each.total:.2f} ({each.total_interval[0]:.2f} to {each.total_interval[1]:.2f})"
        for each in found
    ]
    return [_code(metric), *told]


def _failures(results: Results) -> Iterator[str]:
    found = groups(results)
    if not found:
        yield "None."
        return
    rows = [
        [_cell(each.how), _cell(each.phase), str(len(each.runs)), _runs(each.runs), _cell(each.message)] for each in found
    ]
    yield markdown_table(("what", "last phase", "number", "runs", "the first says"), rows)
    differing = differences(results)
    if not differing:
        yield "Too few on one side to say by which parameters they differ from the others."
        return
    yield (
        "By which parameters they differ from the others: greatest distance of the distribution functions (Kolmogorov and "
        "Smirnov), and its probability by chance, corrected for the number of parameters (Holm)."
    )
    yield markdown_table(
        ("parameter", "distance", "probability"),
        ([_code(each.parameter), f"{each.statistic:.2f}", f"{each.probability:.2g}"] for each in differing),
    )


def _runs(runs: Sequence[int]) -> str:
    shown = ", ".join(map(str, runs[:_SHOWN_RUNS]))
    return shown if len(runs) <= _SHOWN_RUNS else f"{shown}, ..."


def _drawn(results: Results) -> str:
    rows = []
    for name in results.parameters:
        values = numbers(results.sample, name)
        if np.isfinite(values).all():
            rows.append([_code(name), *(_number(float(f(values))) for f in (np.min, np.median, np.max))])
        else:
            counts = Counter(str(row[name]) for row in results.sample)
            rows.append(
                [_code(name), ", ".join(f"{_cell(value)}: {count}" for value, count in counts.most_common()), "", ""]
            )
    return markdown_table(("parameter", "least", "median", "greatest"), rows)


def _code(name: str) -> str:
    """A name as it is, whatever Markdown would make of it."""
    return "`" + one_line(name).replace("`", "'").replace("|", "\\|") + "`"


def _cell(text: str) -> str:
    """A text of somebody else's in a table: no markup, one line."""
    return html.escape(one_line(text), quote=False).replace("|", "\\|")


def _number(value: float) -> str:
    return f"{value:.4g}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
