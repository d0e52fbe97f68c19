"""Pieces for tests of unions: solids cut at random."""

from __future__ import annotations

import numpy as np

from ffsm_mj.polytope import Polytope, box

EYE = np.eye(3)


def cut_at_random(rng, whole: Polytope, cuts: int) -> list[Polytope]:
    """A solid cut by planes, one piece at a time, mostly along its first two axes."""
    pieces = [whole]
    for _ in range(cuts):
        k = int(rng.integers(len(pieces)))
        normal = whole.normals[int(rng.integers(2))] if rng.random() < 0.7 else rng.normal(size=3)
        normal = normal / np.linalg.norm(normal)
        weights = rng.dirichlet(np.ones(len(pieces[k].vertices)))
        parts = pieces[k].cut(normal, float(normal @ (weights @ pieces[k].vertices)))
        pieces[k : k + 1] = [part for part in parts if part]
    return pieces


def random_boxes(rng, count: int) -> list[Polytope]:
    """Boxes along the axes with corners on a coarse grid, so that many sides, edges and corners coincide."""
    lower = rng.integers(0, 4, (count, 3))
    sizes = rng.integers(1, 4, (count, 3))
    return [box(0.05 * size, 0.1 * low + 0.05 * size, EYE) for low, size in zip(lower, sizes, strict=True)]


def all_edges(solid):
    """All edges of a union, each once."""
    return [*dict.fromkeys(edge for k in range(len(solid.pieces)) for edge in solid.edges.of(k))]


def faces_at(solid, point):
    """Faces of a union that a point is on."""
    planes = (plane for k in solid.tree.near(point, point, 1e-9) for plane in solid.planes[k])
    faces = (face for plane in dict.fromkeys(planes) for face in solid.faces.at(plane))
    return [face for face in faces if abs(face.normal @ point - face.offset) <= 1e-9 and face.inside(point) >= -1e-9]
