"""How a recording opens: the scene large, beside it the plots that tell the story, below the states and events."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import rerun.blueprint as rrb

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.rerun.plots import BASE, FORCES, JOINTS, Plot

TIMELINE = "sim_time"
_LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
_QUIET = rrb.PlotLegend(visible=False)


def blueprint(
    low: FloatArray,
    high: FloatArray,
    plots: Sequence[Plot],
    trails: Iterable[str],
    *,
    tip: bool,
    forces: bool,
    following: bool,
) -> rrb.Blueprint:
    """Layout of a recording.

    Args:
        low: Lower corner of what moves at the start, world axes, m.
        high: Upper corner of the same.
        plots: What is plotted.
        trails: Names of the trails.
        tip: Whether there is a tip error to plot.
        forces: Whether there are forces of contacts to plot.
        following: Open at the latest time and follow it, instead of playing from the start.
    """
    scene = rrb.Spatial3DView(
        origin="/world",
        name="Scene",
        line_grid=rrb.LineGrid3D(visible=False),
        background=[24, 27, 33],
        eye_controls=_eye(low, high),
        overrides={
            f"world/trails/{name}": [
                rrb.VisibleTimeRanges(
                    timeline=TIMELINE,
                    start=rrb.TimeRangeBoundary.infinite(),
                    end=rrb.TimeRangeBoundary.cursor_relative(),
                )
            ]
            for name in trails
        },
    )
    below = rrb.Horizontal(
        rrb.StateTimelineView(origin="/states", name="Phase and thrusters"),
        rrb.TextLogView(origin="/events", name="Events", columns=_event_columns()),
        column_shares=[1, 1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, below, row_shares=[7, 2]),
            rrb.Tabs(*_tabs(plots, tip=tip, forces=forces)),
            column_shares=[11, 9],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following" if following else "playing"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _eye(low: FloatArray, high: FloatArray) -> rrb.EyeControls3D:
    """From above and a little behind, so that the plane of a planar robot fills the view."""
    centre = 0.5 * (low + high)
    reach = float(np.linalg.norm(high - low))
    position = centre + reach * np.array([-0.1, -0.42, 0.62])
    return rrb.EyeControls3D(position=position, look_target=centre, eye_up=[0.0, 0.0, 1.0])


def _event_columns() -> rrb.TextLogColumns:
    """When and what: the entity is always the same."""
    return rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["body"])


def _tabs(plots: Sequence[Plot], *, tip: bool, forces: bool) -> list[rrb.Container | rrb.View]:
    entities = {plot.entity for plot in plots}
    story: list[rrb.View] = []
    if tip:
        story.append(_series("plots/tip_error", "Tip error [m]", _QUIET))
    story.append(_series("plots/energy", "Kinetic energy [J]", _LEGEND))
    for kind, title in (("linear", "Linear momentum [N s]"), ("angular", "Angular momentum [N m s]")):
        if any(entity.startswith(f"plots/{kind}_momentum") for entity in entities):
            story.append(_series(f"plots/{kind}_momentum", title, _LEGEND))
    if forces:
        story.append(_series(FORCES, "Contact force [N]", _LEGEND))
    joints, base = _effort_views(plots, JOINTS), _effort_views(plots, BASE)
    if len(joints) <= 4:  # as many as stay readable beside the rest
        story += joints
    story.append(_series("plots/ledger", "Ledger residuals [SI]", _LEGEND))
    tabs: list[rrb.Container | rrb.View] = [rrb.Grid(*story, grid_columns=2, name="Story")]
    if len(joints) > 4:
        tabs.append(rrb.Grid(*joints, grid_columns=2, name="Joints"))
    if base:
        tabs.append(rrb.Grid(*base, grid_columns=2, name="Thrusters and base"))
    return tabs


def _effort_views(plots: Sequence[Plot], parent: str) -> list[rrb.View]:
    return [
        _series(plot.entity, f"{plot.names[-1]} and its bounds [{plot.unit}]", _QUIET)
        for plot in plots
        if plot.entity.startswith(f"{parent}/")
    ]


def _series(origin: str, name: str, legend: rrb.PlotLegend) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=f"/{origin}", name=name, plot_legend=legend)
