"""Convex polytopes in double precision: whole polygons with their planes, cut by planes without loss of any of them.

MuJoCo keeps the vertices of meshes in single precision, in which two pieces of one body no longer share a plane. Pieces of
unions are therefore these polytopes, in the axes of a geom or body.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.tolerances import MERGED_M

_SIGNS = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
"""Corners of a box; bits 0, 1 and 2 of an index are the sides in x, y and z."""
_BOX_FACES = ((1, 3, 7, 5), (2, 6, 7, 3), (4, 5, 7, 6), (0, 4, 6, 2), (0, 1, 5, 4), (0, 2, 3, 1))
"""Sides +x, +y, +z, -x, -y and -z, counter-clockwise seen from outside."""

Faces = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Polytope:
    """A bounded convex solid with interior: the points x with normals @ x <= offsets.

    Attributes:
        vertices: Corners, (n, 3), m.
        normals: Outward unit normals of the faces, (m, 3).
        offsets: Distances of the planes from the origin along their normals, (m,), m.
        faces: Indices of the corners of the faces, counter-clockwise seen from outside: whole polygons.
    """

    vertices: FloatArray
    normals: FloatArray
    offsets: FloatArray
    faces: Faces

    @cached_property
    def bounds(self) -> FloatArray:
        """Least and greatest coordinates, (2, 3), m."""
        return np.stack((self.vertices.min(axis=0), self.vertices.max(axis=0)))

    @cached_property
    def edges(self) -> tuple[tuple[int, int, int, int], ...]:
        """Start and end vertex of the edges, then the faces left and right of this direction seen from outside."""
        left = {side: k for k, face in enumerate(self.faces) for side in _sides(face)}
        return tuple((a, b, k, left[b, a]) for (a, b), k in left.items() if a < b)

    @cached_property
    def segments(self) -> tuple[FloatArray, FloatArray]:
        """Starts of the edges, m, and the vectors from there to their ends, m, (e, 3) each."""
        ends = np.array([edge[:2] for edge in self.edges])
        starts = self.vertices[ends[:, 0]]
        return starts, self.vertices[ends[:, 1]] - starts

    @property
    def volume(self) -> float:
        """Volume in m3: the sum of the pyramids over the faces with a corner as apex."""
        apex = self.vertices[0]
        areas = [float(np.linalg.norm(area_vector(self.vertices[list(face)]))) for face in self.faces]
        return float((self.offsets - self.normals @ apex) @ areas) / 3.0

    @property
    def thickness(self) -> float:
        """Least width across a face, m."""
        return float((self.offsets - (self.normals @ self.vertices.T).min(axis=1)).min())

    def moved(self, position: FloatArray, rotation: FloatArray) -> Polytope:
        """The same solid in other axes.

        Args:
            position: Origin of its present axes in the others, (3,), m.
            rotation: Matrix that turns vectors into the others, (3, 3).
        """
        normals = self.normals @ rotation.T
        return Polytope(position + self.vertices @ rotation.T, normals, self.offsets + normals @ position, self.faces)

    def cut(self, normal: FloatArray, offset: float, tolerance: float = MERGED_M) -> tuple[Polytope | None, Polytope | None]:
        """The parts with normal @ x below and above an offset; None for one without interior.

        Planes of faces stay bit for bit, the cut faces have the plane of the cut in both senses, and both parts have the
        same vertices on it. An edge with the same ends in two polytopes is cut at the same point.

        Args:
            normal: Unit normal of the plane, (3,).
            offset: Its distance from the origin along the normal, m.
            tolerance: Vertices this close to the plane, in m, are on it: a part no thicker than this has no interior.
        """
        heights = self.vertices @ normal - offset
        sides = np.where(np.abs(heights) <= tolerance, 0, np.sign(heights)).astype(int)
        if sides.max() <= 0 or sides.min() >= 0:
            return (self, None) if sides.max() <= 0 else (None, self)
        points, crossing = [*self.vertices], dict[tuple[int, int], int]()
        for a, b, *_ in self.edges:
            if sides[a] * sides[b] < 0:
                crossing[a, b] = crossing[b, a] = len(points)
                points.append(_crossing(*sorted((self.vertices[i].tolist(), float(heights[i])) for i in (a, b))))
        vertices, levels = np.array(points), [*sides.tolist(), *[0] * (len(crossing) // 2)]
        below, above = (self._part(vertices, levels, crossing, sense, normal, offset) for sense in (-1, 1))
        return below, above

    def _part(
        self,
        vertices: FloatArray,
        levels: Sequence[int],
        crossing: dict[tuple[int, int], int],
        sense: int,
        normal: FloatArray,
        offset: float,
    ) -> Polytope:
        """The part on one side of a plane.

        Args:
            vertices: Vertices and points at which edges cross the plane, (n, 3).
            levels: Sides on which they are: -1, 0 (in the plane) or 1.
            crossing: Index of the crossing point by the ends of the edge.
            sense: Side of the part, -1 or 1.
            normal: Unit normal of the plane.
            offset: Distance of the plane from the origin.
        """
        polygons, kept = [], []
        for k, face in enumerate(self.faces):
            split = [i for side in _sides(face) for i in (side[0], *([crossing[side]] if side in crossing else []))]
            polygon = tuple(i for i in split if levels[i] * sense >= 0)
            # A face that has only an edge or a corner in common with the part leaves no polygon.
            if any(levels[i] * sense > 0 for i in polygon):
                polygons.append(polygon)
                kept.append(k)
        # Sides within the plane are those of the cut face, in the other direction.
        following = {b: a for polygon in polygons for a, b in _sides(polygon) if levels[a] == 0 and levels[b] == 0}
        planes = np.vstack((self.normals[kept], -sense * normal)), np.append(self.offsets[kept], -sense * offset)
        return _compact(vertices, *planes, [*polygons, _loop(following)])


def box(half_sizes: FloatArray, position: FloatArray, rotation: FloatArray) -> Polytope:
    """A box with exact planes: its normals are the columns of its rotation, first of the three positive sides.

    Args:
        half_sizes: Half its extents, (3,), m.
        position: Its centre, (3,), m.
        rotation: Its axes as columns, (3, 3).
    """
    normals = np.vstack((rotation.T, -rotation.T)) + 0.0
    offsets = np.concatenate((rotation.T @ position, -(rotation.T @ position))) + np.tile(half_sizes, 2)
    return Polytope(position + (_SIGNS * half_sizes) @ rotation.T, normals, offsets, _BOX_FACES)


def hull_of(points: FloatArray, merge: float = MERGED_M) -> Polytope:
    """The convex hull of points, (n, 3), m.

    Args:
        points: At least four.
        merge: Facets whose corners are all this close to the plane of a larger neighbour, in m, are one face with it.

    Raises:
        ValueError: They are in a plane, or no thicker than ``merge``.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes long to import: only unions and decompositions pay

    try:
        facets = ConvexHull(points)
    except (QhullError, ValueError) as error:
        msg = f"the hull of {len(points)} points has no volume"
        raise ValueError(msg) from error
    triangles, groups = _oriented(points, facets), _coplanar(points, facets, merge)
    polygons: list[tuple[int, ...]] = [_outline(triangles, group) for group in groups] if len(groups) > 3 else [()]
    # A vertex between two faces only is a point within an edge.
    uses = np.bincount([i for polygon in polygons for i in polygon], minlength=len(points))
    faces = [tuple(i for i in polygon if uses[i] > 2) for polygon in polygons]
    if min(map(len, faces)) < 3:
        msg = f"the hull of {len(points)} points is no thicker than {merge:g} m"
        raise ValueError(msg)
    planes = [plane_of(points[list(face)]) for face in faces]
    return _compact(points, np.array([normal for normal, _ in planes]), np.array([offset for _, offset in planes]), faces)


