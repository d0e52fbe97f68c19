"""Terrain as convex prisms: height fields down to their base, and open meshes down by a depth against their mean normal.

Prisms of one terrain have parallel sides, so they fill it without overlap, whatever its slopes. A height field is
triangulated as MuJoCo does, by the diagonal of each cell from its corner at the least x and y; cells in one plane
are one prism as far as they form a rectangle. Tops in one plane have one plane, bit for bit, and so have sides that two
prisms share, in either sense.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.polytope import Polytope, plane_of
from ffsm_mj.tolerances import EPSILON

_ROUNDING = 32.0 * EPSILON
"""Rounding of a coordinate over the greatest: by a difference, a quotient, a product, and a plane through such points."""
_LEANS = 1e-6
"""A triangle whose normal has less than this along the mean normal stands upright: its prism has no thickness."""


def height_prisms(heights: FloatArray, size: FloatArray) -> tuple[Polytope, ...]:
    """Prisms of a height field in the axes of its geom, from its heights to the bottom of its base.

    Args:
        heights: Heights of the grid points above the plane z = 0 in m, rows along y, columns along x, (nrow, ncol).
        size: Half its extents in x and y and the depth of its base below z = 0, (3,), m.
    """
    rows, columns = heights.shape
    grid = _Grid(heights, size)
    corners = np.array(list(grid.triangles()))
    points = grid.points.reshape(-1, 3)
    planes, group = _tops(points, corners, max(rows, columns))
    level = group.reshape(rows - 1, columns - 1, 2)
    prisms = [grid.rectangle(planes[level[rectangle[0], rectangle[2], 0]], *rectangle) for rectangle in _rectangles(level)]
    prisms += [grid.triangle(planes[group[k]], int(k)) for k in np.flatnonzero(np.repeat(~_flat(level).ravel(), 2))]
    return tuple(prisms)


class _Grid:
    """Grid points of a height field, and the planes through its lines and diagonals.

    Attributes:
        points: (nrow, ncol, 3), m.
    """

    def __init__(self, heights: FloatArray, size: FloatArray) -> None:
        """Place the points as MuJoCo does: the first row and column are at the least y and x."""
        rows, columns = heights.shape
        self._size, self._columns = size, columns
        x, y = (half * (2.0 * np.arange(n) - (n - 1)) / (n - 1) for half, n in zip(size[:2], (columns, rows), strict=True))
        self.points = np.stack((*np.meshgrid(x, y), heights), axis=2)
        self._x, self._y = x, y

    def triangles(self) -> Iterator[tuple[int, int, int]]:
        """Indices of the points of both triangles of each cell, counter-clockwise from above."""
        rows, columns = self.points.shape[:2]
        for row in range(rows - 1):
            for i in range(row * columns, row * columns + columns - 1):
                yield i, i + 1, i + columns + 1
                yield i + columns + 1, i + columns, i

    def rectangle(self, top: tuple[FloatArray, float], r0: int, r1: int, c0: int, c1: int) -> Polytope:
        """The prism of some rows and columns of points, which are in one plane."""
        corners = [self.points[place] for place in ((r0, c0), (r0, c1), (r1, c1), (r1, c0))]
        sides = [
            (np.array([0.0, -1.0, 0.0]), -self._y[r0]),
            (np.array([1.0, 0.0, 0.0]), self._x[c1]),
            (np.array([0.0, 1.0, 0.0]), self._y[r1]),
            (np.array([-1.0, 0.0, 0.0]), -self._x[c0]),
        ]
        return self._prism(corners, top, sides)

    def triangle(self, top: tuple[FloatArray, float], k: int) -> Polytope:
        """The prism of one triangle, by its number."""
        row, column = divmod(k // 2, self._columns - 1)
        above = k % 2
        sense, first, last = (1.0 - 2.0 * above), (row, column), (row + 1, column + 1)
        places = [last, (row + 1, column), first] if above else [first, (row, column + 1), last]
        # Points of a diagonal of the grid have the difference of row and column in common, from which its offset follows.
        along, up = self._x[1] - self._x[0], self._y[1] - self._y[0]
        level = along * self._y[0] - up * self._x[0] + along * up * (row - column)
        length = math.hypot(along, up)
        sides = [
            (np.array([0.0, -sense, 0.0]), -sense * self._y[row + above]),
            (np.array([sense, 0.0, 0.0]), sense * self._x[column + 1 - above]),
            (sense / length * np.array([-up, along, 0.0]), sense * level / length),
        ]
        return self._prism([self.points[place] for place in places], top, sides)

    def _prism(
        self, corners: Sequence[FloatArray], top: tuple[FloatArray, float], sides: Sequence[tuple[FloatArray, float]]
    ) -> Polytope:
        upper = np.array(corners)
        lower = np.column_stack((upper[:, :2], np.full(len(upper), -self._size[2])))
        return _prism(upper, lower, [top, (np.array([0.0, 0.0, -1.0]), self._size[2]), *sides])


def mesh_prisms(vertices: FloatArray, faces: IntArray, depth_m: float) -> tuple[Polytope, ...]:
    """Prisms of an open mesh, from its triangles down against its mean normal.

    Args:
        vertices: (n, 3), m.
        faces: Vertices of the triangles, counter-clockwise seen from above, (m, 3).
        depth_m: Length of the prisms.

    Raises:
        ValueError: It is closed, or parts of it stand upright or overhang.
    """
    a, b, c = vertices[faces].swapaxes(0, 1)
    areas = np.cross(b - a, c - a)
    sizes, total = np.linalg.norm(areas, axis=1), areas.sum(axis=0)
    if np.linalg.norm(total) <= _LEANS * sizes.sum():
        raise ValueError("a closed mesh has no upper side; for a closed one 'planes' or 'coacd' are allowed")
    up = np.where(np.abs(total) <= _ROUNDING * len(faces) * np.abs(total).max(), 0.0, total)
    up /= np.linalg.norm(up)
    if count := int((areas @ up < _LEANS * sizes).sum()):
        raise ValueError(f"{count} of {len(faces)} triangles stand upright or overhang, seen along the mean normal")
    planes, group = _tops(vertices, faces, math.isqrt(len(faces)) + 1)
    lowered = vertices - depth_m * up
    prisms = []
    for corners, number in zip(faces.tolist(), group.tolist(), strict=True):
        normal, offset = planes[number]
        base = -normal, -(offset - depth_m * float(normal @ up))
        sides = [_side(vertices, a, b, up) for a, b in pairwise((*corners, corners[0]))]
        prisms.append(_prism(vertices[corners], lowered[corners], [planes[number], base, *sides]))
    return tuple(prisms)


def _side(vertices: FloatArray, a: int, b: int, up: FloatArray) -> tuple[FloatArray, float]:
    """Plane along an edge and the vertical, its normal to the right of the way from a to b; exactly opposite from b to a."""
    sense, start, end = (1.0, a, b) if a < b else (-1.0, b, a)
    normal = np.cross(vertices[end] - vertices[start], up)
    normal = normal / np.linalg.norm(normal) + 0.0
    return sense * normal, sense * float(normal @ vertices[start])


def _prism(upper: FloatArray, lower: FloatArray, planes: Sequence[tuple[FloatArray, float]]) -> Polytope:
    """A prism from its corners, (n, 3) each, counter-clockwise from above, and its planes: top, bottom, sides in order."""
    n = len(upper)
    sides = [(n + i, n + (i + 1) % n, (i + 1) % n, i) for i in range(n)]
    normals, offsets = zip(*planes, strict=True)
    faces = (tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *sides)
    return Polytope(np.concatenate((upper, lower)), np.array(normals), np.array(offsets), faces)


def _tops(points: FloatArray, corners: IntArray, across: int) -> tuple[list[tuple[FloatArray, float]], IntArray]:
    """Planes of the triangles of a surface: neighbours in one plane, within rounding, have the same.

    Args:
        points: (n, 3).
        corners: Indices of the points of the triangles, (m, 3).
        across: Number of triangles across the surface, by which the rounding of a plane grows towards its other end.

    Returns:
        The planes, and the index of that of each triangle, (m,).
    """
    rounding = _ROUNDING * across * float(np.abs(points).max())
    neighbours = _neighbours(corners)
    group, planes = np.full(len(corners), -1), list[tuple[FloatArray, float]]()
    for first in range(len(corners)):
        if group[first] >= 0:
            continue
        normal, offset = plane_of(points[corners[first]])
        group[first] = len(planes)
        reached = [first]
        for k in reached:  # grows meanwhile
            for other in neighbours[k]:
                if group[other] < 0 and np.abs(points[corners[other]] @ normal - offset).max() <= rounding:
                    group[other] = len(planes)
                    reached.append(other)
        planes.append((normal, offset))
    return planes, group


def _neighbours(corners: IntArray) -> Sequence[Iterable[int]]:
    """Triangles that have an edge in common with each triangle."""
    at_edge = defaultdict[tuple[int, ...], list[int]](list)
    for k, (a, b, c) in enumerate(corners.tolist()):
        for edge in ((a, b), (b, c), (c, a)):
            at_edge[tuple(sorted(edge))].append(k)
    adjacent: list[list[int]] = [[] for _ in range(len(corners))]
    for triangles in at_edge.values():
        for k in triangles:
            adjacent[k] += [other for other in triangles if other != k]
    return adjacent


def _flat(level: IntArray) -> npt.NDArray[np.bool_]:
    """Cells whose two triangles are in one plane, from the plane of each triangle, (rows, columns, 2)."""
    return np.asarray(level[:, :, 0] == level[:, :, 1])


def _rectangles(level: IntArray) -> Iterator[tuple[int, int, int, int]]:
    """Rectangles of cells in one plane that cover all flat cells once: first and last row and column of their points."""
    waiting = _flat(level)
    rows, columns = waiting.shape
    for row in range(rows):
        for column in range(columns):
            if not waiting[row, column]:
                continue
            same = waiting & (level[:, :, 0] == level[row, column, 0])
            c1, r1 = column + 1, row + 1
            while c1 < columns and same[row, c1]:
                c1 += 1
            while r1 < rows and same[r1, column:c1].all():
                r1 += 1
            waiting[row:r1, column:c1] = False
            yield row, r1, column, c1
