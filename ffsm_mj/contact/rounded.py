"""Gap functions of what is curved: a rim or an ellipsoid over a plane, an ellipsoid against a point or a line; frozen.

With the radii of curvature K at the extreme point along n, that point slides over its surface at K (n' - omega x n).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.carrier import Motion, Vector, cross, dot, minus, scaled, shifted
from ffsm_mj.contact.cores import Circle, Ellipsoid, Face, Line, Point
from ffsm_mj.contact.held import Held, Pairing

_TURNS = 100


class RoundOnFace(Pairing):
    """The extreme point of a rim or an ellipsoid over a plane."""

    def __init__(self, name: str, swapped: bool, face: Face, extreme: Circle | Ellipsoid) -> None:
        """Freeze them."""
        super().__init__(name, swapped, face.radius, extreme.radius)
        self._face, self._round = face, extreme

    def at(self, data: Any) -> Held:
        """With t = (omega_plane - omega_round) x n, the gap's second rate has 2 (omega_plane x n) . w - t . K t."""
        face, core = self._face, self._round
        first, second = face.carrier.motion(data), core.carrier.motion(data)
        normal = first.turned(face.normal)
        against = scaled(-1.0, normal)
        arm = core.extreme(second, against)
        point = shifted(second.origin, 1.0, arm)
        first_arm = minus(point, first.origin)
        local = first.local(first_arm)
        w = minus(second.velocity_at(arm), first.velocity_at(first_arm))
        rolling = cross(minus(first.omega, second.omega), normal)
        terms = (2.0 * dot(cross(first.omega, normal), w), -dot(rolling, core.bent(second, against, rolling)))
        gap = dot(face.normal, minus(local, face.centre))
        return self._held(gap, dot(normal, w), normal, (point, point), terms, face.inside(local))


class OnEllipsoid(Pairing):
    """A point or a line against an ellipsoid: the nearest point by Newton's method in one unknown."""

    def __init__(self, name: str, swapped: bool, ellipsoid: Ellipsoid, other: Point | Line) -> None:
        """Freeze them."""
        super().__init__(name, swapped, ellipsoid.radius, other.radius)
        self._ellipsoid, self._other = ellipsoid, other

    def at(self, data: Any) -> Held:
        """The normal turns so that n . d = 0 along a line, and across it so that the contact points stay opposite."""
        core, other = self._ellipsoid, self._other
        first, second = core.carrier.motion(data), other.carrier.motion(data)
        arm = second.turned(other.centre)
        anchor = shifted(second.origin, 1.0, arm)
        direction = second.turned(other.direction) if isinstance(other, Line) else None
        normal = self._normal(first, anchor, direction)
        foot = core.extreme(first, normal)
        here = shifted(first.origin, 1.0, foot)
        gap = dot(normal, minus(anchor, here))
        there = shifted(here, gap, normal)
        w = minus(second.velocity_at(minus(there, second.origin)), first.velocity_at(foot))
        terms = self._terms(first, second, normal, direction, gap, w)
        # A sharp vertex or edge touches the surface itself: its bounds are told by the normal, over the ellipsoid's size.
        offset = scaled(-gap - math.sqrt(min(core.squares)), normal)
        if isinstance(other, Point):
            inside = other.inside(second, offset)
        else:
            inside = other.inside(second, minus(there, second.origin), offset)
        return self._held(gap, dot(normal, w), normal, (here, there), terms, inside)

    def _normal(self, motion: Motion, anchor: Vector, direction: Vector | None) -> Vector:
        """Outward normal of the ellipsoid towards a point, or towards a line: seen along it the ellipsoid is an ellipse."""
        core = self._ellipsoid
        axes = np.array([motion.turned(axis) for axis in core.axes]).T
        squares = (axes * core.squares) @ axes.T
        view = np.eye(3) if direction is None else np.linalg.svd(np.array([direction]))[2][1:].T
        reach, principal = np.linalg.eigh(view.T @ squares @ view)
        basis = view @ principal
        centre = shifted(motion.origin, 1.0, motion.turned(core.centre))
        seen = np.array(minus(anchor, centre)) @ basis
        normal = basis @ (seen / (reach + _root(reach, seen)))
        x, y, z = (normal / np.linalg.norm(normal)).tolist()
        return x, y, z

    def _terms(
        self, first: Motion, second: Motion, normal: Vector, direction: Vector | None, gap: float, w: Vector
    ) -> tuple[float, ...]:
        n, relative = np.array(normal), np.array(w)
        own = np.array(cross(first.omega, normal))
        bent = np.array([self._ellipsoid.bent(first, normal, axis) for axis in _AXES])
        fixed, along = np.zeros(3), np.array(direction or (0.0, 0.0, 0.0))
        turn = 0.0 if direction is None else dot(normal, cross(second.omega, direction))
        fixed = -turn * along
        tangents = np.linalg.svd(np.stack((n, along)))[2][1 if direction is None else 2 :]
        stiff = bent + gap * np.eye(3)
        right = tangents @ (relative + bent @ own - stiff @ fixed)
        turning = fixed + np.linalg.solve(tangents @ stiff @ tangents.T, right) @ tangents
        slide = bent @ (turning - own)
        slide_along = float(along @ (gap * turning - relative + slide))
        rolled = float(n @ np.cross(np.array(first.omega), slide))
        return float(turning @ relative), slide_along * turn, -rolled


_AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _root(squares: FloatArray, point: FloatArray) -> float:
    """The l > -min(squares) with sum of squares point^2 / (squares + l)^2 = 1: convex there, Newton's method is safe."""
    root = 0.0
    for _ in range(_TURNS):
        share = squares * point**2 / (squares + root) ** 2
        value, slope = float(share.sum()) - 1.0, -2.0 * float((share / (squares + root)).sum())
        before, root = root, root - value / slope
        if math.isclose(root, before, rel_tol=1e-15, abs_tol=1e-17 * float(squares.max())):
            break
    return root
