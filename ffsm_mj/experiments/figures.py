"""Figures of a campaign: metrics, convergence, trajectories of repeated runs, and comparisons of variants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.experiments.comparison import VariantComparison, VariantPair
from ffsm_mj.experiments.file import ParetoConfig
from ffsm_mj.experiments.results import GOOD, SUCCESS, Results, VariantResults, finite, numbers, passed
from ffsm_mj.experiments.statistics import intervals, is_constant, mean_interval
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.records.signals import identifier
from ffsm_mj.report.plots.motion import draw_plane
from ffsm_mj.report.plots.panels import envelope
from ffsm_mj.report.plots.silhouette import Plane
from ffsm_mj.report.plots.style import BLACK, BLUE, COLOURS, VERMILION, WIDTH_IN, plain, publication, write
from ffsm_mj.report.plots.subject import Subject

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame


_COLUMNS = 4
_DPI = 130
_INK = 600.0
"""Area of all marks of a scatter plot, points^2: few runs have large marks."""
_MOST_POINTS = 5000
"""Largest number of points in a scatter plot; more would overlap and make a large file."""


def save_figures(results: Results, rerun_runs: Sequence[tuple[bool, Run]], folder: Path) -> list[tuple[str, str]]:
    """Write the figures; constant metrics have none.

    Args:
        results: Results of the campaign.
        rerun_runs: Repeated runs, and whether each is good.
        folder: Existing folder to write to.

    Returns:
        Title and file name of each figure.
    """
    varied = [metric for metric in results.metrics if not is_constant(finite(passed(results.frame), metric))]
    drawn = [
        (f"{metric} against each parameter", f"metric-{identifier(metric)}", _against_parameters(results, metric))
        for metric in varied
    ]
    shown_metrics = [
        what for what in ([SUCCESS] if results.has_success else []) + varied if len(intervals(results, what)) > 1
    ]
    if shown_metrics:
        drawn.append(("intervals against the number of runs", "convergence", _convergence(results, shown_metrics)))
    if rerun_runs:
        drawn.append(("trajectories of repeated runs", "trajectories", _trajectories(rerun_runs)))
    for _, name, figure in drawn:
        write(figure, folder, name, ("png",), dpi=_DPI)
    return [(what, f"{name}.png") for what, name, _ in drawn]


def _grid(count: int, height_in: float) -> tuple[Figure, list[Axes]]:
    columns = min(count, _COLUMNS)
    rows = -(-count // columns)
    figure = Figure(figsize=(WIDTH_IN, 0.4 + height_in * rows), layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for spare in panels[count:]:
        spare.set_axis_off()
    return figure, panels[:count]


def _against_parameters(results: Results, metric: str) -> Figure:
    rows = results.frame.head(_MOST_POINTS)
    good = rows[GOOD].to_numpy(np.bool_)
    y = numbers(rows, metric)
    size = min(max(_INK / len(rows), 3.0), 30.0)
    with publication():
        figure, panels = _grid(len(results.parameters), 1.6)
        for axes, name in zip(panels, results.parameters, strict=True):
            x, ticks = _axis(rows, name)
            for side, colour, label, area in ((good, BLUE, "success", size), (~good, VERMILION, "no success", 2 * size)):
                axes.scatter(x[side], y[side], s=area, color=colour, alpha=0.6, linewidths=0.0, label=label)
            lacking = x[~good & ~np.isfinite(y)]
            axes.plot(lacking, np.zeros(len(lacking)), "|", color=VERMILION, transform=axes.get_xaxis_transform())
            axes.set_xlabel(_in_two_lines(name), fontsize=7.0)
            axes.tick_params(labelsize=6.5)
            if ticks:
                axes.set_xticks(range(len(ticks)), labels=[plain(tick) for tick in ticks])
        for axes in panels[::_COLUMNS]:
            axes.set_ylabel(_in_two_lines(metric), fontsize=7.5)
        if (~good).any():
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _axis(rows: DataFrame, name: str) -> tuple[Any, list[str]]:
    """Values of a parameter for an axis; texts become positions with tick labels."""
    values = numbers(rows, name)
    if np.isfinite(values).all():
        return values, []
    labels = [str(value) for value in rows[name]]
    texts = sorted(set(labels))
    return np.array([float(texts.index(text)) for text in labels]), texts


def _in_two_lines(name: str) -> str:
    name = plain(name)
    if len(name) <= 24:
        return name
    middle = min((i for i, c in enumerate(name) if c == "."), key=lambda i: abs(i - len(name) // 2), default=len(name) // 2)
    return f"{name[: middle + 1]}\n{name[middle + 1 :]}"


def _convergence(results: Results, shown_metrics: Sequence[str]) -> Figure:
    with publication():
        figure, panels = _grid(len(shown_metrics), 1.5)
        for axes, what in zip(panels, shown_metrics, strict=True):
            points = intervals(results, what)
            runs = [*points]
            low = [np.nan if point.low is None else point.low for point in points.values()]
            high = [np.nan if point.high is None else point.high for point in points.values()]
            axes.fill_between(runs, low, high, color=BLUE, alpha=0.2, linewidth=0.0)
            axes.plot(runs, [point.value for point in points.values()], "o-", color=BLUE, markersize=3.0)
            axes.set_xscale("log", base=2)
            axes.set_xticks(runs[:: -(-len(runs) // 5)], labels=[f"{tick}" for tick in runs[:: -(-len(runs) // 5)]])
            axes.set_xlabel("runs", fontsize=7.0)
            axes.set_ylabel("fraction" if what == SUCCESS else "median", fontsize=7.0)
            axes.set_title("successes" if what == SUCCESS else _in_two_lines(what), fontsize=7.0)
            axes.tick_params(labelsize=6.5)
    return figure


def _trajectories(rerun_runs: Sequence[tuple[bool, Run]]) -> Figure:
    """Paths of tip and objects, or of all bodies without a task, in the plane of the first run's motion; the tip error."""
    subjects = [(good, Subject(run)) for good, run in rerun_runs]
    plane = subjects[0][1].planes[0]
    tipped = [(good, run) for good, run in rerun_runs if run.summary()["tip"] is not None]
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 5.6 if tipped else 3.6), layout="constrained")
        grid = figure.subplots(2 if tipped else 1, 1, squeeze=False, height_ratios=(2, 1) if tipped else (1,))[:, 0]
        paths = [(good, path[:, plane.axes]) for good, subject in subjects for path in _paths(subject)]
        draw_plane(grid[0], subjects[0][1], plane, _box([path for _, path in paths], subjects[0][1], plane))
        for good, path in paths:
            grid[0].plot(*path.T, **_line(good))
        for good, run in tipped:
            grid[1].plot(*envelope(run.time, run.tip_error()), **_line(good))
        if tipped:
            grid[1].set_xlabel("time, s")
            grid[1].set_ylabel("tip error, m")
        what = "the tip and the objects" if tipped else "robot and objects"
        grid[0].set_title(f"{len(rerun_runs)} runs: paths of {what}; dashed: no success")
    return figure


