"""Closed surfaces of triangles, and which of their triangles or points are near each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.cached_property import cached_property

ROUNDING = 2.0**-22
"""Rounding of coordinates over the greatest of them: four times that of single precision, in which STL stores them."""
_BITS = 10
"""Bits of each coordinate in the order along a space-filling curve."""
_MOST_PAIRS = 20_000_000
"""Pairs of boxes that overlap, of one level of the tree, which take 10 s."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles that bound a solid.

    Attributes:
        vertices: (n, 3), m.
        faces: Vertices of the triangles, counter-clockwise seen from outside, (m, 3).
    """

    vertices: FloatArray
    faces: IntArray

    @cached_property
    def triangles(self) -> FloatArray:
        """Corners, (m, 3, 3), m."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def areas(self) -> FloatArray:
        """Area vectors: twice the area times the outward normal, (m, 3), m2."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return np.asarray(np.cross(b - a, c - a))

    @cached_property
    def extent(self) -> float:
        """Greatest coordinate, m: rounding is proportional to it."""
        return float(np.abs(self.vertices).max(initial=0.0))

    @property
    def rounding(self) -> float:
        """Distance within which points of a file in single precision are the same, m."""
        return ROUNDING * self.extent

    @property
    def volumes(self) -> FloatArray:
        """Signed volumes of the tetrahedra of the triangles with the centre of the surface, (m,), m3."""
        corners = self.triangles - self.vertices.mean(axis=0)
        return np.asarray(np.einsum("mi,mi->m", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)

    @property
    def volume(self) -> float:
        """Volume that it encloses, m3; negative if its faces are turned inwards."""
        return float(self.volumes.sum())

    def turned(self) -> Surface:
        """The same surface with the other side outside."""
        return Surface(self.vertices, self.faces[:, ::-1].copy())

    def winding(self, point: FloatArray, faces: IntArray | slice = slice(None)) -> float:
        """Winding number of some of its triangles about a point: 1 inside, 0 outside of a closed surface.

        Van Oosterom & Strackee 1983: the solid angle of a triangle.
        """
        a, b, c = np.moveaxis(self.triangles[faces] - point, 1, 0)
        la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        above = np.einsum("mi,mi->m", a, np.cross(b, c))
        below = la * lb * lc + sum(
            np.einsum("mi,mi->m", x, y) * length for x, y, length in ((a, b, lc), (b, c, la), (c, a, lb))
        )
        return float(np.arctan2(above, below).sum() / (2.0 * np.pi))


def welded(vertices: FloatArray, faces: IntArray) -> Surface:
    """A surface whose triangles share vertices where their coordinates are equal, without those of fewer than three."""
    points, index = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    corners = index.reshape(-1)[faces]
    distinct = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    return Surface(points, corners[distinct])


class Boxes:
    """A binary tree of axis-aligned boxes: complete, over the boxes in the order of a space-filling curve."""

    def __init__(self, lower: FloatArray, upper: FloatArray) -> None:
        """Args: least and greatest coordinates of the boxes, (n, 3) each."""
        self._order = np.argsort(_along_curve(0.5 * (lower + upper)), kind="stable")
        depth = max(0, int(np.ceil(np.log2(len(lower)))))
        empty = ((1 << depth) - len(lower), 3)
        low = np.vstack((lower[self._order], np.full(empty, np.inf)))
        high = np.vstack((upper[self._order], np.full(empty, -np.inf)))
        self._levels = [(low, high)]
        for _ in range(depth):
            low, high = low.reshape(-1, 2, 3).min(axis=1), high.reshape(-1, 2, 3).max(axis=1)
            self._levels.append((low, high))
        self._levels.reverse()

    def overlapping(self) -> IntArray:
        """Pairs of boxes that have a point in common, the lower index first, (k, 2).

        Raises:
            OverflowError: There are too many.
        """
        first = second = np.zeros(1, dtype=np.intp)
        for low, high in self._levels[1:]:
            first, second = (
                np.concatenate([2 * first + i for i, j in _CHILDREN]),
                np.concatenate([2 * second + j for i, j in _CHILDREN]),
            )
            ordered = first <= second
            first, second = first[ordered], second[ordered]
            common = ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
            first, second = first[common], second[common]
            if len(first) > _MOST_PAIRS:
                raise OverflowError
        pairs = self._order[np.stack((first, second), axis=1)[first != second]]
        return np.sort(pairs, axis=1)


_CHILDREN = ((0, 0), (0, 1), (1, 0), (1, 1))


def _along_curve(points: FloatArray) -> IntArray:
    """Places of points along a Morton curve, (n,): what is near on it is near in space."""
    low, span = points.min(axis=0), np.ptp(points, axis=0)
    cells = ((points - low) / np.where(span > 0.0, span, 1.0) * ((1 << _BITS) - 1)).astype(np.int64)
    places = np.zeros(len(points), dtype=np.intp)
    for bit in range(_BITS):
        for axis in range(3):
            places |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return places
