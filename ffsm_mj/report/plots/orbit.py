"""Figures of a run in orbit: paths in the plane of V-bar and R-bar, and the motion of the robot in LVLH over time.

V-bar is to the left and R-bar down, the usual plot of a rendezvous: the H-bar, normal to the orbit, points to the reader,
who sees the central body below and the motion along the orbit counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.log.markers import lvlh_frames
from ffsm_mj.records.signals import effort_key, identifier
from ffsm_mj.report.plots.motion import legend_columns, tree_colours
from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.style import BLACK, COLOURS, MARK, ORANGE, WIDTH_IN, plain
from ffsm_mj.report.plots.subject import Subject

_FLATTEST = 3.0
"""Ratio of width to height beyond which the scales of the plot differ."""
_HEIGHT_IN, _ROOM_IN = 2.9, 0.2
"""Height of the plot, and the least distance of two labels along each of its sides."""
_SHIFT_IN = 0.12
_BARS = (("V-bar", "x", 1.0), ("R-bar", "z", 1.0), ("H-bar", "y", -1.0))
"""Direction, axis of LVLH and sign."""


def orbit(subject: Subject) -> Figure:
    """Paths of robot and objects in the plane of V-bar and R-bar, with burns, phases and marks of events."""
    figure = Figure(figsize=(WIDTH_IN, _HEIGHT_IN + 0.9), layout="constrained")
    axes, run = figure.subplots(), subject.run
    paths = {tree.name: _path(run, tree.name) for tree in subject.system.trees}
    colours, robot = tree_colours(subject), subject.system.robot.name
    handles = []
    for name, path in paths.items():
        label = "base" if name == robot else plain(name).replace("_", " ")
        handles += axes.plot(*path.T, color=colours[name], linewidth=1.4, zorder=20, label=label)
        if name != robot:  # an object at rest has a path of no length
            axes.plot(*path[-1], "s", color=colours[name], markersize=6, zorder=21)
    fires = _fires(subject)
    if fires.any():
        burning = np.where(fires[:, None], paths[robot], np.nan)
        handles += axes.plot(*burning.T, color=ORANGE, linewidth=3.5, alpha=0.8, zorder=19, label="thrusters fire")
    handles += _draw_marks(axes, subject)
    _frame(axes, np.vstack([*paths.values()]))
    _draw_phases(axes, run, paths[robot])
    figure.legend(handles=handles, loc="outside upper center", ncols=legend_columns(handles), columnspacing=1.2)
    return figure


def _path(run: Run, name: str) -> FloatArray:
    """V-bar and R-bar of the base of a robot or object, m, (n, 2)."""
    return np.column_stack([run[f"orbit.{identifier(name)}_{axis}_m"] for axis in "xz"])


def _fires(subject: Subject) -> BoolArray:
    """Whether a thruster fires, of each row."""
    run, fires = subject.run, np.zeros(len(subject.run.time), dtype=np.bool_)
    for name in subject.named("thruster"):
        fires |= run[effort_key(run.log.header.layout, name, "applied")] != 0.0
    return fires


def _frame(axes: Axes, points: FloatArray) -> None:
    """Limits with a margin, V-bar to the left and R-bar down, with equal scales unless the motion is too flat."""
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.maximum(high - low, 1e-3 * max(1.0, float(np.max(high - low))))
    margin = 0.08 * width, 0.16 * height
    axes.set_xlim(high[0] + margin[0], low[0] - margin[0])
    axes.set_ylim(high[1] + margin[1], low[1] - margin[1])
    axes.set_xlabel("V-bar, m")
    axes.set_ylabel("R-bar, m")
    if 1.0 / _FLATTEST < width / height < _FLATTEST:
        axes.set_aspect("equal", adjustable="datalim")
    else:
        axes.set_title("scales of the axes differ", fontsize=8, loc="right")
    axes.axhline(0.0, color=BLACK, linewidth=0.5, zorder=1)
    axes.axvline(0.0, color=BLACK, linewidth=0.5, zorder=1)


def _draw_phases(axes: Axes, run: Run, path: FloatArray) -> None:
    """A dot where each phase begins and at the end, with its name and time where there is room for it."""
    begins = [(phase.start_s, phase.name.replace("_", " ")) for phase in run.phases]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    inch = np.array(((right - left) / (WIDTH_IN - 0.8), (top - bottom) / _HEIGHT_IN))
    placed: list[FloatArray] = []
    for time_s, name in [*begins, (float(run.time[-1]), "end")]:
        at = path[min(int(np.searchsorted(run.time, time_s - 1e-9)), len(path) - 1)]
        axes.plot(*at, "o", color=BLACK, markersize=3.5, zorder=32)
        if any((np.abs((at - other) / inch) < (0.9, _ROOM_IN)).all() for other in placed):
            continue
        placed.append(at)
        to_left = (at[0] - left) / (right - left) > 0.5  # beside the dot, towards the middle
        axes.annotate(
            f"{plain(name)}, {time_s:.4g} s",
            (float(at[0]), float(at[1])),
            (-72.0 * _SHIFT_IN if to_left else 72.0 * _SHIFT_IN, 72.0 * _SHIFT_IN),
            textcoords="offset points",
            ha="right" if to_left else "left",
            va="bottom",
            fontsize=7.5,
            bbox={"facecolor": "white", "alpha": 0.8, "pad": 0.6, "linewidth": 0},
            zorder=33,
        )


def _draw_marks(axes: Axes, subject: Subject) -> Sequence[Line2D]:
    """A star for simultaneous marks of a kind, and its legend entry."""
    run, shown = subject.run, {(kind.name, time): mark for kind, time, mark in subject.marks}
    if not shown:
        return []
    times, places = np.array([time for _, time in shown]), np.array([mark.point_m for mark in shown.values()])
    rows = np.minimum(np.searchsorted(run.time, times), len(run.time) - 1)
    axes_there = lvlh_frames(run.log.header.layout, np.asarray(run.log.rows)[rows])
    points = np.einsum("nji,nj->ni", axes_there, places)[:, [0, 2]]
    label = ", ".join(dict.fromkeys(plain(name).replace("_", " ") for name, _ in shown))
    stars = axes.plot(*points.T, "*", markersize=10, markeredgecolor=BLACK, zorder=31, label=label)
    stars[0].set_markerfacecolor(MARK)
    return stars


def lvlh(subject: Subject) -> Figure:
    """Position and velocity of the base along V-bar, R-bar and H-bar, and the angle of the base to LVLH, over time."""
    run, name = subject.run, identifier(subject.system.robot.name)
    places = [Curve(bar, sign * run[f"orbit.{name}_{axis}_m"], COLOURS[i]) for i, (bar, axis, sign) in enumerate(_BARS)]
    rates = [Curve(bar, sign * run[f"orbit.{name}_v{axis}_m_s"], COLOURS[i]) for i, (bar, axis, sign) in enumerate(_BARS)]
    angle = 2.0 * np.arccos(np.minimum(run[f"orbit.{name}_qw"], 1.0))
    panels = [
        Panel("base in LVLH, m", places),
        Panel("base to LVLH, m/s", rates),
        Panel("angle of base to LVLH, rad", [Curve("_angle", angle, BLACK)]),
    ]
    return stacked(run, panels)