def _paths(subject: Subject) -> list[FloatArray]:
    if subject.tip is None:
        return list(subject.roots.values())
    robot = subject.system.robot.name
    return [subject.tip, *(path for name, path in subject.roots.items() if name != robot)]


def _box(paths: Sequence[FloatArray], subject: Subject, plane: Plane) -> tuple[float, float, float, float]:
    """Bounding box of paths and target with a margin: (left, right, bottom, top), m."""
    task = logged_task(subject.run.log.header.metadata)
    target = [task.point_m[None, plane.axes]] if task is not None and set(plane.axes) <= set(task.axes) else []
    points = np.vstack([*paths, *target])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float(np.max(high - low)) + 1e-3
    return low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin


def _line(good: bool) -> dict[str, Any]:
    return {"color": BLUE if good else VERMILION, "linestyle": "-" if good else "--", "linewidth": 0.8, "alpha": 0.7}


_MARKERS = "osD^vP*X<>"
_WIDE = 30.0
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""
_MOST_PAIRS = 15


def save_variant_figures(comparison: VariantComparison, folder: Path) -> list[tuple[str, str]]:
    """Write the figures.

    Args:
        comparison: The comparison of the variants.
        folder: Existing folder to write to.

    Returns:
        Title and file name of each figure.
    """
    drawn, results = [], comparison.results
    if (axes := results.config.pareto) is not None and (figure := _pareto(results, axes)) is not None:
        drawn.append((f"{axes.error} against {axes.effort}", "pareto", figure))
    if 0 < len(comparison.pairs) <= _MOST_PAIRS and (figure := _paired_differences(comparison)) is not None:
        drawn.append(("paired differences with 95 % intervals", "differences", figure))
    for _, name, figure in drawn:
        write(figure, folder, name, ("png",), dpi=_DPI)
    return [(what, f"{name}.png") for what, name, _ in drawn]


def _pareto(results: VariantResults, axes: ParetoConfig) -> Figure | None:
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
    low, high = mean_interval(values)
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


def _paired_differences(comparison: VariantComparison) -> Figure | None:
    """A panel per metric that differs: the mean difference of each pair with its interval."""
    results = comparison.results
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


def _varies(comparison: VariantComparison, metric: str) -> bool:
    differences = [pair.differences[metric] for pair in comparison.pairs if metric in pair.differences]
    return any(difference.lower or difference.higher for difference in differences)


def _interval(panel: Axes, place: int, pair: VariantPair, metric: str) -> None:
    if (difference := pair.differences.get(metric)) is None:
        return
    colour = VERMILION if difference.sign else BLUE
    if difference.n > 1:
        panel.plot([difference.low, difference.high], [place, place], color=colour, linewidth=2.0)
    panel.plot(
        [difference.mean], [place], "o", color=colour, markersize=4.5, markerfacecolor=colour if difference.sign else "white"
    )
