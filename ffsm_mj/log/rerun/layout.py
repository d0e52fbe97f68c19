"""Layout of a recording: a scene at the first event, and beside it tabs of plots; the time and view at which it opens."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.camera import USUAL, aimed, direction, framed_points
from ffsm_mj.log.drawing import Frames, View, camera_path, robot_boxes
from ffsm_mj.log.markers import SHOWN_S
from ffsm_mj.log.palette import AXES
from ffsm_mj.log.rerun.plots import BASE, FORCES, FRICTION_USE, JOINTS, TIMELINE, TORQUES, Extent, Plot
from ffsm_mj.model.system import System

_LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
_NO_LEGEND = rrb.PlotLegend(visible=False)
_LETTER_PX, _BESIDE_PX, _PLOT_PX = 6.4, 34.0, 290.0
"""Widths of a letter of a legend, of its remaining parts, and of a plot in a window of 1300 pixels."""
_MOST_LETTERS = 9
"""Greatest length of a name, that of ``objects x``, for which the time axis has room: all plots share it."""
_MOST_LANES = 5


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Contents of a recording, as far as its layout depends on them.

    Attributes:
        framing: Points to keep in view.
        plots: Plots of columns.
        sensing: Plots of measurements and estimates by the name of their tab.
        extents: Range of the curves of each plot by its entity, as far as it is known: of a stream it is not.
        trails: Names of the trails.
        tip: Whether the tip error is plotted.
        forces: Names of the forces that are plotted.
        torques: Names of the torques that are plotted.
        thrusters: Number of lanes of states of thrusters.
        contacts: Number of lanes of modes of contacts.
    """

    framing: Framing
    plots: Sequence[Plot]
    trails: Sequence[str]
    tip: bool
    forces: Sequence[str]
    torques: Sequence[str] = ()
    thrusters: int = 0
    contacts: int = 0
    sensing: Mapping[str, Sequence[Plot]] = field(default_factory=dict)
    extents: Mapping[str, Extent] = field(default_factory=dict)

    def shown(self, plots: Sequence[Plot]) -> list[Plot]:
        """Those plots that are not empty."""
        return [plot for plot in plots if plot.entity not in self.extents or not self.extents[plot.entity].is_empty]

    @property
    def lanes(self) -> str:
        """Title of the lanes of states."""
        shown = ["Phase", *(["contacts"] if self.contacts else []), *(["thrusters"] if self.thrusters else [])]
        return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


class _Curves(NamedTuple):
    """Contents of one view.

    Attributes:
        origin: Its entity.
        title: Its title, with the unit early, as long titles are cut.
        names: Names in its legend.
        y_range: Range of its y axis; None: that of all curves.
    """

    origin: str
    title: str
    names: Sequence[str] = ()
    y_range: tuple[float, float] | None = None

    @property
    def room(self) -> float:
        """Width of the legend relative to that of the curves, in a row of two plots."""
        if not self.names:
            return 0.0
        letters = min(max(map(len, self.names)), _MOST_LETTERS)
        legend = _BESIDE_PX + _LETTER_PX * letters
        return legend / max(_PLOT_PX - legend, 0.25 * _PLOT_PX)


def blueprint(contents: Contents, opening: Opening | None) -> rrb.Blueprint:
    """Layout of a recording.

    Args:
        contents: Contents of the recording.
        opening: Time and view at which it opens; None for a stream, which is shown at its latest time.
    """
    loop = opening.loop if opening is not None else None
    lanes = 2.0 + min(1 + contents.thrusters + contents.contacts, _MOST_LANES)
    left = rrb.Vertical(
        _scene(contents),
        rrb.StateTimelineView(
            origin="/states",
            name=contents.lanes,
            time_view=None if opening is None else _time_axis(TimeRange(0.0, opening.end_s), 0.0),
        ),
        rrb.TextLogView(origin="/events", name="Events", columns=_event_columns()),
        row_shares=[22.0 - lanes, lanes, 6.0],
    )
    playing: dict[str, Any] = {"play_state": "following" if opening is None else "playing"}
    if loop is not None:
        playing |= {"loop_mode": "selection", "time_selection": _selection(loop)}
    tabs = _tabs(contents, opening)  # none where nothing has moved yet
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Tabs(*tabs, active_tab=0)) if tabs else left,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", **playing),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _scene(contents: Contents) -> rrb.Spatial3DView:
    framing = contents.framing
    return rrb.Spatial3DView(
        origin="/world",
        name=f"Scene, lines every {framing.grid_m:g} m",
        line_grid=framing.ground,
        background=BACKGROUND,
        eye_controls=framing.eye,
        overrides={
            f"world/trails/{name}": [
                rrb.VisibleTimeRanges(
                    timeline=TIMELINE,
                    start=rrb.TimeRangeBoundary.infinite(),
                    end=rrb.TimeRangeBoundary.cursor_relative(),
                )
            ]
            for name in contents.trails
        },
    )


