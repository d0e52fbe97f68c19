"""The target of the tip in a recording, and a plot of the tip's distance to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.palette import ORANGE
from ffsm_mj.log.rerun.scene import target_cross
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.metadata import LoggedTask


class Target:
    """Draws the target of a task; one that moves is followed."""

    def __init__(self, recording: rr.RecordingStream, header: RunHeader, task: LoggedTask, scale: float) -> None:
        """Draw it at a scale of markers."""
        self._task, self._layout, self._moving = task, header.layout, task.moving_columns(header.layout)
        line = rr.SeriesLines(names=["tip error"], colors=[ORANGE], widths=[1.5])
        recording.log("plots/tip_error", line, static=True)
        place = np.zeros(3) if self._moving else task.point_m
        recording.log("world/task/target", target_cross(place, "target", scale), static=True)

    @property
    def points(self) -> FloatArray:
        """Points to keep in view: where it stands or begins, (1, 3), m."""
        return self._task.point_m[None]

    def send(self, frames: Frames, send: Callable[[str, Any], None]) -> None:
        """Send where it is in some frames, and the distance of the tip."""
        rows, index = frames.rows, self._layout.index
        if self._moving:
            send("world/task/target", rr.Transform3D.columns(translation=rows[:, self._moving]))
        error = np.linalg.norm(self._task.errors_m(self._layout, lambda key: rows[:, index[key]]), axis=1)
        send("plots/tip_error", rr.Scalars.columns(scalars=error))
