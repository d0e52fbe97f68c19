"""How far pieces and mesh differ: the two directed Hausdorff distances between the solids, from below.

Both are greatest distances at samples, drawn with a fixed seed: that of the solids is at least as much, and close to it
where samples are dense. Where pieces partition the mesh, they are rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.decomposition.surface import Surface
from ffsm_mj.hull import greatest_distance
from ffsm_mj.polytope import Polytope

_SAMPLES = 2_000
_LEAST_SAMPLES = 200
_WORK = 10_000_000
"""Samples times triangles: about two seconds each way."""
_SEED = 55


class Distances(NamedTuple):
    """Greatest distances between two solids at samples, m.

    Attributes:
        outside_m: Distance of the pieces from the mesh: how far they reach out of it.
        uncovered_m: Distance of the mesh from the pieces: how far it reaches out of them.
    """

    outside_m: float
    uncovered_m: float


def distances(surface: Surface, pieces: Sequence[Polytope]) -> Distances:
    """Distances of the pieces of a mesh from it, and of it from the pieces."""
    rng = np.random.default_rng(_SEED)
    of_pieces = np.concatenate([_triangles(piece) for piece in pieces])
    count = int(np.clip(_WORK // (len(surface.faces) + len(of_pieces)), _LEAST_SAMPLES, _SAMPLES))
    corners = np.concatenate([piece.vertices for piece in pieces])
    points = np.vstack((_some(corners, count, rng), _on_triangles(of_pieces, count, rng)))
    outside = points[[surface.winding(point) < 0.5 for point in points]]
    on_surface = _on_triangles(surface.triangles, count, rng)
    # Points between two of the surface are inside at any depth, where they are inside at all.
    between = on_surface + rng.random((count, 1)) * (rng.permutation(on_surface) - on_surface)
    inside = between[[surface.winding(point) > 0.5 for point in between]]
    points = np.vstack((_some(surface.vertices, count, rng), on_surface, inside))
    uncovered = points[~_in_any(points, pieces)]
    return Distances(greatest_distance(outside, surface.triangles), greatest_distance(uncovered, of_pieces))


def _triangles(piece: Polytope) -> FloatArray:
    """Triangles of the faces of a polytope, (n, 3, 3)."""
    fans = [(face[0], face[k], face[k + 1]) for face in piece.faces for k in range(1, len(face) - 1)]
    return np.asarray(piece.vertices[np.array(fans)])


def _some(points: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """All points, or so many of them at random."""
    return points if len(points) <= count else points[rng.choice(len(points), count, replace=False)]


def _on_triangles(triangles: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points on triangles, uniform by area, (count, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(triangles), count, p=areas / areas.sum())
    root, other = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return np.asarray((1.0 - root) * a[chosen] + root * (1.0 - other) * b[chosen] + root * other * c[chosen])


def _in_any(points: FloatArray, pieces: Sequence[Polytope]) -> BoolArray:
    """Which points are in some piece, (n,)."""
    inside = np.zeros(len(points), dtype=bool)
    for piece in pieces:
        inside |= (points @ piece.normals.T - piece.offsets).max(axis=1) <= 0.0
    return inside
