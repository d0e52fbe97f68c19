"""Frames of an animation: robot and objects in their plane of motion or, for motion in space, in three views."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.markers import arrow_colour, arrow_series, declared_arrows, drawn_marks
from ffsm_mj.log.palette import hexadecimal
from ffsm_mj.records.kinds import ArrowColumns
from ffsm_mj.report.plots.motion import draw_plane, legend_columns, mark_handles, polygons, tree_colours, view_box
from ffsm_mj.report.plots.silhouette import Plane
from ffsm_mj.report.plots.style import BLACK, MARK, plain
from ffsm_mj.report.plots.subject import Subject

_SIZE_PX = (960, 720)
_DPI = 120
_FLASH_S = 0.5
_ARROW = 0.12
"""Length of force arrows as a fraction of the height of the frame."""
_AROUND, _SMALL = 3.0, 0.4
"""Size of a view that follows the robot: relative to the robot, and at most relative to the whole motion."""
_TOP, _FRONT, _SIDE = Plane(0, 1), Plane(0, 2), Plane(1, 2)

Box = tuple[float, float, float, float]


def pictures(subject: Subject, times: FloatArray, speed: float) -> Iterator[Any]:
    """RGB frames, (height, width, 3) uint8, at some simulation times in s; ``speed`` is displayed in the caption."""
    run = subject.run
    rows = [min(int(np.searchsorted(run.time, time - 1e-9)), len(run.time) - 1) for time in times]
    some = rows[:: max(1, len(rows) // 40)]
    side_m = _followed_m(subject, some)
    arranged = _from_one_side if len(subject.planes) == 1 else _from_three_sides
    figure, views = arranged(subject, some, side_m)
    canvas: Any = FigureCanvasAgg(figure)
    title = figure.suptitle(_caption(run, 0.0, speed), x=0.03, ha="left", fontsize=9.0)
    figure.draw_without_rendering()  # compute the layout once
    figure.set_layout_engine("none")
    for row in rows:
        time = float(run.time[row])
        for view in views if side_m else ():
            view.follow(row, side_m)
        passing = [artist for view in views for artist in view.show(row, speed)]
        title.set_text(_caption(run, time, speed))
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
        for artist in passing:
            artist.remove()


class _View:
    """Axes with the projection onto one plane."""

    def __init__(self, axes: Axes, subject: Subject, plane: Plane, box: Box) -> None:
        """Set up empty axes with trails."""
        self._axes, self._subject, self._plane, self._box = axes, subject, plane, box
        draw_plane(axes, subject, plane, box)
        self._trails = {
            name: axes.plot([], [], color=colour, linewidth=1.2, zorder=20)[0]
            for name, colour in tree_colours(subject).items()
        }
        self._tip = [axes.plot([], [], color=part.colour, linewidth=1.4, zorder=22)[0] for part in subject.tip_parts]
        self._star = axes.plot([], [], "*", markersize=16, markerfacecolor=MARK, markeredgecolor=BLACK, zorder=31)[0]
        log = subject.run.log
        self._marks, self._arrows = drawn_marks(log.events, 1.0), declared_arrows(log.header)

    def follow(self, row: int, side_m: float) -> None:
        """Show a square around the robot."""
        for middle, limit in zip(_robot(self._subject, row, self._plane).mean(axis=0), "xy", strict=True):
            self._axes.set(**{f"{limit}lim": (middle - 0.5 * side_m, middle + 0.5 * side_m)})

    def show(self, row: int, speed: float) -> list[Any]:
        """Draw the state of a row; return the artists to remove before the next frame."""
        subject, plane, time = self._subject, self._plane, float(self._subject.run.time[row])
        shapes = polygons(subject.silhouette.outlines(subject.run.qpos[row], plane), subject, 0.8, 5)
        past = subject.chosen <= row
        for name, path in subject.roots.items():
            self._trails[name].set_data(*path[past][:, plane.axes].T)
        for line, part in zip(self._tip, subject.tip_parts, strict=True):
            line.set_data(*part.points[part.rows <= row][:, plane.axes].T)
        flashing = [drawn for drawn in self._marks if 0.0 <= time - drawn.time_s <= _FLASH_S * speed]
        hits = [np.array(drawn.mark.point_m)[plane.axes] for drawn in flashing]
        self._star.set_data(*np.array(hits).reshape(-1, 2).T)
        shown = (*self._axes.get_xlim(), *self._axes.get_ylim())
        pushes = _arrows(self._arrows, np.asarray(subject.run.log.rows[row : row + 1]), plane, shown)
        return [self._axes.add_collection(part, autolim=False) for part in (shapes, pushes)]


def _followed_m(subject: Subject, rows: Sequence[int]) -> float:
    """Side of the square views that follow the robot, m; zero if views of the whole motion show it large enough."""
    sizes = [np.ptp(_robot(subject, row, plane), axis=0) for row in rows for plane in subject.planes]
    side = _AROUND * float(np.max(sizes))
    boxes = [view_box(subject, plane, rows) for plane in subject.planes]
    whole = max(max(box[1] - box[0], box[3] - box[2]) for box in boxes)
    return side if side < _SMALL * whole else 0.0


def _robot(subject: Subject, row: int, plane: Plane) -> FloatArray:
    """Corners of the box around the robot in a row, (2, 2), m."""
    name = subject.system.robot.name
    shapes = [outline for outline in subject.silhouette.outlines(subject.run.qpos[row], plane) if outline.tree == name]
    points = np.vstack([shape.points for shape in shapes] or [subject.roots[name][:1, plane.axes]])
    return np.array((points.min(axis=0), points.max(axis=0)))


def _from_one_side(subject: Subject, rows: Sequence[int], side_m: float) -> tuple[Figure, list[_View]]:
    """Figure with one view of the plane of motion, and the legend below it."""
    plane = subject.planes[0]
    box = (0.0, side_m, 0.0, side_m) if side_m else view_box(subject, plane, rows)
    handles = _legend(subject)
    columns = legend_columns(handles, _SIZE_PX[0] / _DPI)
    words = 60 + 24 * -(-len(handles) // columns)
    figure = Figure(figsize=_figure_size(box[1] - box[0], box[3] - box[2], words), dpi=_DPI, layout="constrained")
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, columnspacing=1.2)
    return figure, [_View(figure.subplots(), subject, plane, box)]


def _from_three_sides(subject: Subject, rows: Sequence[int], side_m: float) -> tuple[Figure, list[_View]]:
    """Figure with top, front and side views to one scale, and the legend in the corner."""
    ranges: dict[int, tuple[float, float]] = {}
    for plane in (_TOP, _FRONT, _SIDE):
        box = view_box(subject, plane, rows)
        for axis, low, high in ((plane.right, *box[:2]), (plane.up, *box[2:])):
            before = ranges.get(axis, (low, high))
            ranges[axis] = min(low, before[0]), max(high, before[1])
    if side_m:
        ranges = dict.fromkeys(ranges, (0.0, side_m))
    x, y, z = (high - low for _, (low, high) in sorted(ranges.items()))
    figure = Figure(figsize=_figure_size(x + y, y + z, 80), dpi=_DPI, layout="constrained")
    grid = figure.subplots(2, 2, width_ratios=(x, y), height_ratios=(y, z))
    grid[0, 1].set_axis_off()
    grid[0, 1].legend(handles=_legend(subject), loc="center")
    places = ((_TOP, grid[0, 0]), (_FRONT, grid[1, 0]), (_SIDE, grid[1, 1]))
    for (_, axes), name in zip(places, ("from above", "from the front", "from the side"), strict=True):
        axes.set_title(name, fontsize=8.0, color="#444444")
    return figure, [_View(axes, subject, p, (*ranges[p.right], *ranges[p.up])) for p, axes in places]


def _legend(subject: Subject) -> list[Line2D]:
    handles = [Line2D([], [], color=part.colour, linewidth=1.4, label=part.label) for part in subject.tip_parts]
    for i, (name, colour) in enumerate(tree_colours(subject).items()):
        label = plain(name).replace("_", " ") if i else "base"
        handles.append(Line2D([], [], color=colour, linewidth=1.2, label=label))
    return handles + mark_handles(subject)


def _arrows(arrows: list[ArrowColumns], row: FloatArray, plane: Plane, box: Box) -> Any:
    """Arrows of one length in space along contact forces and loads on grasped objects, ending where they act."""
    length, drawn, colours = _ARROW * (box[3] - box[2]), [], []
    for series in (arrow_series(arrow, row, 1.0) for arrow in arrows if not arrow.is_torque):
        if series.acts[0]:
            end = (series.origins[0] + series.vectors[0])[plane.axes]
            along = length * (series.vectors[0] / np.linalg.norm(series.vectors[0]))[plane.axes]
            across = 0.2 * np.array([-along[1], along[0]])
            drawn += [[end - along, end], [end - 0.3 * along + across, end, end - 0.3 * along - across]]
            colours += 2 * [hexadecimal(arrow_colour(series.columns))]
    return LineCollection(drawn, colors=colours, linewidths=2.2, zorder=30)


def _figure_size(wide: float, high: float, words_px: float) -> tuple[float, float]:
    """Figure size in inches within the maximum size in pixels; both are even, as video codecs require.

    Args:
        wide: Width of the drawing, in any unit.
        high: Height of the drawing, in the same unit.
        words_px: Height of the text above and below it.
    """
    shape = wide / high
    width = min(_SIZE_PX[0], _SIZE_PX[1] * shape)
    return 2 * round(width / 2) / _DPI, 2 * round((width / shape + words_px) / 2) / _DPI


def _caption(run: Run, time: float, speed: float) -> str:
    phase = next((p.name for p in reversed(run.phases) if p.start_s <= time), "")
    return f"t = {time:6.2f} s   {plain(phase).replace('_', ' ')}   ({speed:g}x)"
