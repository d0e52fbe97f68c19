"""Camera of a scene: it frames points, and may follow the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.palette import AXES

_GRID = [90, 98, 112, 110]
BACKGROUND = [24, 27, 33]
FOLLOWED = "world/followed"
"""Entity of the point that the camera follows, which is not drawn."""
_WIDE_VIEW, UPRIGHT_VIEW = (0.55, 0.42), (0.36, 0.42)
"""Tangents of half the horizontal and vertical field of view of the camera, minus a margin: over and beside other views."""


@dataclass(frozen=True)
class Framing:
    """Points to keep in view.

    Attributes:
        points: The points in world axes, (n, 3), m.
        follows: Entity that the camera follows; empty if it stands still.
        half_view: Tangents of half the horizontal and vertical field of view.
    """

    points: FloatArray
    follows: str = ""
    half_view: tuple[float, float] = _WIDE_VIEW

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
        """Camera above and a little behind, so that a planar robot fills the view; as near as all points permit."""
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
        back = np.array([-0.1, -0.56, 0.82]) / np.linalg.norm([-0.1, -0.56, 0.82])
        right = np.cross([0.0, 0.0, 1.0], back) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], back))
        view = np.stack((right, np.cross(back, right), back))
        centre = 0.5 * (self.low + self.high)
        distance = 0.0
        for _ in range(4):  # perspective: the middle of the picture is not the projection of the middle of the box
            viewed = (self.points - centre) @ view.T
            distance = float(np.max(np.abs(viewed[:, :2]) / self.half_view + viewed[:, 2:]))
            flat = viewed[:, :2] / np.maximum(distance - viewed[:, 2:], 1e-9)
            middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0)) * distance
            centre = centre + middle @ view[:2]
        # A least distance keeps a single small body from filling the view.
        return centre + max(distance, 2.0 * self.grid_m) * back, centre

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