def plane_of(corners: FloatArray) -> tuple[FloatArray, float]:
    """Unit normal, (3,), and offset in m of the plane through the corners of a polygon, (n, 3), counter-clockwise.

    Its normal is along the area vector of the polygon; for one parallel to a plane of coordinates it is exact.
    """
    area = area_vector(corners)
    normal = area / np.linalg.norm(area) + 0.0
    # The mean is that of differences, so that the offset of equal coordinates is exact.
    return normal, float(corners[0] @ normal + ((corners - corners[0]) @ normal).mean())


def _sides(polygon: Sequence[int]) -> Iterable[tuple[int, int]]:
    """Pairs of subsequent corners."""
    return pairwise((*polygon, polygon[0]))


def area_vector(corners: FloatArray) -> FloatArray:
    """Area of a polygon in m2 times its normal, (3,).

    Of differences of coordinates, so that the components of one parallel to a plane of coordinates are exactly zero.
    """
    (a, b, c), *others = corners.tolist()
    x = y = z = 0.0
    for (d, e, f), (g, h, i) in pairwise([(p - a, q - b, r - c) for p, q, r in others]):
        x += e * i - f * h
        y += f * g - d * i
        z += d * h - e * g
    return np.array((0.5 * x, 0.5 * y, 0.5 * z))


