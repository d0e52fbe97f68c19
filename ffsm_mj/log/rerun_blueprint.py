"""How a recording opens: the scene large, beside it the plots that tell the story, below phases and events."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from ffsm_mj.model import FloatArray

TIMELINE = "sim_time"


def blueprint(low: FloatArray, high: FloatArray, *, tip: bool) -> rrb.Blueprint:
    """Layout of a recording.

    Args:
        low: Lower corner of what moves at the start, world axes, m.
        high: Upper corner of the same.
        tip: Whether there is a tip error to plot.
    """
    centre = 0.5 * (low + high)
    reach = float(np.linalg.norm(high - low))
    scene = rrb.Spatial3DView(
        origin="/world",
        name="Scene",
        line_grid=rrb.LineGrid3D(visible=False),
        background=[24, 27, 33],
        eye_controls=rrb.EyeControls3D(
            position=centre + reach * np.array([-0.15, -0.75, 0.95]), look_target=centre, eye_up=[0.0, 0.0, 1.0]
        ),
        overrides={
            "world/trails": [
                rrb.VisibleTimeRanges(
                    timeline=TIMELINE,
                    start=rrb.TimeRangeBoundary.infinite(),
                    end=rrb.TimeRangeBoundary.cursor_relative(),
                )
            ]
        },
    )
    plots = [
        *([rrb.TimeSeriesView(origin="/plots/tip_error", name="Tip error [m]")] if tip else []),
        rrb.TimeSeriesView(origin="/plots/efforts", name="Efforts and their bounds [N, N m]"),
        rrb.TimeSeriesView(origin="/plots/energy", name="Kinetic energy [J]"),
        rrb.TimeSeriesView(origin="/plots/linear_momentum", name="Linear momentum [N s]"),
        rrb.TimeSeriesView(origin="/plots/angular_momentum", name="Angular momentum about the origin [N m s]"),
        rrb.TimeSeriesView(origin="/plots/ledger", name="What the ledgers leave unexplained [SI]"),
    ]
    below = rrb.Horizontal(
        rrb.StateTimelineView(origin="/phase", name="Phase"),
        rrb.TextLogView(origin="/events", name="Events"),
        column_shares=[2, 3],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, below, row_shares=[4, 1]),
            rrb.Grid(*plots, grid_columns=2),
            column_shares=[1, 1],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