def _selection(time_range: TimeRange) -> rr.encodings.AbsoluteTimeRange:
    return rr.encodings.AbsoluteTimeRange(*(rr.encodings.TimeInt(seconds=time) for time in time_range))


def _event_columns() -> rrb.TextLogColumns:
    """The text, which begins with the time; the entity is always the same."""
    without_time = rrb.encodings.TimelineColumn(TIMELINE, visible=False)
    return rrb.TextLogColumns(timeline_columns=[without_time], text_log_columns=["body"])


def _tabs(contents: Contents, opening: Opening | None) -> list[rrb.Container]:
    whole = TimeRange(0.0, opening.end_s) if opening is not None else None
    close_up = opening.close_up if opening is not None else None
    overview = _overview(contents)
    tabs = {"Overview": overview}
    for name, parent in (("Joints", JOINTS), ("Thrusters and base", BASE)):
        tabs[name] = _efforts(contents, parent)
    for name, plotted in contents.sensing.items():
        tabs[name] = [_titled(plot, contents) for plot in contents.shown(plotted)]
    # All plots have one time axis, with room for the widest legend after the curves.
    room = max((curves.room for plotted in tabs.values() for curves in plotted), default=0.0)
    tabbed = [_in_two_columns(name, plotted, whole, room) for name, plotted in tabs.items() if plotted]
    if close_up is not None:
        tabbed.insert(1, _in_two_columns("Close-up of the events", overview, close_up, room))
    return tabbed


def _titled(plot: Plot, contents: Contents) -> _Curves:
    title = plot.title + (f" [{plot.unit}]" if plot.unit else "")
    return _Curves(plot.entity, title, plot.names, _y_range(plot, contents))


def _y_range(plot: Plot, contents: Contents) -> tuple[float, float] | None:
    """Range of the curves of a plot with limits; None for others, whose range the viewer follows."""
    extent = contents.extents.get(plot.entity)
    return extent.y_range if plot.limits and extent is not None else None


def _in_two_columns(name: str, plotted: Sequence[_Curves], time_range: TimeRange | None, room: float) -> rrb.Container:
    """Views in two columns; the last one of an odd number is as wide as both."""
    rows = (plotted[first : first + 2] for first in range(0, len(plotted), 2))
    views = ([_series(curves, time_range, room) for curves in row] for row in rows)
    return rrb.Vertical(*(rrb.Horizontal(*row) if len(row) > 1 else row[0] for row in views), name=name)


def _overview(contents: Contents) -> list[_Curves]:
    plots = contents.shown(contents.plots)

    def names(origin: str) -> list[str]:
        return [name for plot in plots if plot.entity.startswith(origin) for name in plot.names]

    overview = [
        _Curves("plots/energy", "Kinetic energy [J]", names("plots/energy")),
        _Curves("plots/linear_momentum", "Momentum P [N s]", names("plots/linear_momentum")),
        _Curves("plots/angular_momentum", "Momentum L [N m s]", names("plots/angular_momentum")),
        _Curves(FORCES, "Contact force [N]", contents.forces),
        _Curves(FRICTION_USE, "Share of friction limit used", names(FRICTION_USE)),
        _Curves(TORQUES, "Interface torque [N m]", contents.torques),
        _Curves("plots/balance", "Residuals [log10 of SI]", names("plots/balance")),
    ]
    tip = [_Curves("plots/tip_error", "Tip error [m]")] if contents.tip else []
    return tip + [curves for curves in overview if curves.names]


