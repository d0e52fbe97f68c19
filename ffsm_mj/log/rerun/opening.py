"""Where a recording opens: at the first event that is drawn, and what is in view there."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import Frames, geoms_to_draw
from ffsm_mj.log.marks import SHOWN_S
from ffsm_mj.model.system import System

_BEFORE_S, _AFTER_S = 1.0, SHOWN_S
_CLOSE_UP = 0.5
"""Share of a run beyond which a part of it is not worth plots of its own."""
_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


class Stretch(NamedTuple):
    """Part of a run, s."""

    start_s: float
    end_s: float


class Opening:
    """Follows a run: when something is drawn first and last, and where everything is then.

    Attributes:
        first_s: When something is drawn first, s; None until then.
        end_s: The last time seen, s.
    """

    def __init__(self, system: System) -> None:
        """Nothing is seen yet."""
        self._system = system
        self.first_s: float | None = None
        self.end_s = self._last_s = 0.0
        self._points: list[tuple[float, ...]] = []
        self._pose: tuple[FloatArray, FloatArray] | None = None
        self._at_event = False

    def draw(self, time_s: float, point_m: tuple[float, ...]) -> None:
        """Something is drawn at a time and a point; earlier than what was before or not."""
        if self.first_s is None or time_s < self.first_s:
            self.first_s, self._points, self._at_event = time_s, [], False
        if time_s == self.first_s:
            self._points.append(point_m)
        self._last_s = max(self._last_s, time_s)

    def see(self, frames: Frames) -> None:
        """The next frames."""
        self.end_s = float(frames.times[-1])
        if self._pose is None:
            self._pose = frames.positions[0], frames.quaternions[0]
        if self.first_s is not None and not self._at_event and self.end_s >= self.first_s:
            i = int(np.searchsorted(frames.times, self.first_s))
            self._pose, self._at_event = (frames.positions[i], frames.quaternions[i]), True

    @property
    def seen(self) -> bool:
        """Whether any frame has been."""
        return self._pose is not None

    @property
    def loop(self) -> Stretch | None:
        """Around the first event; None without one."""
        return None if self.first_s is None else self._within(self.first_s, self.first_s)

    @property
    def close_up(self) -> Stretch | None:
        """What is worth plots of its own: around all events, or around the first; None where both are most of the run."""
        if self.first_s is None:
            return None
        around = self._within(self.first_s, self._last_s), self._within(self.first_s, self.first_s)
        return next((part for part in around if part.end_s - part.start_s <= _CLOSE_UP * self.end_s), None)

    def _within(self, first_s: float, last_s: float) -> Stretch:
        return Stretch(max(0.0, first_s - _BEFORE_S), min(last_s + _AFTER_S, self.end_s))

    def points(self, more: FloatArray) -> FloatArray:
        """What is to be in view at the first event, or else at the start: corners of what is drawn, world axes, (n, 3), m.

        Bodies that are fixed may be large, and stay out.

        Args:
            more: Other points that are to be in view, (n, 3), m.
        """
        assert self._pose is not None, "asked once frames are seen"
        drawn = np.array(self._points).reshape(-1, 3)
        return np.vstack((_corners(self._system, *self._pose), more, drawn))


def _corners(system: System, positions: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Corners of the boxes around the drawn geoms of bodies that move, (n, 3), m; the bodies' origins without any."""
    model, still = system.mj, {0, *system.fixed_bodies}
    geoms = [geom for geom in geoms_to_draw(model) if int(model.geom_bodyid[geom]) not in still]
    rotation, corners = np.empty(9), []
    for geom in geoms:
        body, around = int(model.geom_bodyid[geom]), model.geom_aabb[geom]
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        local = (around[:3] + _SIGNS * around[3:]) @ rotation.reshape(3, 3).T + model.geom_pos[geom]
        mujoco.mju_quat2Mat(rotation, quaternions[body])
        corners.append(local @ rotation.reshape(3, 3).T + positions[body])
    return np.vstack(corners) if corners else np.asarray(positions[1:])
