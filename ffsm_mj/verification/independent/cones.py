"""Distances inside cones, by MuJoCo's distances from tangent planes: a cone is what is on the inner side of all of them.

In a copy of the model a large box takes the place of the geom that stands for a cone, with one face in a tangent plane. The
distance of a convex geom from the cone is the least one from such a box over all generators.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.scene import LoggedScene

_WIDE = 20.0
"""Half the width of the box in lengths of the cone: its other faces and edges are never the nearest."""
_LEAST_TURN = 1e-7
"""Angle in rad to which the generator of the least distance is found: the distance is then exact to its square."""
_AT_RIM = 1e-6
"""A point within this share of the length from the mouth or the throat may be on the rim there, which has other normals."""


class TangentPlanes:
    """Tangent planes of the cone that a geom of a log stands for."""

    def __init__(self, scene: LoggedScene, geom: int) -> None:
        """Take the numbers of the cone from the scenario of the log, and put a box in its place."""
        self._cone, self._geom = scene.system.cones[geom], geom
        self._body = int(scene.model.geom_bodyid[geom])
        self._half = _WIDE * (self._cone.length_m + self._cone.mouth_radius_m)
        self.model: Any = copy.copy(scene.model)
        self.model.geom_type[geom] = mujoco.mjtGeom.mjGEOM_BOX
        self.model.geom_dataid[geom], self.model.geom_size[geom] = -1, self._half
        self.model.geom_rbound[geom] = 2.0 * self._half

    def _frame(self, data: Any) -> tuple[Array, Array, Array]:
        """Apex, and axes of the cone in the world: two across it and the one to the mouth, (3, 3)."""
        axes, axis = data.xmat[self._body].reshape(3, 3), np.array(self._cone.axis) / np.linalg.norm(self._cone.axis)
        across = np.linalg.svd(axis[None])[2][1:]
        return data.xpos[self._body] + axes @ self._cone.apex_m, (axes @ across.T).T, axes @ axis

    def angle_of(self, data: Any, point: Array) -> float:
        """Angle round the axis of a point in the world, rad."""
        apex, (x, y), _ = self._frame(data)
        return math.atan2(y @ (point - apex), x @ (point - apex))

    def angle_of_normal(self, data: Any, inward: Array) -> float:
        """Angle round the axis of the generator with a normal to the inside, world axes, rad."""
        _, (x, y), _ = self._frame(data)
        return math.atan2(-y @ inward, -x @ inward)

    def is_at_rim(self, data: Any, point: Array) -> bool:
        """Whether a point in the world may be on the rim of the mouth or of the throat."""
        apex, _, axis = self._frame(data)
        height, near = float(axis @ (point - apex)), _AT_RIM * self._cone.length_m
        return height >= self._cone.length_m - near or height <= self._cone.from_m + near

    def normal(self, data: Any, angle: float) -> Array:
        """Normal of the tangent plane at an angle, to the inside, world axes, (3,)."""
        _, (x, y), axis = self._frame(data)
        half_angle = math.radians(self._cone.half_angle_deg)
        return np.asarray(math.sin(half_angle) * axis - math.cos(half_angle) * (math.cos(angle) * x + math.sin(angle) * y))

    def distance(self, data: Any, other: int, angle: float, apart_m: float, nearest: Array | None = None) -> float:
        """Distance of a geom from the tangent plane at an angle, moved away from the inside, m; moves the box only."""
        apex, (x, y), axis = self._frame(data)
        normal = self.normal(data, angle)
        along = np.cross(math.cos(angle) * y - math.sin(angle) * x, normal)
        data.geom_xmat[self._geom] = np.column_stack((along, np.cross(normal, along), normal)).ravel()
        # The middle of the face is on the axis of the cone, as far from the apex as its mouth is.
        middle = apex + self._cone.length_m * axis
        middle -= ((middle - apex) @ normal) * normal
        data.geom_xpos[self._geom] = middle - (self._half + apart_m) * normal
        return float(mujoco.mj_geomDistance(self.model, data, self._geom, other, self._half, nearest))

    def least_distance(self, data: Any, other: int, angle: float, apart_m: float) -> float:
        """Least distance from the tangent planes near an angle, moved away from the inside, m."""
        from scipy.optimize import minimize_scalar  # takes a second to import: only contacts inside cones pay

        least = minimize_scalar(
            lambda turn: self.distance(data, other, angle + turn, apart_m),
            bounds=(-0.3, 0.3),
            method="bounded",
            options={"xatol": _LEAST_TURN},
        )
        return float(least.fun)
