"""Figure of the motion: robot and objects at several times, paths, marks of events (paper, Figs 4, 11, 13 and 18)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log import palette
from ffsm_mj.log.palette import hexadecimal
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.report.plots.silhouette import WORLD, Plane, ProjectedOutline
from ffsm_mj.report.plots.style import BLACK, MARK, TARGET, WIDTH_IN, plain
from ffsm_mj.report.plots.subject import Subject

_POSES = 6
_HANDLE_IN, _LETTER_IN = 0.5, 0.062
"""Widths of the handle before a legend entry, and of a letter of it."""
_TIP_STYLE, _BASE_STYLE, _OBJECT_STYLE = "-", (0, (5.0, 1.5)), (0, (6.0, 1.5, 1.2, 1.5))


def motion(subject: Subject) -> Figure:
    """Stroboscopic figure in the plane of the motion, or in two planes for motion in space."""
    frames = strobe_rows(subject)
    boxes = [view_box(subject, plane, frames) for plane in subject.planes]
    width = WIDTH_IN - 0.7
    heights = [width * (box[3] - box[2]) / (box[1] - box[0]) for box in boxes]
    shrink = min(1.0, 7.5 / sum(heights))
    figure = Figure(figsize=(WIDTH_IN, sum(heights) * shrink + 0.45 * len(boxes) + 0.35), layout="constrained")
    grid = figure.subplots(len(boxes), 1, squeeze=False, height_ratios=heights)
    for axes, plane, box in zip(grid[:, 0], subject.planes, boxes, strict=True):
        draw_plane(axes, subject, plane, box)
        _strobe(axes, subject, plane, frames)
        draw_paths(axes, subject, plane)
        _draw_marks(axes, subject, plane)
        _draw_times(axes, subject, plane, frames, (box[1] - box[0]) / (width * shrink))
    handles = _legend(subject)
    figure.legend(handles=handles, loc="outside upper center", ncols=legend_columns(handles), columnspacing=1.2)
    return figure


def strobe_rows(subject: Subject) -> list[int]:
    """Rows to draw: start, first mark, end, and others spaced by the path length of the tip (or the base)."""
    run = subject.run
    path = run.tip if subject.tip is not None else run.qpos[:, : min(3, run.qpos.shape[1])]
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    rows = {0, len(run.time) - 1}
    if subject.marks:
        rows.add(min(int(np.searchsorted(run.time, subject.first_mark_s)), len(run.time) - 1))
    while len(rows) < min(_POSES, len(run.time)):
        ordered = sorted(rows)
        gap, left = max((along[b] - along[a], a) for a, b in pairwise(ordered))
        middle = int(np.searchsorted(along, along[left] + gap / 2))
        if middle in rows:
            break
        rows.add(middle)
    return sorted(rows)


def view_box(subject: Subject, plane: Plane, rows: Sequence[int]) -> tuple[float, float, float, float]:
    """Bounding box of everything that moves, with a margin: (left, right, bottom, top) in m.

    Fixed bodies are included, but enlarge the box at most by a factor of two, so that a floor or wall does not dominate.
    """
    shapes = [shape for row in rows for shape in subject.silhouette.outlines(subject.run.qpos[row], plane)]
    points = [shape.points for shape in shapes if shape.tree != WORLD]
    points += [path[:, plane.axes] for path in subject.roots.values()]
    if subject.tip is not None:
        points.append(subject.tip[:, plane.axes])
    everything = np.vstack(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    room = 0.5 * float(np.max(high - low))
    still = [np.clip(shape.points, low - room, high + room) for shape in shapes if shape.tree == WORLD]
    everything = np.vstack((low, high, *still))
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.04 * float(np.max(high - low))
    return low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin


def draw_plane(axes: Axes, subject: Subject, plane: Plane, box: tuple[float, float, float, float]) -> None:
    """Set up axes in m with equal scales, and draw the target."""
    axes.set_aspect("equal")
    axes.set_xlim(box[0], box[1])
    axes.set_ylim(box[2], box[3])
    axes.set_xlabel(f"${plane.names[0]}$, m")
    axes.set_ylabel(f"${plane.names[1]}$, m")
    task = logged_task(subject.run.log.header.metadata)
    if task is not None and set(plane.axes) <= set(task.axes):
        moving = task.moving_columns(subject.run.log.header.layout)
        place = task.point_m
        if moving:  # the cross is where it ends
            path = np.asarray(subject.run.log.rows[subject.chosen])[:, moving]
            axes.plot(path[:, plane.axes[0]], path[:, plane.axes[1]], color=TARGET, linewidth=0.9, linestyle=":", zorder=29)
            place = path[-1]
        axes.plot(
            *place[plane.axes],
            marker="+",
            markersize=10,
            markeredgewidth=1.6,
            color=TARGET,
            zorder=30,
            linestyle="none",
        )


def polygons(outlines: Sequence[ProjectedOutline], subject: Subject, strength: float, zorder: float) -> PolyCollection:
    """Outlines as filled polygons; strength from 0 (faint) to 1 (opaque)."""
    colours = tree_colours(subject)
    faces, edges = [], []
    for shape in outlines:
        hue = colours.get(shape.tree, "#888888")
        faces.append(_mix(hue, strength * (0.72 - 0.55 * shape.lightness)))
        edges.append(_mix(hue, 0.15 + 0.85 * strength))
    return PolyCollection(
        [shape.points for shape in outlines],
        facecolors=faces,
        edgecolors=edges,
        linewidths=0.35 + 0.25 * strength,
        zorder=zorder,
    )


def tree_colours(subject: Subject) -> dict[str, str]:
    """Colour of the robot and of each object."""
    names = [tree.name for tree in subject.system.objects]
    hues = {name: hexadecimal(palette.object_colour(i)) for i, name in enumerate(names)}
    return {subject.system.robot.name: hexadecimal(palette.ROBOT)} | hues


def _mix(colour: str, share: float) -> tuple[float, ...]:
    """Blend a colour with white."""
    return tuple(1.0 - share * (1.0 - channel) for channel in to_rgb(colour))


def _strobe(axes: Axes, subject: Subject, plane: Plane, rows: Sequence[int]) -> None:
    """Poses from pale (early) to strong (late), each with its time at the base."""
    for i, row in enumerate(rows):
        strength = 0.25 + 0.75 * (i / max(1, len(rows) - 1)) ** 1.5
        shapes = subject.silhouette.outlines(subject.run.qpos[row], plane)
        axes.add_collection(polygons(shapes, subject, strength, zorder=2 + i), autolim=False)


def draw_paths(axes: Axes, subject: Subject, plane: Plane) -> None:
    """Paths of the tip, the base and the objects."""
    robot = subject.system.robot.name
    for name, path in subject.roots.items():
        style = _BASE_STYLE if name == robot else _OBJECT_STYLE
        colour = tree_colours(subject)[name]
        axes.plot(*path[:, plane.axes].T, color="white", linewidth=2.4, zorder=19)
        axes.plot(*path[:, plane.axes].T, color=colour, linestyle=style, linewidth=1.2, zorder=20)
    for part in subject.tip_parts:
        axes.plot(*part.points[:, plane.axes].T, color="white", linewidth=2.6, zorder=21)
        axes.plot(*part.points[:, plane.axes].T, color=part.colour, linestyle=_TIP_STYLE, linewidth=1.3, zorder=22)


def _draw_marks(axes: Axes, subject: Subject, plane: Plane) -> None:
    """Draw a star for simultaneous records of a kind, at the point of the last one."""
    shown = {(kind.name, time): mark for kind, time, mark in subject.marks}
    points: FloatArray = np.array([np.array(mark.point_m)[plane.axes] for mark in shown.values()]).reshape(-1, 2)
    axes.plot(*points.T, marker="*", markersize=9, markerfacecolor=MARK, markeredgecolor=BLACK, linestyle="none", zorder=31)


def _draw_times(axes: Axes, subject: Subject, plane: Plane, rows: Sequence[int], inch_m: float) -> None:
    """Label poses with their times at base and objects: first mark, start and end first, others if there is room.

    An inch of the figure is ``inch_m`` long.
    """
    run, placed = subject.run, list[FloatArray]()
    first_hit = subject.first_mark_s if subject.marks else run.time[0]
    hit = int(np.searchsorted(run.time, first_hit))
    ranked = sorted(rows, key=lambda row: (row not in (hit, rows[0], rows[-1]), abs(run.time[row] - first_hit)))
    room = np.array((0.5, 0.25)) * inch_m  # size of a label
    for row in ranked:
        nearest = int(np.argmin(np.abs(subject.chosen - row)))
        for path in subject.roots.values():
            at = path[nearest, plane.axes]
            if all((np.abs(at - other) > room).any() for other in placed):
                placed.append(at)
                _time_label(axes, (float(at[0]), float(at[1])), float(run.time[row]))


def _time_label(axes: Axes, at: tuple[float, float], time_s: float) -> None:
    halo = {"facecolor": "white", "alpha": 0.8, "pad": 0.6, "linewidth": 0}
    axes.plot(*at, "o", color=BLACK, markersize=3, zorder=32)
    axes.annotate(
        f"{time_s:.3g} s", at, (0, -6), textcoords="offset points", ha="center", va="top", fontsize=7, bbox=halo, zorder=33
    )


def _legend(subject: Subject) -> list[Line2D]:
    robot = subject.system.robot.name
    colours = tree_colours(subject)
    handles = [Line2D([], [], color=p.colour, linestyle=_TIP_STYLE, label=p.label) for p in subject.tip_parts]
    handles.append(Line2D([], [], color=colours[robot], linestyle=_BASE_STYLE, label="base"))
    for name in list(colours)[1:]:
        handles.append(Line2D([], [], color=colours[name], linestyle=_OBJECT_STYLE, label=plain(name).replace("_", " ")))
    return handles + mark_handles(subject)


def mark_handles(subject: Subject) -> list[Line2D]:
    """Legend entries for marks of events and for the target."""
    handles = []
    if subject.marks:
        label = ", ".join(dict.fromkeys(plain(kind.name).replace("_", " ") for kind, *_ in subject.marks))
        star = Line2D([], [], linestyle="none", marker="*", markersize=10, markeredgecolor=BLACK, label=label)
        star.set_markerfacecolor(MARK)
        handles.append(star)
    if logged_task(subject.run.log.header.metadata) is not None:
        cross = Line2D([], [], linestyle="none", marker="+", markersize=9, markeredgewidth=1.6, color=TARGET, label="target")
        handles.append(cross)
    return handles


def legend_columns(handles: Sequence[Line2D], width_in: float = WIDTH_IN) -> int:
    """Greatest number of legend columns that fit the width of a figure in inches."""
    letters = [len(str(handle.get_label())) for handle in handles]
    most = range(len(handles), 0, -1)
    return next((n for n in most if n * (_HANDLE_IN + _LETTER_IN * max(letters)) < width_in), 1) if letters else 1
