"""How near and how slow the object's site is to the robot's, and against what bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System

Vectors = list[list[float]]
"""Of the two sites, world axes: offset in m, rotation vector in rad, velocity in m/s, angular velocity in rad/s, (4, 3)."""


class Nearness(NamedTuple):
    """The object's site against the robot's at one state.

    Attributes:
        position_m: Distance of the sites.
        angle_rad: Angle between their frames.
        speed_m_s: Relative speed of their bodies at the object's site.
        rate_rad_s: Relative angular speed.
    """

    position_m: float
    angle_rad: float
    speed_m_s: float
    rate_rad_s: float

    @classmethod
    def of(cls, vectors: Vectors) -> Nearness:
        """The norms of these."""
        return cls(*(math.hypot(*vector) for vector in vectors))

    def ratio(self, bounds: Sequence[float | None]) -> float:
        """The largest value over its bound; all hold where it is at most 1."""
        return max(value / bound for value, bound in zip(self, bounds, strict=True) if bound is not None)


class Sites:
    """The two sites of a grasp in the system that is logged.

    Attributes:
        link: Id of the robot's body.
        root: Id of the object's base.
        robot: Id of the robot's site.
        object: Id of the object's site.
    """

    def __init__(self, system: System, grasp: Grasp) -> None:
        """Find them."""
        self._model = system.mj
        self.robot, self.object = system.index("site", grasp.robot_site), system.index("site", grasp.object_site)
        self.link, self.root = system.index("body", grasp.link), system.index("body", grasp.root)
        self._one, self._other = np.empty(6), np.empty(6)

    def point(self, data: Any) -> FloatArray:
        """Where the object's site is, world axes, m, (3,)."""
        return np.array(data.site_xpos[self.object])

    def vectors(self, data: Any) -> Vectors:
        """How the object's site is to the robot's at the state in ``data``, positions and velocities current."""
        here, there = data.site_xmat[self.robot].reshape(3, 3), data.site_xmat[self.object].reshape(3, 3)
        place, held = data.site_xpos[self.object], data.xpos[self.link]
        for twist, body in ((self._one, self.link), (self._other, self.root)):
            mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
        one, other = self._one, self._other  # angular, then linear
        velocity = other[3:] + cross(other[:3], place - data.xpos[self.root])
        velocity -= one[3:] + cross(one[:3], place - held)
        offset: list[float] = (place - data.site_xpos[self.robot]).tolist()
        return [offset, _rotation(there @ here.T), velocity.tolist(), (other[:3] - one[:3]).tolist()]


def _rotation(turn: FloatArray) -> list[float]:
    """Rotation vector of a rotation matrix, rad; its length is exact to rounding near zero too."""
    (_, d, g), (b, _, h), (c, f, _) = turn.T.tolist()
    x, y, z = h - f, c - g, d - b
    sine = math.hypot(x, y, z)
    angle = math.atan2(sine, float(np.trace(turn)) - 1.0)
    return [x * angle / sine, y * angle / sine, z * angle / sine] if sine else [angle, 0.0, 0.0]