def _efforts(contents: Contents, parent: str) -> list[_Curves]:
    return [
        _Curves(plot.entity, f"{plot.names[-1]} [{plot.unit}]{_bounds(plot, contents)}", (), _y_range(plot, contents))
        for plot in contents.shown(contents.plots)
        if plot.entity.startswith(f"{parent}/")
    ]


def _bounds(plot: Plot, contents: Contents) -> str:
    """What the title says of bounds: where they are if none of them is in the range of the plot."""
    extent = contents.extents.get(plot.entity)
    if extent is None:
        return " and its bounds"
    if not math.isfinite(extent.limit):
        return ""
    is_shown = extent.limit <= max(map(abs, extent.y_range))
    return " and its bounds" if is_shown else f", bounds {extent.limit:.3g} or more"


def _series(curves: _Curves, time_range: TimeRange | None, room: float) -> rrb.TimeSeriesView:
    """Curves over a time range, with room for legends after it; over the whole run for a stream."""
    return rrb.TimeSeriesView(
        origin=f"/{curves.origin}",
        name=curves.title,
        plot_legend=_LEGEND if curves.names else _NO_LEGEND,
        axis_x=None if time_range is None else _time_axis(time_range, room),
        axis_y=None if curves.y_range is None else rrb.ScalarAxis(range=curves.y_range),
    )


def _time_axis(time_range: TimeRange, room: float) -> rrb.TimeAxis:
    span = max(time_range.end_s - time_range.start_s, 1e-6)
    ends = time_range.start_s - 0.02 * span, time_range.end_s + (0.04 + room) * span
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=seconds) for seconds in ends)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


_BEFORE_S, _AFTER_S = 1.0, SHOWN_S
_CLOSE_UP = 0.5
"""Greatest fraction of a run for which a time range gets plots of its own."""


class TimeRange(NamedTuple):
    """Time range of a run, s."""

    start_s: float
    end_s: float


class Opening:
    """Follows the marks and frames of a run to find the time and view at which the recording opens.

    Attributes:
        first_s: Time of the first mark, s; None before it.
        end_s: Time of the last frame, s.
    """

    def __init__(self, system: System) -> None:
        """Start without marks and frames."""
        self._system = system
        self.first_s: float | None = None
        self.end_s = self._last_s = 0.0
        self._points: list[tuple[float, ...]] = []
        self._pose: tuple[FloatArray, FloatArray] | None = None
        self._at_event = False
        self._boxes: list[FloatArray] = []

    def add_mark(self, time_s: float, point_m: tuple[float, ...]) -> None:
        """Take a mark at a time and a point; marks need not come in order of time."""
        if self.first_s is None or time_s < self.first_s:
            self.first_s, self._points, self._at_event = time_s, [], False
        if time_s == self.first_s:
            self._points.append(point_m)
        self._last_s = max(self._last_s, time_s)

    def add_frames(self, frames: Frames) -> None:
        """Take the next frames."""
        self.end_s = float(frames.times[-1])
        self._boxes.append(np.column_stack((frames.times, robot_boxes(self._system, frames.positions))))
        if self._pose is None:
            self._pose = frames.positions[0], frames.quaternions[0]
        if self.first_s is not None and not self._at_event and self.end_s >= self.first_s:
            i = int(np.searchsorted(frames.times, self.first_s))
            self._pose, self._at_event = (frames.positions[i], frames.quaternions[i]), True

    @property
    def has_frames(self) -> bool:
        """Whether there was any frame."""
        return self._pose is not None

    @property
    def loop(self) -> TimeRange | None:
        """Time range to play in a loop: around the first event; None without marks."""
        return None if self.first_s is None else self._within(self.first_s, self.first_s)

    @property
    def close_up(self) -> TimeRange | None:
        """Time range of the close-up plots: around all events, or else the first; None if both are most of the run."""
        if self.first_s is None:
            return None
        # All events if they are close together, else only the first: a close-up of most of the run would show nothing new.
        around = self._within(self.first_s, self._last_s), self._within(self.first_s, self.first_s)
        return next((part for part in around if part.end_s - part.start_s <= _CLOSE_UP * self.end_s), None)

    def _within(self, first_s: float, last_s: float) -> TimeRange:
        return TimeRange(max(0.0, first_s - _BEFORE_S), min(last_s + _AFTER_S, self.end_s))

    def followed(self, view: View) -> FloatArray | None:
        """Times in s and displacements in m of a camera that follows the robot, (n, 4); None if it stays in a view."""
        times, boxes = np.split(np.concatenate(self._boxes), [1], axis=1)
        path = camera_path(times[:, 0], boxes, self.first_s or 0.0, view)
        return None if path is None else np.hstack((times, path))

    def framing(self, more: FloatArray, view: Sequence[float] | None) -> Framing:
        """View of the marks and the moving bodies at the first event, or else at the start.

        Args:
            more: Additional points to keep in view, (n, 3), m.
            view: Direction towards the camera; None: the one that shows most.
        """
        assert self._pose is not None, "add_frames comes first"
        posed, contacts = (self._system, *self._pose), np.array(self._points).reshape(-1, 3)
        points = np.vstack((framed_points(*posed), more, contacts))
        return Framing(points, back=direction(view, posed, contacts, points, WIDE_VIEW))


