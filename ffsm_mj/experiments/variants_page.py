"""Report page of a campaign with variants as Markdown."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.experiments.comparison import (
    LEAST_RUNS,
    PairedDifference,
    VariantComparison,
    VariantPair,
    VariantResults,
)
from ffsm_mj.experiments.page import samples
from ffsm_mj.experiments.planning import flow
from ffsm_mj.experiments.statistics import SUCCESS, Proportion
from ffsm_mj.experiments.summary import confidence_sentence, sentences
from ffsm_mj.report.markdown import code, escaped, markdown_table, number, percent

_HEAD = ("first", "second", "runs", "mean of first", "mean of second", "difference", "interval", "less", "more", "shown")
_MOST_SENTENCES = 3
"""With more pairs of variants, their differences are in the table only."""


def variants_page(results: VariantResults, comparison: VariantComparison, figures: Sequence[tuple[str, str]]) -> str:
    """Markdown text of the report.

    Args:
        results: Results of the campaign.
        comparison: Their comparison.
        figures: Title of each figure, and its path relative to the page.
    """
    config = results.config
    parts = [
        f"# {escaped(config.campaign)}",
        *([html.escape(config.description, quote=False)] if config.description else []),
        _head(results),
        "## Result",
        _list(sentences(results, comparison)) or "Nothing is compared yet.",
        *(f"![{what}]({file})" for what, file in figures),
        "## Variants",
        _variants(results),
        "## Outcomes",
        _outcomes(results),
        "## Metrics",
        _metrics(results),
        "## Paired differences",
        *_differences(results, comparison),
        "## Samples",
        samples(next(iter(results.variants.values()))),
    ]
    return "\n\n".join(parts) + "\n"


def _list(lines: Sequence[str]) -> str:
    return "\n".join(f"- {_text(line)}" for line in lines)


def _text(line: str) -> str:
    """A sentence with names of metrics, in which ``*`` and ``_`` are no emphasis."""
    return escaped(line).replace("*", "\\*")


def _head(results: VariantResults) -> str:
    first = next(iter(results.variants.values()))
    made = sum(len(each.rows) for each in results.variants.values())
    total = sum(each.runs for each in results.variants.values())
    runs = f"{len(results.variants)} variants of {first.runs} runs" + ("" if made == total else f", {made} of {total} made")
    sentences_ = [f"{runs}, samples of kind `{first.kind}`, {len(first.parameters)} parameters, the same for all variants."]
    if results.config.success is not None:
        sentences_.append(f"A run is a success if {code(results.config.success)} and its checks pass.")
    return " ".join(sentences_)


def _variants(results: VariantResults) -> str:
    rows = []
    for name, variant in results.config.variants.items():
        changes = variant.overrides_after({}) | ({"scenario": variant.scenario} if variant.scenario is not None else {})
        told = (
            ", ".join(f"{escaped(key)} = {code(flow(value))}" for key, value in changes.items()) or "the scenario as it is"
        )
        reason = results.not_applicable.get(name)
        rows.append([escaped(name), escaped(variant.description), told, f"no: {escaped(reason)}" if reason else "yes"])
    described = any(row[1] for row in rows)
    head = ("variant", "description", "changes", "applicable")
    keep = [i for i in range(len(head)) if i != 1 or described]
    return markdown_table([head[i] for i in keep], [[row[i] for i in keep] for row in rows], texts=head)


def _outcomes(results: VariantResults) -> str:
    conditional = results.config.success is not None
    head = ["variant", "runs", "completed", "other outcomes", "a check is violated"]
    head += ["condition met", "success", "fraction", "interval"] if conditional else []
    rows = []
    for name in results.variants:
        counts = results.counts(name)
        others = ", ".join(f"{count} {escaped(each)}" for each, count in counts.outcomes.items() if each != "completed")
        row = [
            escaped(name),
            f"{counts.done} of {counts.runs}",
            str(counts.completed),
            others or "none",
            str(counts.violated),
        ]
        if conditional:
            row += [str(counts.met), str(counts.successes), *_share(counts.successes or 0, counts.done)]
        rows.append(row)
    text = markdown_table(head, rows)
    return (
        f"{text}\n\nThe condition may be met by a run of which a check is violated; such a run is no success."
        if conditional
        else text
    )


def _share(count: int, of: int) -> list[str]:
    if not of:
        return ["", ""]
    share = Proportion(count, of)
    low, high = share.interval
    return [percent(share.value), f"{percent(low)} to {percent(high)}"]


def _metrics(results: VariantResults) -> str:
    names = [*results.variants]
    rows = [[code(metric), *(_spread(results.values(name, metric)) for name in names)] for metric in results.metrics]
    head = ("metric", *map(escaped, names))
    return "Mean (minimum to maximum) over the runs that completed and pass their checks.\n\n" + markdown_table(head, rows)


def _spread(values: FloatArray) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return "no number"
    lack = f", {len(known)} of {len(values)} runs" if len(known) < len(values) else ""
    return f"{number(float(known.mean()))} ({number(float(known.min()))} to {number(float(known.max()))}{lack})"


def _differences(results: VariantResults, comparison: VariantComparison) -> Iterator[str]:
    metrics = ([SUCCESS] if results.config.conditions else []) + [*results.metrics]
    yield (
        "Second variant less first, over the runs that completed and pass their checks in both; `success` over all runs "
        f"that both have. {confidence_sentence(len(comparison.pairs), len(metrics))} A difference is shown if its interval "
        f"excludes zero and {LEAST_RUNS} runs or more differ."
    )
    for metric in metrics:
        found = [(pair, pair.differences[metric]) for pair in comparison.pairs if metric in pair.differences]
        if not found:
            continue
        yield f"### {code(metric)}{_goal(results.config.objectives, metric)}"
        if not any(each.lower or each.higher for _, each in found):
            yield "Equal in all variants, run by run."
            continue
        if len(found) <= _MOST_SENTENCES:
            yield _list([each.sentence(pair.first, pair.second) for pair, each in found])
        yield markdown_table(_HEAD, [_row(pair, each) for pair, each in found], texts=("second", "shown"))


def _goal(objectives: Mapping[str, str], metric: str) -> str:
    return f" ({objectives[metric]})" if metric in objectives else ""


def _row(pair: VariantPair, found: PairedDifference) -> list[str]:
    shown = {-1: "less in second", 0: "no", 1: "more in second"}[found.sign]
    interval = "one run" if found.n < 2 else f"{number(found.low)} to {number(found.high)}"
    means = [number(value) for value in (found.first, found.second, found.mean)]
    counts = [str(found.lower), str(found.higher)]
    return [escaped(pair.first), escaped(pair.second), str(found.n), *means, interval, *counts, shown]