def _crossing(one: tuple[list[float], float], other: tuple[list[float], float]) -> FloatArray:
    """Point of height 0 between two points of heights of opposite sign, (3,); the order decides its rounding."""
    (start, low), (end, high) = one, other
    return np.asarray(np.array(start) + low / (low - high) * (np.array(end) - np.array(start)))


def _loop(following: dict[int, int]) -> tuple[int, ...]:
    """A cycle in order, from its successors.

    Raises:
        ValueError: They are no single cycle.
    """
    start = next(iter(following))
    loop = [start]
    while (succeeding := following[loop[-1]]) != start and len(loop) < len(following):
        loop.append(succeeding)
    if len(loop) != len(following):
        msg = f"{len(following)} sides do not bound one face"
        raise ValueError(msg)
    return tuple(loop)


def _compact(vertices: FloatArray, normals: FloatArray, offsets: FloatArray, faces: Sequence[tuple[int, ...]]) -> Polytope:
    """A polytope with those vertices only that its faces have."""
    used = sorted({i for face in faces for i in face})
    index = {old: new for new, old in enumerate(used)}
    return Polytope(vertices[used], normals, offsets, tuple(tuple(index[i] for i in face) for face in faces))


def _coplanar(points: FloatArray, facets: Any, merge: float) -> list[list[int]]:
    """Groups of adjacent triangles in one plane, the largest first.

    Args:
        points: (n, 3).
        facets: Convex hull of scipy, of triangles.
        merge: Distance from the plane of the first triangle within which the corners of the others are.
    """
    corners = points[facets.simplices]
    areas = np.array([np.linalg.norm(area_vector(triangle)) for triangle in corners])
    waiting, groups = set(range(len(corners))), []
    places, planes, neighbors = corners.tolist(), facets.equations.tolist(), facets.neighbors.tolist()
    for first in np.argsort(-areas).tolist():
        if first not in waiting:
            continue
        a, b, c, d = planes[first]
        group = [first]
        waiting.discard(first)
        for facet in group:  # grows meanwhile
            adjacent = [
                k
                for k in neighbors[facet]
                if k in waiting and all(abs(a * x + b * y + c * z + d) <= merge for x, y, z in places[k])
            ]
            waiting.difference_update(adjacent)
            group += adjacent
        groups.append(group)
    return groups


def _outline(triangles: Sequence[Sequence[int]], group: Sequence[int]) -> tuple[int, ...]:
    """Vertices around a group of adjacent triangles, counter-clockwise seen from outside."""
    sides = {side for k in group for side in _sides(triangles[k])}
    return _loop({a: b for a, b in sides if (b, a) not in sides})


def _oriented(points: FloatArray, facets: Any) -> list[list[int]]:
    """Corners of all triangles of a hull, counter-clockwise seen from outside.

    Thin triangles do not tell their sense by their area: it passes from the largest one to its neighbours.
    """
    triangles: list[list[int]] = facets.simplices.tolist()
    areas = np.array([area_vector(triangle) for triangle in points[facets.simplices]])
    first = int(np.argmax(np.linalg.norm(areas, axis=1)))
    if areas[first] @ facets.equations[first, :3] < 0.0:
        triangles[first].reverse()
    waiting, order = set(range(len(triangles))) - {first}, [first]
    for k in order:  # grows meanwhile
        sides = set(_sides(triangles[k]))
        for adjacent in facets.neighbors[k].tolist():
            if adjacent in waiting:
                waiting.discard(adjacent)
                order.append(adjacent)
                if not sides.isdisjoint(_sides(triangles[adjacent])):
                    triangles[adjacent].reverse()
    return triangles
