"""Outlines of cylinders and ellipsoids."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, dot, minus, shifted, unit
from ffsm_mj.contact.features.cores import Circle, Core, Curve, Ellipsoid, Face, Line, Point
from ffsm_mj.contact.features.outline import Outline
from ffsm_mj.contact.shape import Shape, lies_flat
from ffsm_mj.tolerances import CONTACT_GAP_M, PARALLEL


class EllipsoidOutline(Outline):
    """Outline of an ellipsoid, the same along any direction."""

    def corners(self) -> list[Core]:
        """The ellipsoid."""
        (a, b, c), (x, y, z) = self._size, (self._turned(axis) for axis in self._rotation.T)
        return [Ellipsoid("ellipsoid", self._body, self._place(self._position), (x, y, z), (a * a, b * b, c * c))]

    def edges(self, *, bounded: bool) -> Iterator[Line]:  # noqa: ARG002
        """No straight edges."""
        yield from ()


class CylinderOutline(Outline):
    """Outline of a cylinder: its side, a cap, or the rim between them."""

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray, tolerance: float) -> None:
        """Find the features; see :class:`Outline`."""
        super().__init__(model, data, geom, outward, tolerance)
        axis: FloatArray = self._rotation[:, 2]
        up = float(outward @ axis)
        across = outward - up * axis
        self._radius, self._half = self._size[0], self._size[1]
        self._side = abs(up) <= PARALLEL
        self.flat = lies_flat(float(np.linalg.norm(across)), self._radius, tolerance)
        self._axis = axis if up > 0.0 else -axis
        self._start = self._rotation[:, 0] if self.flat else across / np.linalg.norm(across)
        self._rim_points = Shape(model, data, geom).extreme(outward, PARALLEL, tolerance) if self.flat else None

    def points(self) -> list[Core]:
        """The rims, or points of the rim of a cap."""
        if self._rim_points is None:
            return self.corners()
        return [self._rim_point(point) for point in self._rim_points]

    def rim_points(self, places: FloatArray) -> list[Core]:
        """Those of some places in the world, (k, 3), that are on the rim of a cap."""
        if not self.flat:
            return []
        centre = self._position + self._half * self._axis
        offsets = places - centre
        across = offsets - np.outer(offsets @ self._axis, self._axis)
        lengths = np.linalg.norm(across, axis=1)
        on_rim = np.abs(lengths - self._radius) <= CONTACT_GAP_M
        return [self._rim_point(centre + point) for point in self._radius * across[on_rim] / lengths[on_rim, None]]

    def _rim_point(self, place: FloatArray) -> Point:
        return Point("rim", self._body, self._place(place), 0.0, np.empty((0, 3)))

    def corners(self) -> list[Core]:
        """The rim, or the rims at both ends of the side; none for a cap."""
        if self.flat:
            return []
        return [*self._rims()] if self._side else [self._rim(self._axis)]

    def edges(self, *, bounded: bool) -> Iterator[Line]:  # noqa: ARG002
        """The side: the axis with the radius around it."""
        if self._side:
            centre, axis = self._place(self._position), self._turned(self._axis)
            one, other = (replace(rim, bounded=False) for rim in self._rims())
            yield Line("side", self._body, centre, axis, self._half, self._radius, (), (one, other))

    def curves(self, *, bounded: bool) -> Iterator[Curve]:
        """The side, or the rim around a cap."""
        if self.flat:
            yield self._rim(self._axis)
        yield from self.edges(bounded=bounded)

    def face(self) -> Face | None:
        """The cap."""
        if not self.flat:
            return None
        centre = self._place(self._position + self._half * self._axis)
        return Face("cap", self._body, centre, self._turned(self._axis), (), self._radius)

    def crossings(self, circle: Circle, centre: Vector, direction: Vector) -> Iterator[Circle]:
        """Copies of a circle with angle 0 where a line (world axes) crosses it in projection; none if it misses."""
        axis = self._motion.turned(circle.axis)
        offset = minus(centre, self.centre(circle))
        offset = shifted(offset, -dot(offset, axis), axis)
        along = shifted(direction, -dot(direction, axis), axis)
        square, half = dot(along, along), dot(offset, along)
        under = half * half - square * (dot(offset, offset) - circle.size**2)
        if under > 0.0:
            for root in (math.sqrt(under), -math.sqrt(under)):
                towards = unit(shifted(offset, (root - half) / square, along))
                yield replace(circle, start=self._motion.local(towards), bounded=False)

    def _rims(self) -> tuple[Circle, Circle]:
        return self._rim(self._axis), self._rim(-self._axis)

    def _rim(self, axis: FloatArray) -> Circle:
        centre = self._place(self._position + self._half * axis)
        return Circle("rim", self._body, centre, self._turned(axis), self._turned(self._start), self._radius)
