"""Faces of a union: the polygons of all pieces that lie in one plane and look in one direction.

A contact with a face belongs to the plane, not to a polygon: how far a point is inside is the distance from the outline of
all polygons together, which is continuous where the point passes from one to the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ffsm_mj._core.boxes import BoxTree
from ffsm_mj._core.polygons import hull_indices
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.contact.solid.welding import Plane, Welded
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.tolerances import MERGED_M

Sides = tuple[tuple[Vector, float], ...]
"""Inward unit vectors perpendicular to the sides of a convex polygon, and the positions of the sides along them."""


@dataclass(frozen=True)
class UnionFace:
    """A connected part of a face of a union. Two of one body are the same if plane and pieces are.

    Parts of its polygons may be covered, as those of cuts that go on beyond a concave edge are: nothing touches them there.

    Attributes:
        plane: Index of the plane, and its sense.
        normal: Outward unit normal, (3,).
        offset: Offset of the plane along it, m.
        pieces: Pieces that the polygons belong to.
        polygons: Corners of the polygons, counter-clockwise seen from outside, (k, 3) each.
        boundary: Outline of the union of the polygons: starts and ends of segments with the face to their left, (n, 2, 3).
        tolerance: Distance within which polygons touch, m.
    """

    plane: Plane
    normal: FloatArray = field(compare=False)
    offset: float = field(compare=False)
    pieces: tuple[int, ...]
    polygons: tuple[FloatArray, ...] = field(compare=False)
    boundary: FloatArray = field(compare=False)
    tolerance: float = field(compare=False)

    def to_plain(self) -> dict[str, Any]:
        """As numbers and lists."""
        arrays = {"normal": self.normal.tolist(), "boundary": self.boundary.tolist()}
        polygons = [polygon.tolist() for polygon in self.polygons]
        plain = {"plane": self.plane, "offset": self.offset, "pieces": self.pieces, "tolerance": self.tolerance}
        return {**plain, **arrays, "polygons": polygons}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> UnionFace:
        """The face that :meth:`to_plain` wrote."""
        index, sense = plain["plane"]
        polygons = tuple(map(np.array, plain["polygons"]))
        normal, boundary = np.array(plain["normal"]), np.array(plain["boundary"])
        return cls((index, sense), normal, plain["offset"], tuple(plain["pieces"]), polygons, boundary, plain["tolerance"])

    @cached_property
    def sides(self) -> Sides:
        """Sides of the face if it is convex, computed from its corners alone; else empty."""
        corners = self._hull()
        sides = tuple(_side(self.normal, a, b) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True))
        # The union fills its hull if no part of its outline is within the hull. The middle tells a chord from a side.
        places = np.vstack((self.boundary[:, 0], self.boundary[:, 1], self.boundary.mean(axis=1)))
        inwards, levels = np.array([vector for vector, _ in sides]), np.array([level for _, level in sides])
        convex = (places @ inwards.T - levels).min(axis=1).max() <= self.tolerance
        return sides if convex else ()

    def inside(self, point: FloatArray) -> float:
        """Distance in m by which the projection of a point, (3,), is inside the outline; negative outside.

        For a convex face it is the least distance from the lines of the sides, as that of a single polygon.
        """
        if self.sides:
            x, y, z = map(float, point)
            return min([p * x + q * y + r * z - level for (p, q, r), level in self.sides])
        distance = self._distance(point - (self.normal @ point - self.offset) * self.normal)
        inwards, levels, starts = self._half_planes
        margin = float(np.minimum.reduceat(inwards @ point - levels, starts).max())
        # On a seam a point is within rounding of two polygons and far from the outline.
        within = margin >= 0.0 or (margin >= -self.tolerance and distance > self.tolerance)
        return distance if within else -distance

    def _distance(self, foot: FloatArray) -> float:
        """Distance of a point of the plane from the outline, m."""
        starts, spans = self.boundary[:, 0], self.boundary[:, 1] - self.boundary[:, 0]
        along = np.einsum("ij,ij->i", foot - starts, spans) / np.einsum("ij,ij->i", spans, spans)
        return float(np.linalg.norm(foot - starts - np.clip(along, 0.0, 1.0)[:, None] * spans, axis=1).min())

    @cached_property
    def _half_planes(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Inward vectors and levels of the sides of all polygons, and the first side of each."""
        shapes = [_half_planes_of(self.normal, polygon) for polygon in self.polygons]
        starts = np.cumsum([0, *(len(levels) for _, levels in shapes)])[:-1]
        return np.concatenate([shape[0] for shape in shapes]), np.concatenate([shape[1] for shape in shapes]), starts

    def _hull(self) -> FloatArray:
        """Corners of the hull of the outline, counter-clockwise seen from outside, (k, 3)."""
        points = np.array(sorted(set(map(tuple, self.boundary.reshape(-1, 3).tolist()))))
        across = np.eye(3)[int(np.argmin(np.abs(self.normal)))]
        u = cross(across, self.normal)
        u /= np.linalg.norm(u)
        flat = points @ np.stack((u, cross(self.normal, u))).T
        # Corners within a straight side are left out by rounding, not by the coarser tolerance of touching sets.
        return points[hull_indices(flat, merge=self.tolerance, straight=MERGED_M)]


