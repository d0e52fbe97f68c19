"""Relative pose and velocity of the two sites of a grasp, as compared with its bounds."""

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
from ffsm_mj.tolerances import CANCELLED

Vectors = list[list[float]]
"""Relative vectors: offset in m, rotation vector in rad, velocity in m/s and rad/s, world axes, (4, 3)."""


class Nearness(NamedTuple):
    """Relative pose and velocity of the object's site and the robot's at one state, as norms.

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
        """Norms of the relative vectors."""
        return cls(*(math.hypot(*vector) for vector in vectors))

    def ratio(self, bounds: Sequence[float | None]) -> float:
        """Largest ratio of a value to its bound; all bounds hold if it is at most 1."""
        return max(value / bound for value, bound in zip(self, bounds, strict=True) if bound is not None)


class Sites:
    """The two sites of a grasp in the logged system.

    Attributes:
        link: Id of the grasping link.
        root: Id of the object's base.
        robot: Id of the robot's site.
        object: Id of the object's site.
    """

    def __init__(self, system: System, grasp: Grasp) -> None:
        """Look up the sites and their bodies."""
        self._model = system.mj
        self.robot, self.object = system.index("site", grasp.robot_site), system.index("site", grasp.object_site)
        self.link, self.root = system.index("body", grasp.link), system.index("body", grasp.root)
        self._one, self._other = np.empty(6), np.empty(6)

    def point(self, data: Any) -> FloatArray:
        """Position of the object's site, world axes, m, (3,)."""
        return np.array(data.site_xpos[self.object])

    def vectors(self, data: Any) -> Vectors:
        """Relative vectors of the sites at the state in ``data``; positions and velocities must be current."""
        here, there = data.site_xmat[self.robot].reshape(3, 3), data.site_xmat[self.object].reshape(3, 3)
        place, held = data.site_xpos[self.object], data.xpos[self.link]
        for twist, body in ((self._one, self.link), (self._other, self.root)):
            mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
        one, other = self._one, self._other  # angular, then linear
        velocity = other[3:] + cross(other[:3], place - data.xpos[self.root])
        velocity -= one[3:] + cross(one[:3], place - held)
        offset: list[float] = (place - data.site_xpos[self.robot]).tolist()
        return [offset, _rotation(there @ here.T), velocity.tolist(), (other[:3] - one[:3]).tolist()]

    def rounding(self, data: Any) -> Nearness:
        """How far the norms of the vectors of the last evaluation may differ where they are equal in exact arithmetic.

        Distances and velocities are differences, which are known as well as what cancels in them.
        """
        places = (*data.site_xpos[self.robot].tolist(), *data.site_xpos[self.object].tolist())
        turning, moving = ((*self._one[part].tolist(), *self._other[part].tolist()) for part in (slice(3), slice(3, None)))
        return Nearness(*(CANCELLED * (1.0 + max(map(abs, terms))) for terms in (places, (0.0,), moving, turning)))


def _rotation(turn: FloatArray) -> list[float]:
    """Rotation vector of a rotation matrix, rad; atan2 keeps its length accurate near zero, where acos is not."""
    (_, d, g), (b, _, h), (c, f, _) = turn.T.tolist()
    x, y, z = h - f, c - g, d - b
    sine = math.hypot(x, y, z)
    angle = math.atan2(sine, float(np.trace(turn)) - 1.0)
    return [x * angle / sine, y * angle / sine, z * angle / sine] if sine else [angle, 0.0, 0.0]
