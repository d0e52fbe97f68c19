"""The body that a feature is fixed to: its pose and motion in plain numbers, faster than arrays of three."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

Vector = tuple[float, float, float]


def dot(a: Vector, b: Vector) -> float:
    """Of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Of two vectors."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def minus(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def shifted(a: Vector, length: float, direction: Vector) -> Vector:
    """The point at a length along a direction from a point."""
    return a[0] + length * direction[0], a[1] + length * direction[1], a[2] + length * direction[2]


def scaled(factor: float, a: Vector) -> Vector:
    """A vector times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


def unit(a: Vector) -> Vector:
    """Of length one."""
    return scaled(1.0 / math.hypot(*a), a)


class BodyMotion(NamedTuple):
    """A body at one state, in world axes.

    Attributes:
        origin: Position of its frame, in m.
        axes: Its rotation matrix, row by row.
        omega: Angular velocity in rad/s.
        velocity: Of its origin, in m/s.
    """

    origin: Vector
    axes: list[float]
    omega: Vector
    velocity: Vector

    def turned(self, local: Vector) -> Vector:
        """A vector of the body in world axes."""
        x, y, z = local
        a, b, c, d, e, f, g, h, i = self.axes
        return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z

    def local(self, vector: Vector) -> Vector:
        """A vector of the world in the body's axes."""
        x, y, z = vector
        a, b, c, d, e, f, g, h, i = self.axes
        return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z

    def velocity_at(self, arm: Vector) -> Vector:
        """Velocity of the material point at an arm from the origin, both in world axes."""
        (p, q, r), (x, y, z), (u, v, w) = self.omega, arm, self.velocity
        return u + q * z - r * y, v + r * x - p * z, w + p * y - q * x


class Body:
    """A body of a model by its id; one that does not move will do."""

    def __init__(self, model: Any, body: int) -> None:
        """Bind to a body."""
        self._body, self._root = body, int(model.body_rootid[body])
        self._data: Any = None

    def motion(self, data: Any) -> BodyMotion:
        """Its pose and motion in ``data``; cvel is (angular, linear) about the centre of mass of its tree."""
        if data is not self._data:
            self._look_at(data)
        x, y, z = self._xpos.tolist()
        p, q, r, u, v, w = self._cvel.tolist()
        cx, cy, cz = self._centre.tolist()
        i, j, k = x - cx, y - cy, z - cz
        velocity = (u + q * k - r * j, v + r * i - p * k, w + p * j - q * i)
        return BodyMotion((x, y, z), self._xmat.tolist(), (p, q, r), velocity)

    def _look_at(self, data: Any) -> None:
        """Find the body in ``data``: MuJoCo's arrays stay where they are."""
        self._data, body = data, self._body
        self._xpos, self._xmat, self._cvel = data.xpos[body], data.xmat[body], data.cvel[body]
        self._centre = data.subtree_com[self._root]
