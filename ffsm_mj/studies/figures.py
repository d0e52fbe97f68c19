"""Figures of a study: error against effort, and paired differences with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.evaluation.paired import bootstrap_interval
from ffsm_mj.report.plots.style import BLACK, BLUE, COLOURS, VERMILION, WIDTH_IN, plain, publication, write
from ffsm_mj.studies.comparison import StudyComparison, VariantPair
from ffsm_mj.studies.config import ParetoConfig
from ffsm_mj.studies.results import SUCCESS, StudyResults

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DPI = 130
_MARKERS = "osD^vP*X<>"
_WIDE = 30.0
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""
_MOST_PAIRS = 15


def save_figures(results: StudyResults, comparison: StudyComparison, folder: Path) -> list[tuple[str, str]]:
    """Write the figures.

    Args:
        results: Results of the study.
        comparison: Their comparison.
        folder: Existing folder to write to.

    Returns:
        Title and file name of each figure.
    """
    drawn = []
    if (axes := results.config.pareto) is not None and (figure := _pareto(results, axes)) is not None:
        drawn.append((f"{axes.error} against {axes.effort}", "pareto", figure))
    if (
        comparison.pairs
        and len(comparison.pairs) <= _MOST_PAIRS
        and (figure := _differences(results, comparison)) is not None
    ):
        drawn.append(("paired differences with 95 % intervals", "differences", figure))
    for _, name, figure in drawn:
        write(figure, folder, name, ("png",), dpi=_DPI)
    return [(what, f"{name}.png") for what, name, _ in drawn]


def _pareto(results: StudyResults, axes: ParetoConfig) -> Figure | None:
    """Means of error and effort with their intervals, and the variants that no other one beats in both."""
    points = {}
    for name in results.variants:
        x, y = results.values(name, axes.effort), results.values(name, axes.error)
        known = np.isfinite(x) & np.isfinite(y)
        if known.any():
            points[name] = (x[known], y[known])
    if not points:
        return None
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 4.4), layout="constrained")
        panel = figure.subplots()
        for i, (name, (x, y)) in enumerate(points.items()):
            colour, marker = COLOURS[i % len(COLOURS)], _MARKERS[i % len(_MARKERS)]
            panel.scatter(x, y, s=14.0, color=colour, alpha=0.3, linewidths=0.0, marker=marker)
            panel.errorbar(
                *(x.mean(), y.mean()),
                xerr=_arms(x),
                yerr=_arms(y),
                color=colour,
                marker=marker,
                markersize=7.0,
                linestyle="none",
                label=plain(name),
                markeredgecolor=BLACK,
                markeredgewidth=0.6,
                elinewidth=1.2,
                capsize=2.0,
            )
        means = {name: (float(x.mean()), float(y.mean())) for name, (x, y) in points.items()}
        front = sorted(means[name] for name in pareto_front(means))
        panel.step(*zip(*front, strict=True), where="post", color=BLACK, linewidth=0.9, linestyle=(0, (4.0, 2.0)), zorder=0)
        panel.set_xlabel(plain(axes.effort))
        panel.set_ylabel(plain(axes.error))
        _scale(panel, [x for x, _ in points.values()], [y for _, y in points.values()])
        panel.set_title("means with 95 % intervals, and all runs; dashed: Pareto front of the means", fontsize=8.5)
        figure.legend(loc="outside right upper", title="variant")
    return figure


def _arms(values: FloatArray) -> FloatArray | None:
    """Distances of the ends of an interval from the mean, (2, 1); None for one value."""
    low, high = bootstrap_interval(values)
    mean = float(values.mean())
    return None if np.isnan(low) else np.maximum(np.array([[mean - low], [high - mean]]), 0.0)


def _scale(panel: Axes, x: Sequence[FloatArray], y: Sequence[FloatArray]) -> None:
    for values, scale in ((np.concatenate(x), panel.set_xscale), (np.concatenate(y), panel.set_yscale)):
        if values.min() > 0.0 and values.max() > _WIDE * values.min():
            scale("log")


def pareto_front(points: dict[str, tuple[float, float]]) -> list[str]:
    """Names of the points that no other point beats: at most as large in both coordinates, and smaller in one."""
    return [
        name
        for name, (x, y) in points.items()
        if not any(a <= x and b <= y and (a < x or b < y) for other, (a, b) in points.items() if other != name)
    ]


def _differences(results: StudyResults, comparison: StudyComparison) -> Figure | None:
    """A panel per metric that differs: the mean difference of each pair with its interval."""
    wanted = [*([SUCCESS] if results.config.conditions else []), *(results.config.objectives or results.metrics)]
    metrics = [name for name in wanted if _varies(comparison, name)]
    if not metrics:
        return None
    pairs = comparison.pairs
    columns = min(len(metrics), 2)
    lines = -(-len(metrics) // columns)
    with publication():
        figure = Figure(figsize=(WIDTH_IN, lines * (0.9 + 0.24 * len(pairs))), layout="constrained")
        grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
        for panel, metric in zip(grid.flat, metrics, strict=False):
            for place, pair in enumerate(pairs):
                _interval(panel, place, pair, metric)
            panel.axvline(0.0, color=BLACK, linewidth=0.8)
            panel.set_title(plain(metric), fontsize=8.5)
            panel.set_yticks(range(len(pairs)), labels=[plain(f"{pair.second} - {pair.first}") for pair in pairs])
            panel.set_ylim(len(pairs) - 0.5, -0.5)
            panel.grid(visible=False, axis="y")
        for panel in list(grid.flat)[len(metrics) :]:
            panel.set_axis_off()
        figure.suptitle("mean paired differences with 95 % intervals; open: no difference is shown", fontsize=8.5)
    return figure


def _varies(comparison: StudyComparison, metric: str) -> bool:
    found = [pair.differences[metric] for pair in comparison.pairs if metric in pair.differences]
    return any(each.lower or each.higher for each in found)


def _interval(panel: Axes, place: int, pair: VariantPair, metric: str) -> None:
    if (found := pair.differences.get(metric)) is None:
        return
    colour = VERMILION if found.sign else BLUE
    if found.n > 1:
        panel.plot([found.low, found.high], [place, place], color=colour, linewidth=2.0)
    panel.plot([found.mean], [place], "o", color=colour, markersize=4.5, markerfacecolor=colour if found.sign else "white")