_GRID = [90, 98, 112, 110]
BACKGROUND = [24, 27, 33]
FOLLOWED = "world/followed"
"""Entity of the point that the camera follows, which is not drawn."""
WIDE_VIEW, UPRIGHT_VIEW = (0.55, 0.42), (0.36, 0.42)
"""Tangents of half the horizontal and vertical field of view of the camera, minus a margin: over and beside other views."""


@dataclass(frozen=True)
class Framing:
    """Points to keep in view.

    Attributes:
        points: The points in world axes, (n, 3), m.
        follows: Entity that the camera follows; empty if it stands still.
        half_view: Tangents of half the horizontal and vertical field of view.
        back: Unit vector from the scene to the camera, (3,).
    """

    points: FloatArray
    follows: str = ""
    half_view: tuple[float, float] = WIDE_VIEW
    back: FloatArray = field(default_factory=USUAL.copy)

    @property
    def low(self) -> FloatArray:
        """Lower corner of the box around the points, (3,), m."""
        return np.asarray(self.points.min(axis=0))

    @property
    def high(self) -> FloatArray:
        """Upper corner of the box around the points, (3,), m."""
        return np.asarray(self.points.max(axis=0))

    @property
    def grid_m(self) -> float:
        """Spacing of the lines of the ground, a power of ten, m."""
        reach_m = max(float(np.linalg.norm(self.high - self.low)), 1e-3)
        return float(10.0 ** math.floor(math.log10(reach_m / 3.0)))

    @property
    def eye(self) -> rrb.EyeControls3D:
        """The camera, as near as all points permit."""
        position, centre = self._aim
        return rrb.EyeControls3D(
            position=position, look_target=centre, eye_up=[0.0, 0.0, 1.0], tracking_entity=self.follows or None
        )

    @property
    def centre(self) -> FloatArray:
        """Point at which the camera looks, (3,), m. A followed entity is seen there."""
        return self._aim[1]

    @cached_property
    def _aim(self) -> tuple[FloatArray, FloatArray]:
        """Position of the camera, and the point at which it looks."""
        eye, centre = aimed(self.points, self.back, self.half_view)
        # A least distance keeps a single small body from filling the view.
        distance = max(float(np.linalg.norm(eye - centre)), 2.0 * self.grid_m)
        return centre + distance * self.back, centre

    @property
    def ground(self) -> rrb.LineGrid3D:
        """Lines on the ground, the lowest of the points."""
        plane = rr.components.Plane3D.XY.with_distance(float(self.low[2]))
        return rrb.LineGrid3D(visible=True, spacing=self.grid_m, plane=plane, color=_GRID, stroke_width=1.0)

    @property
    def axes(self) -> rr.Arrows3D:
        """Axes of the world on the ground, each as long as the spacing of its lines, at the rear left corner of the view."""
        corner, vectors = (self.low[0], self.high[1], self.low[2]), self.grid_m * np.eye(3)
        return rr.Arrows3D(
            origins=[corner] * 3, vectors=vectors, colors=AXES, labels=["x", "y", "z"], radii=0.02 * self.grid_m
        )
