"""Layout of a recording: a large scene at the first event, and beside it tabs of plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import rerun as rr
import rerun.blueprint as rrb

from ffsm_mj.log.rerun.camera import BACKGROUND, Framing
from ffsm_mj.log.rerun.opening import Opening, TimeRange
from ffsm_mj.log.rerun.plots import BASE, FORCES, FRICTION_USE, JOINTS, TORQUES, Plot

TIMELINE = "sim_time"
_LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
_NO_LEGEND = rrb.PlotLegend(visible=False)
_LETTER_PX, _BESIDE_PX, _PLOT_PX = 6.4, 34.0, 290.0
"""Widths of a letter of a legend, of its remaining parts, and of a plot in a window of 1300 pixels."""
_MOST_LANES = 5


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Contents of a recording, as far as its layout depends on them.

    Attributes:
        framing: Points to keep in view.
        plots: Plots of columns.
        sensing: Plots of measurements and estimates by the name of their tab.
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

    @property
    def lanes(self) -> str:
        """Title of the lanes of states."""
        shown = ["Phase", *(["contacts"] if self.contacts else []), *(["thrusters"] if self.thrusters else [])]
        return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


class _Curves(NamedTuple):
    """Contents of one view: its entity, its title (with the unit early, as long titles are cut), and names in its legend."""

    origin: str
    title: str
    names: Sequence[str] = ()

    def room(self, views: int) -> float:
        """Width of the legend relative to that of the curves, if ``views`` plots are in one row."""
        if not self.names:
            return 0.0
        legend, plot = _BESIDE_PX + _LETTER_PX * max(map(len, self.names)), _PLOT_PX * (1.0 if views > 1 else 1.6)
        return legend / max(plot - legend, 0.25 * plot)


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
        rrb.StateTimelineView(origin="/states", name=contents.lanes),
        rrb.TextLogView(origin="/events", name="Events", columns=_event_columns()),
        row_shares=[22.0 - lanes, lanes, 6.0],
    )
    playing: dict[str, Any] = {"play_state": "following" if opening is None else "playing"}
    if loop is not None:
        playing |= {"loop_mode": "selection", "time_selection": _selection(loop)}
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Tabs(*_tabs(contents, opening), active_tab=0)),
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
    """Columns of time and text; the entity is always the same."""
    return rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["body"])


def _tabs(contents: Contents, opening: Opening | None) -> list[rrb.Container]:
    whole = TimeRange(0.0, opening.end_s) if opening is not None else None
    close_up = opening.close_up if opening is not None else None
    tabs = [_in_two_columns("Overview", _overview(contents), whole)]
    if close_up is not None:
        tabs.append(_in_two_columns("Close-up of the events", _overview(contents), close_up))
    for name, parent in (("Joints", JOINTS), ("Thrusters and base", BASE)):
        if efforts := _efforts(contents.plots, parent):
            tabs.append(_in_two_columns(name, efforts, whole))
    for name, plotted in contents.sensing.items():
        tabs.append(_in_two_columns(name, [_titled(plot) for plot in plotted], whole))
    return tabs


def _titled(plot: Plot) -> _Curves:
    return _Curves(plot.entity, plot.title + (f" [{plot.unit}]" if plot.unit else ""), plot.names)


def _in_two_columns(name: str, plotted: Sequence[_Curves], time_range: TimeRange | None) -> rrb.Container:
    """Views in two columns; the last one of an odd number is as wide as both."""
    rows = (plotted[first : first + 2] for first in range(0, len(plotted), 2))
    views = ([_series(curves, time_range, len(row)) for curves in row] for row in rows)
    return rrb.Vertical(*(rrb.Horizontal(*row) if len(row) > 1 else row[0] for row in views), name=name)


def _overview(contents: Contents) -> list[_Curves]:
    def names(origin: str) -> list[str]:
        return [name for plot in contents.plots if plot.entity.startswith(origin) for name in plot.names]

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


def _efforts(plots: Sequence[Plot], parent: str) -> list[_Curves]:
    return [
        _Curves(plot.entity, f"{plot.names[-1]} [{plot.unit}] and its bounds")
        for plot in plots
        if plot.entity.startswith(f"{parent}/")
    ]


def _series(curves: _Curves, time_range: TimeRange | None, views: int) -> rrb.TimeSeriesView:
    """Curves over a time range, with room for the legend after it; over the whole run for a stream."""
    return rrb.TimeSeriesView(
        origin=f"/{curves.origin}",
        name=curves.title,
        plot_legend=_LEGEND if curves.names else _NO_LEGEND,
        axis_x=None if time_range is None else _time_axis(time_range, curves.room(views)),
    )


def _time_axis(time_range: TimeRange, room: float) -> rrb.TimeAxis:
    span = max(time_range.end_s - time_range.start_s, 1e-6)
    ends = time_range.start_s - 0.02 * span, time_range.end_s + (0.04 + room) * span
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=seconds) for seconds in ends)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))
