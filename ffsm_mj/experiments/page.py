"""The page of a campaign's report, as Markdown."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import plural
from ffsm_mj.experiments.comparison import LEAST_RUNS, PairedDifference, VariantComparison, VariantPair
from ffsm_mj.experiments.results import GOOD, SUCCESS, Results, VariantResults, finite, numbers
from ffsm_mj.experiments.sentences import sentences_of
from ffsm_mj.experiments.statistics import (
    CONFIDENCE,
    LEAST_RANKED,
    Proportion,
    digits_of,
    groups,
    intervals,
    is_constant,
    mean_text,
    parameter_differences,
    quantile,
    rank_correlation,
    sobol_indices,
    values_for_upper_end,
)
from ffsm_mj.report.markdown import code, escaped, markdown_table, number, percent
from ffsm_mj.yaml import write_flow

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
_HEAD = ("first", "second", "runs", "mean of first", "mean of second", "difference", "interval", "less", "more", "shown")
_MOST_SENTENCES = 3
"""With more pairs of variants, their differences are in the table only."""


def report_page(results: VariantResults, comparison: VariantComparison | None, figures: Sequence[tuple[str, str]]) -> str:
    """Markdown text of the report.

    Args:
        results: Results of the campaign.
        comparison: Their comparison; None without variants.
        figures: Title of each figure, and its path relative to the page.
    """
    config, first = results.config, next(iter(results.variants.values()))
    if comparison is None and first.frame.empty:
        return f"# {escaped(config.campaign)}\n\n0 of {plural(first.runs, 'run')} have a result.\n"
    sentences = sentences_of(first, config.conditions) if comparison is None else comparison.sentences()
    parts = [
        f"# {escaped(config.campaign)}",
        *([html.escape(config.description, quote=False)] if config.description else []),
        _head(results),
        "## Result",
        _list(sentences) or "Nothing is compared yet.",
        *(f"![{what}]({file})" for what, file in figures),
        *([] if comparison is None else ["## Variants", _variants(results)]),
        "## Outcomes",
        *_outcomes(results),
        "## Metrics",
        _metrics(results),
        *([] if comparison is None else ["## Paired differences", *_paired_differences(comparison)]),
        "## Convergence",
        *_by_variant(results, _convergence),
        "## Sensitivity",
        *_by_variant(results, _sensitivity),
        "## Runs without success",
        *_by_variant(results, _not_good),
        "## Samples",
        _samples(first),
    ]
    return "\n\n".join(parts) + "\n"


def _list(lines: Sequence[str]) -> str:
    """Sentences with names of metrics, in which ``*`` is no emphasis."""
    return "\n".join("- " + escaped(line).replace("*", "\\*") for line in lines)


def _by_variant(results: VariantResults, section: Callable[[Results], Iterator[str]]) -> Iterator[str]:
    """A section for every variant with rows."""
    for name, part in results.variants.items():
        if not part.frame.empty:
            yield from [f"### {escaped(name)}"] if name else []
            yield from section(part)


def _head(results: VariantResults) -> str:
    first, several = next(iter(results.variants.values())), results.config.variants
    finished, total = (
        sum(of(part) for part in results.variants.values()) for of in (lambda r: len(r.frame), lambda r: r.runs)
    )
    runs = f"{plural(len(results.variants), 'variant')} of {plural(first.runs, 'run')}" if several else plural(total, "run")
    if finished < total:
        runs = f"{runs}, {finished} of {total} made" if several else f"{finished} of {plural(total, 'run')}"
    same = ", the same for all variants" if several else ""
    sentences = [f"{runs}, samples of kind `{first.kind}`, {plural(len(first.parameters), 'parameter')}{same}."]
    if results.config.success is not None:
        sentences.append(f"A run is a success if {code(results.config.success)} and its checks pass.")
    sentences.append(f"Confidence intervals are two-sided, {100 * CONFIDENCE:g} %.")
    if first.kind in _NOMINAL:
        sentences.append(f"They are approximate: {_NOMINAL[first.kind]} not independent samples.")
    if first.kind == "saltelli":
        sentences.append(
            f"Fractions and quantiles are those of the first {2 * first.n} runs; the others combine parameters of these."
        )
    if first.has_success or results.config.conditions:
        sentences.append("The condition may be met by a run of which a check fails; such a run is no success.")
    return " ".join(sentences)


def _variants(results: VariantResults) -> str:
    rows = []
    for name, variant in results.config.variants.items():
        changes = variant.overrides_after({}) | ({"scenario": variant.scenario} if variant.scenario is not None else {})
        changed = (
            ", ".join(f"{escaped(key)} = {code(write_flow(value))}" for key, value in changes.items())
            or "the scenario as it is"
        )
        reason = results.not_applicable.get(name)
        rows.append([escaped(name), escaped(variant.description), changed, f"no: {escaped(reason)}" if reason else "yes"])
    described = any(row[1] for row in rows)
    head = ("variant", "description", "changes", "applicable")
    shown = [i for i in range(len(head)) if i != 1 or described]
    return markdown_table([head[i] for i in shown], [[row[i] for i in shown] for row in rows], texts=head)


def _outcomes(results: VariantResults) -> Iterator[str]:
    several = bool(results.config.variants)
    rows = [row for name in results.variants for row in _shares(results, name)]
    order = [*dict.fromkeys(row[0] for row in rows)]
    rows.sort(key=lambda row: order.index(row[0]))
    head = ("", *(["variant"] if several else []), "runs", "fraction", "interval")
    yield markdown_table(head, [row if several else [row[0], *row[2:]] for row in rows], texts=("variant",))
    for column, what in _ACCURACY.items():
        values = np.concatenate([numbers(part.frame, column) for part in results.variants.values()])  # failed ones included
        if np.isfinite(values).any():
            lack = int((~np.isfinite(values)).sum())
            but = f"; {lack} of {len(values)} runs have no value" if lack else ""
            yield f"{what}: at most {number(float(np.nanmax(values)))}{but}."


def _shares(results: VariantResults, name: str) -> Iterator[list[str]]:
    """Rows of outcomes of a variant: what, the variant, and the fraction with its interval."""
    variant = results.variants[name]
    sample = variant.sample
    lines = [(f"outcome {code(str(outcome))}", int(count)) for outcome, count in sample["outcome"].value_counts().items()]
    lines.append(("failed (not completed, or a check fails)", int(sample["failed"].sum())))
    if short := sum(numbers(sample, "fails_by_truncation") == 1.0):
        lines.append(("a check fails by the truncation of the step alone (remedy: accuracy in the scenario)", int(short)))
    if name and results.config.conditions:
        lines.append(("condition met", int(results.met(name).sum())))
    if variant.has_success:
        lines.append((SUCCESS, int(sample[GOOD].sum())))
    for what, count in lines if len(sample) else []:
        share = Proportion(count, len(sample))
        yield [what, escaped(name), f"{count} of {len(sample)}", percent(share.value), share.interval_text]


def _metrics(results: VariantResults) -> str:
    several = bool(results.config.variants)
    head = ("metric", *(["variant"] if several else []), "runs", "minimum", "5 %", "median", "95 %", "maximum", "mean")
    rows = []
    for metric in results.metrics:
        for name, part in results.variants.items():
            values = finite(part.valid, metric)
            if not len(values):
                cells = ["no run has a number", *[""] * 5]
            elif is_constant(values):
                cells = [number(float(values[0])), "constant", *[""] * 4]
            else:
                low, high = float(values.min()), float(values.max())
                digits = digits_of(low, high)
                shown = (_quantile(values, share, digits) for share in _SHARES)
                cells = [number(low, digits), *shown, number(high, digits), mean_text(values)]
            rows.append([code(metric), *([escaped(name)] if several else []), str(len(values)), *cells])
    caption = "Over the runs that did not fail and have the metric; quantiles and means with confidence intervals."
    return f"{caption}\n\n{markdown_table(head, rows, texts=('variant',))}"


def _quantile(values: FloatArray, share: float, digits: int) -> str:
    estimate = quantile(values, share)
    value = number(estimate.value, digits)
    low, high = (None if end is None else number(end, digits) for end in (estimate.low, estimate.high))
    if low is not None and high is not None:
        return f"{value} ({low} to {high})"
    if low is not None:
        return f"{value} (from {low}, no upper bound with fewer than {values_for_upper_end(share)} runs)"
    if high is not None:
        return f"{value} (to {high}, no lower bound with fewer than {values_for_upper_end(1.0 - share)} runs)"
    return f"{value} (no bounds)"


def _convergence(results: Results) -> Iterator[str]:
    shown_metrics = [*([SUCCESS] if results.has_success else []), *results.metrics]
    by_metric = {what: intervals(results, what) for what in shown_metrics}
    by_metric = {what: by for what, by in by_metric.items() if by}
    counts = sorted({runs for by in by_metric.values() for runs in by})
    if not counts:
        yield "Fewer than 8 runs."
        return
    rows = [
        [code(what) if what != SUCCESS else what, *(_width(by[runs].width) if runs in by else "" for runs in counts)]
        for what, by in by_metric.items()
    ]
    head = ("interval width after", *(f"{runs} runs" for runs in counts))
    yield "Intervals of the fraction of successes, and of the medians of metrics."
    yield markdown_table(head, rows)


def _width(width: float | None) -> str:
    return "none" if width is None else number(width)


def _sensitivity(results: Results) -> Iterator[str]:
    count = len(results.valid)
    rows = []
    for metric in results.metrics:
        values = finite(results.valid, metric)
        constant = len(values) == 0 or is_constant(values)
        correlations = [None if constant else rank_correlation(results, name, metric) for name in results.parameters]
        rows.append(
            [code(metric), *("constant" if constant else "" if rho is None else f"{rho:.2f}" for rho in correlations)]
        )
    chance = (
        f" Without correlation, magnitudes are below {1.96 / math.sqrt(count - 1):.2f} in 95 % of cases."
        if count >= LEAST_RANKED
        else ""
    )
    yield f"Spearman's rank correlation coefficients, of {LEAST_RANKED} runs or more.{chance}"
    yield markdown_table(("metric", *map(code, results.parameters)), rows)
    if results.kind == "saltelli":
        yield "Sobol indices: first order, the fraction of the variance due to the parameter alone, and total."
        yield markdown_table(
            ("metric", *map(code, results.parameters)), (_indices(results, metric) for metric in results.metrics)
        )


def _indices(results: Results, metric: str) -> list[str]:
    try:
        indices = sobol_indices(results, metric)
    except ValueError as reason:
        return [code(metric), str(reason), *[""] * (len(results.parameters) - 1)]
    texts = [[f"{index.value:.2f} ({index.low:.2f} to {index.high:.2f})" for index in pair] for pair in indices.values()]
    cells = [f"{first}, total {total}" for first, total in texts]
    return [code(metric), *cells]


def _not_good(results: Results) -> Iterator[str]:
    runs = groups(results)
    if not runs:
        yield "None."
        return
    rows = [
        [escaped(group.how), escaped(group.phase), str(len(group.runs)), _runs(group.runs), escaped(group.message)]
        for group in runs
    ]
    yield markdown_table(("reason", "last phase", "number", "runs", "message of the first"), rows)
    differing = parameter_differences(results)
    if differing.empty:
        yield "Too few runs on one side for a comparison of their parameters."
        return
    yield (
        "Parameters by which they differ from the others: Kolmogorov-Smirnov distance of the distribution functions, and "
        "p-value, corrected for the number of parameters (Holm)."
    )
    yield markdown_table(
        ("parameter", "distance", "p-value"),
        (
            [code(str(name)), f"{statistic:.2f}", f"{probability:.2g}"]
            for name, statistic, probability in differing.itertuples()
        ),
    )


def _runs(runs: Sequence[int]) -> str:
    shown = ", ".join(map(str, runs[:_SHOWN_RUNS]))
    return shown if len(runs) <= _SHOWN_RUNS else f"{shown}, ..."


def _samples(results: Results) -> str:
    """Table of the sampled parameters."""
    rows = []
    for name in results.parameters:
        values = numbers(results.sample, name)
        if np.isfinite(values).all():
            rows.append([code(name), *(number(float(f(values))) for f in (np.min, np.median, np.max))])
        else:
            counts = Counter(map(str, results.sample[name]))
            rows.append(
                [code(name), ", ".join(f"{escaped(value)}: {count}" for value, count in counts.most_common()), "", ""]
            )
    return markdown_table(("parameter", "minimum", "median", "maximum"), rows)


def _paired_differences(comparison: VariantComparison) -> Iterator[str]:
    metrics, objectives = comparison.results.compared, comparison.results.config.objectives
    count = len(comparison.pairs) * len(metrics)
    by_chance = (1.0 - CONFIDENCE) * count
    yield (
        "Second variant less first, over the runs that completed and pass their checks in both; `success` over all runs "
        f"that both have. Intervals are two-sided, {100 * CONFIDENCE:g} % each: bootstrap of the mean paired difference, "
        "bias-corrected, accelerated, and expanded for few runs. "
        f"Of {count} intervals without a true difference {by_chance:.1f} exclude zero by chance. A difference is shown if "
        f"its interval excludes zero and {LEAST_RUNS} runs or more differ."
    )
    for metric in metrics:
        differences = [(pair, pair.differences[metric]) for pair in comparison.pairs if metric in pair.differences]
        if not differences:
            continue
        yield f"### {code(metric)}{_goal(objectives, metric)}"
        if not any(change.lower or change.higher for _, change in differences):
            yield "Equal in all variants, run by run."
            continue
        if len(differences) <= _MOST_SENTENCES:
            yield _list([change.sentence(pair.first, pair.second) for pair, change in differences])
        yield markdown_table(_HEAD, [_row(pair, change) for pair, change in differences], texts=("second", "shown"))


def _goal(objectives: Mapping[str, str], metric: str) -> str:
    return f" ({objectives[metric]})" if metric in objectives else ""


def _row(pair: VariantPair, difference: PairedDifference) -> list[str]:
    shown = {-1: "less in second", 0: "no", 1: "more in second"}[difference.sign]
    interval = "one run" if difference.n < 2 else f"{number(difference.low)} to {number(difference.high)}"
    means = [number(value) for value in (difference.first, difference.second, difference.mean)]
    counts = [str(difference.lower), str(difference.higher)]
    return [escaped(pair.first), escaped(pair.second), str(difference.n), *means, interval, *counts, shown]
