"""Pose and motion of a body in plain floats, which are faster than arrays of three, and vector arithmetic on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

Vector = tuple[float, float, float]


def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def minus(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def shifted(a: Vector, length: float, direction: Vector) -> Vector:
    """Sum a + length * direction."""
    return a[0] + length * direction[0], a[1] + length * direction[1], a[2] + length * direction[2]


def scaled(factor: float, a: Vector) -> Vector:
    """Product factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


def unit(a: Vector) -> Vector:
    """The unit vector along a vector."""
    return scaled(1.0 / math.hypot(*a), a)


def turned(axes: Sequence[float], local: Vector) -> Vector:
    """Transform a vector from body axes to world axes, with the rotation matrix row by row."""
    x, y, z = local
    a, b, c, d, e, f, g, h, i = axes
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def turned_back(axes: Sequence[float], vector: Vector) -> Vector:
    """Transform a vector from world axes to body axes."""
    x, y, z = vector
    a, b, c, d, e, f, g, h, i = axes
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


class BodyMotion(NamedTuple):
    """A body at one state, in world axes.

    Attributes:
        origin: Position of its frame, in m.
        axes: Rotation matrix, row by row.
        omega: Angular velocity in rad/s.
        velocity: Velocity of its origin, in m/s.
    """

    origin: Vector
    axes: list[float]
    omega: Vector
    velocity: Vector

    def turned(self, local: Vector) -> Vector:
        """Transform a vector from body axes to world axes."""
        return turned(self.axes, local)

    def local(self, vector: Vector) -> Vector:
        """Transform a vector from world axes to body axes."""
        return turned_back(self.axes, vector)

    def place(self, local: Vector) -> Vector:
        """Position in the world of a point in body axes, relative to the origin."""
        return shifted(self.origin, 1.0, self.turned(local))

    def velocity_at(self, arm: Vector) -> Vector:
        """Velocity of the material point at a position relative to the origin (arm), world axes, m/s."""
        (p, q, r), (x, y, z), (u, v, w) = self.omega, arm, self.velocity
        return u + q * z - r * y, v + r * x - p * z, w + p * y - q * x


class Body:
    """Reads the motion of one body; the body may be fixed.

    Attributes:
        id: Id of the body.
    """

    def __init__(self, model: Any, body: int) -> None:
        """Look up a body by id."""
        self.id, self._root = body, int(model.body_rootid[body])
        self._data: Any = None

    def motion(self, data: Any) -> BodyMotion:
        """Pose and motion of the body in ``data``."""
        if data is not self._data:
            self._bind(data)
        x, y, z = self._xpos.tolist()
        # cvel is (angular, linear) about the centre of mass of the kinematic tree.
        p, q, r, u, v, w = self._cvel.tolist()
        cx, cy, cz = self._centre.tolist()
        i, j, k = x - cx, y - cy, z - cz
        velocity = (u + q * k - r * j, v + r * i - p * k, w + p * j - q * i)
        return BodyMotion((x, y, z), self._xmat.tolist(), (p, q, r), velocity)

    def _bind(self, data: Any) -> None:
        """Take views of the arrays of ``data``, which MuJoCo does not move."""
        self._data, body = data, self.id
        self._xpos, self._xmat, self._cvel = data.xpos[body], data.xmat[body], data.cvel[body]
        self._centre = data.subtree_com[self._root]