class UnionFaces:
    """The faces of a union, evaluated when they are asked for."""

    def __init__(self, welded: Welded, tolerance: float) -> None:
        """Sort the faces of all pieces by plane and sense.

        Args:
            welded: The pieces.
            tolerance: Distance within which polygons touch, m.
        """
        self._welded, self._tolerance = welded, tolerance
        self._faces: dict[Plane, list[tuple[int, int]]] = {}
        for piece, planes in enumerate(welded.planes):
            for face, plane in enumerate(planes):
                self._faces.setdefault(plane, []).append((piece, face))
        self._known: dict[Plane, tuple[UnionFace, ...]] = {}

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Planes and senses that there are faces of."""
        return tuple(self._faces)

    def at(self, plane: Plane) -> tuple[UnionFace, ...]:
        """The connected faces of a plane in one sense."""
        if plane not in self._known:
            self._known[plane] = self._united(plane)
        return self._known[plane]

    def _united(self, plane: Plane) -> tuple[UnionFace, ...]:
        index, sense = plane
        normal, offset = sense * self._welded.normals[index] + 0.0, sense * float(self._welded.offsets[index])
        pieces = [self._welded.pieces[piece] for piece, _ in self._faces[plane]]
        polygons = [
            piece.vertices[list(piece.faces[face])] for piece, (_, face) in zip(pieces, self._faces[plane], strict=True)
        ]
        outlines, groups = _Outlines(normal, polygons, self._tolerance).united()
        return tuple(
            UnionFace(
                plane,
                normal,
                offset,
                tuple(sorted({self._faces[plane][k][0] for k in group})),
                tuple(polygons[k] for k in group),
                np.array([segment for k in group for segment in outlines[k]]),
                self._tolerance,
            )
            for group in groups
        )


class _Outlines:
    """Parts of the sides of polygons in one plane that no other polygon continues."""

    def __init__(self, normal: FloatArray, polygons: Sequence[FloatArray], tolerance: float) -> None:
        self._normal, self._polygons, self._tolerance = normal, polygons, tolerance
        self._owner = {side: k for k, polygon in enumerate(polygons) for side in _keys(polygon)}

    def united(self) -> tuple[list[list[FloatArray]], list[list[int]]]:
        """Free segments of each polygon, (2, 3) each, and groups of polygons that touch along sides or overlap."""
        group = list(range(len(self._polygons)))

        def root(k: int) -> int:
            while group[k] != k:
                k = group[k]
            return k

        outlines = []
        for k, polygon in enumerate(self._polygons):
            free: list[FloatArray] = []
            for (start, end), key in zip(_segments(polygon), _keys(polygon), strict=True):
                # Pieces of a partition have whole sides in common; all others are compared with what is near.
                if (partner := self._owner.get(key[::-1])) is not None:
                    group[root(k)] = root(partner)
                    continue
                covered = self._covered(k, start, end)
                for _, _, partner in covered:
                    group[root(k)] = root(partner)
                free += _remaining(start, end, [(low, high) for low, high, _ in covered], self._tolerance)
            outlines.append(free)
        members: dict[int, list[int]] = {}
        for k in range(len(group)):
            members.setdefault(root(k), []).append(k)
        return outlines, [*members.values()]

    @cached_property
    def _shapes(self) -> list[tuple[FloatArray, FloatArray]]:
        return [_half_planes_of(self._normal, polygon) for polygon in self._polygons]

    @cached_property
    def _tree(self) -> BoxTree:
        return BoxTree(np.array([[polygon.min(axis=0), polygon.max(axis=0)] for polygon in self._polygons]))

    def _covered(self, k: int, start: FloatArray, end: FloatArray) -> list[tuple[float, float, int]]:
        """Intervals of a side in m beyond which other polygons lie, with these polygons."""
        span = end - start
        length = float(np.linalg.norm(span))
        if length <= self._tolerance or len(self._polygons) == 1:
            return []
        along = span / length
        outward = cross(along, self._normal)
        covered = []
        for other in self._tree.near(np.minimum(start, end), np.maximum(start, end), self._tolerance):
            inwards, levels = self._shapes[other]
            rows = (inwards @ start - levels).tolist(), (inwards @ along).tolist(), (inwards @ outward).tolist()
            interval = _beyond(zip(*rows, strict=True), length, self._tolerance) if other != k else None
            if interval:
                covered.append((*interval, other))
        return covered


def _beyond(sides: Iterable[tuple[float, float, float]], length: float, tolerance: float) -> tuple[float, float] | None:
    """Interval of a segment whose points, moved outwards by very little, are inside a convex polygon; None if there is none.

    Args:
        sides: Distance of the start of the segment to the inside of each side of the polygon, and the derivatives of this
            distance along the segment and outwards.
        length: Length of the segment, m.
        tolerance: Distances within this are zero, m.
    """
    low, high = 0.0, length
    for distance, slope, outward in sides:
        if abs(slope) * length <= tolerance:  # parallel: on the side itself it matters which of both sides is outwards
            middle = distance + 0.5 * slope * length
            if middle < -tolerance or (middle <= tolerance and outward <= 0.0):
                return None
        elif slope > 0.0:
            low = max(low, -distance / slope)
        else:
            high = min(high, -distance / slope)
    return (low, high) if high - low > tolerance else None


def _remaining(
    start: FloatArray, end: FloatArray, covered: list[tuple[float, float]], tolerance: float
) -> Iterable[FloatArray]:
    """Parts of a segment, (2, 3) each, without some intervals in m along it."""
    length = float(np.linalg.norm(end - start))
    free, reached = [], 0.0
    for low, high in [*sorted(covered), (length, length)]:
        if low - reached > tolerance:
            free.append((reached, low))
        reached = max(reached, high)
    # Ends of the segment stay as they are, bit for bit.
    ends = {0.0: start, length: end}
    return [np.stack([ends.get(t, start + t / length * (end - start)) for t in part]) for part in free]


def _segments(polygon: FloatArray) -> Iterable[tuple[FloatArray, FloatArray]]:
    return zip(polygon, np.roll(polygon, -1, axis=0), strict=True)


def _keys(polygon: FloatArray) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Starts and ends of the sides of a polygon, to find the same ones."""
    corners = [tuple(corner) for corner in (polygon + 0.0).tolist()]
    return [*zip(corners, [*corners[1:], corners[0]], strict=True)]


def _side(normal: FloatArray, start: FloatArray, end: FloatArray) -> tuple[Vector, float]:
    """Inward unit vector of a side, and its position along it; see ``PolytopeOutline.face``."""
    inwards = cross(normal, end - start)
    inwards /= np.linalg.norm(inwards)
    x, y, z = inwards.tolist()
    return (x, y, z), float(inwards @ start)


def _half_planes_of(normal: FloatArray, polygon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inward unit vectors of all sides of a polygon, (k, 3), and their levels, (k,)."""
    inwards = np.array([cross(normal, span) for span in np.roll(polygon, -1, axis=0) - polygon])
    lengths = np.linalg.norm(inwards, axis=1)
    long = lengths > MERGED_M  # shorter ones have no direction
    inwards = inwards[long] / lengths[long, None]
    return inwards, np.einsum("ij,ij->i", inwards, polygon[long])
