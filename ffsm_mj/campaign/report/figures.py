"""Figures of a campaign: metrics against parameters, convergence, and trajectories of repeated runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.evaluation.convergence import SUCCESS, intervals
from ffsm_mj.campaign.evaluation.results import Results, TableRow, is_good, metric_numbers, numbers
from ffsm_mj.campaign.evaluation.statistics import is_constant
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.records.signals import identifier
from ffsm_mj.report.plots.motion import draw_plane
from ffsm_mj.report.plots.panels import envelope
from ffsm_mj.report.plots.silhouette import Plane
from ffsm_mj.report.plots.style import BLUE, VERMILION, WIDTH_IN, plain, publication, write
from ffsm_mj.report.plots.subject import Subject

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMNS = 4
_DPI = 130
_INK = 600.0
"""Area of all marks of a scatter plot, points^2: few runs have large marks."""
_MOST_POINTS = 5000
"""Largest number of points in a scatter plot; more would overlap and make a large file."""


def save_figures(results: Results, rerun_runs: Sequence[tuple[TableRow, Run]], folder: Path) -> list[tuple[str, str]]:
    """Write the figures; constant metrics have none.

    Args:
        results: Results of the campaign.
        rerun_runs: Repeated runs, each with its row.
        folder: Existing folder to write to.

    Returns:
        Title and file name of each figure.
    """
    varied = [metric for metric in results.metrics if not is_constant(metric_numbers(results.rows, metric))]
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
    rows = results.rows[:_MOST_POINTS]
    good = np.array([is_good(row) for row in rows], dtype=np.bool_)
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


def _axis(rows: Sequence[TableRow], name: str) -> tuple[Any, list[str]]:
    """Values of a parameter for an axis; texts become positions with tick labels."""
    values = numbers(rows, name)
    if np.isfinite(values).all():
        return values, []
    texts = sorted({str(row[name]) for row in rows})
    return np.array([float(texts.index(str(row[name]))) for row in rows]), texts


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
            found = intervals(results, what)
            runs = [each.runs for each in found]
            low = [np.nan if each.low is None else each.low for each in found]
            high = [np.nan if each.high is None else each.high for each in found]
            axes.fill_between(runs, low, high, color=BLUE, alpha=0.2, linewidth=0.0)
            axes.plot(runs, [each.value for each in found], "o-", color=BLUE, markersize=3.0)
            axes.set_xscale("log", base=2)
            axes.set_xticks(runs[:: -(-len(runs) // 5)], labels=[f"{each}" for each in runs[:: -(-len(runs) // 5)]])
            axes.set_xlabel("runs", fontsize=7.0)
            axes.set_ylabel("fraction" if what == SUCCESS else "median", fontsize=7.0)
            axes.set_title("successes" if what == SUCCESS else _in_two_lines(what), fontsize=7.0)
            axes.tick_params(labelsize=6.5)
    return figure


def _trajectories(rerun_runs: Sequence[tuple[TableRow, Run]]) -> Figure:
    """Paths of tip and objects, or of all bodies without a task, in the plane of the first run's motion; the tip error."""
    subjects = [(row, Subject(run)) for row, run in rerun_runs]
    plane = subjects[0][1].planes[0]
    tipped = [(row, run) for row, run in rerun_runs if run.summary()["tip"] is not None]
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 5.6 if tipped else 3.6), layout="constrained")
        grid = figure.subplots(2 if tipped else 1, 1, squeeze=False, height_ratios=(2, 1) if tipped else (1,))[:, 0]
        paths = [(row, path[:, plane.axes]) for row, subject in subjects for path in _paths(subject)]
        draw_plane(grid[0], subjects[0][1], plane, _box([path for _, path in paths], subjects[0][1], plane))
        for row, path in paths:
            grid[0].plot(*path.T, **_line(row))
        for row, run in tipped:
            grid[1].plot(*envelope(run.time, run.tip_error()), **_line(row))
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


def _line(row: TableRow) -> dict[str, Any]:
    good = is_good(row)
    return {"color": BLUE if good else VERMILION, "linestyle": "-" if good else "--", "linewidth": 0.8, "alpha": 0.7}
