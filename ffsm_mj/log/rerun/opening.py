"""Time and view at which a recording opens: the first event with a mark, and everything that is in view then."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.bounding_box import box_corners
from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.drawn_geoms import geoms_to_draw
from ffsm_mj.log.following import View, camera_path, robot_boxes
from ffsm_mj.log.marks import SHOWN_S
from ffsm_mj.model.system import System

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

    def points(self, more: FloatArray) -> FloatArray:
        """Points to keep in view at the first event, or else at the start, in world axes, (n, 3), m.

        These are the marks and the corners of the moving bodies; fixed bodies may be large and are left out.

        Args:
            more: Additional points, (n, 3), m.
        """
        assert self._pose is not None, "add_frames comes first"
        drawn = np.array(self._points).reshape(-1, 3)
        return np.vstack((_corners(self._system, *self._pose), more, drawn))


def _corners(system: System, positions: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Corners of the bounding boxes of the drawn geoms of moving bodies, (n, 3), m; else the origins of all bodies."""
    model, still = system.mj, {0, *system.fixed_bodies}
    geoms = [geom for geom in geoms_to_draw(model) if int(model.geom_bodyid[geom]) not in still]
    return box_corners(model, geoms, positions, quaternions) if geoms else np.asarray(positions[1:])
