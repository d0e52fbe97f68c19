"""Features of machined parts that are cut into convex pieces, against those of the triangles of their meshes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj.contact.solid.solid import Solid
from ffsm_mj.decomposition.gate import gate
from ffsm_mj.decomposition.planes import partition
from tests.contact.solid.pieces import all_edges, faces_at
from tests.decomposition.meshes import bracket, cone, frame, nozzle, plate, slot

PARTS = {
    "plate": plate,
    "bracket": bracket,
    "slot": slot,
    "frame": frame,
    "cone": lambda: cone(16),
    "nozzle": lambda: nozzle(8, 3),
}


def cut(part):
    """Vertices and faces of a part, and its solid, turned and moved together."""
    vertices, faces = PARTS[part]()
    surface = gate(np.asarray(vertices, dtype=float), np.asarray(faces), part).surface
    pieces = partition(surface, surface.rounding, part)
    turn, position = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix(), np.array([1.0, -2.0, 0.5])
    solid = Solid([piece.moved(position, turn) for piece in pieces], 1e-9, [0] * len(pieces))
    return surface.vertices @ turn.T + position, surface.faces, solid


def bends(vertices, faces):
    """Ends of the edges of a mesh with the sine of the bend there: positive for convex edges, 0 within a plane."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    left = {(int(face[k]), int(face[(k + 1) % 3])): i for i, face in enumerate(faces) for k in range(3)}
    edges = {}
    for (a, b), i in left.items():
        if a < b:
            along = vertices[b] - vertices[a]
            bend = float(np.cross(normals[i], normals[left[b, a]]) @ along / np.linalg.norm(along))
            edges[a, b] = bend if abs(bend) > 1e-9 else 0.0
    return edges


@pytest.mark.parametrize("part", PARTS)
def test_convex_edges_are_those_of_the_mesh(part):
    """Points of each convex edge of the mesh are on one edge of the union, and both have the same length in all."""
    vertices, faces, solid = cut(part)
    edges = all_edges(solid)
    starts, ends = (np.array([getattr(edge, name) for edge in edges]) for name in ("start", "end"))
    directions = np.array([edge.direction for edge in edges])
    length = 0.0
    for (a, b), bend in bends(vertices, faces).items():
        for share in (0.01, 0.5, 0.99):
            place = (1.0 - share) * vertices[a] + share * vertices[b]
            off = np.linalg.norm(np.cross(place - starts, directions), axis=1)
            between = (np.einsum("ij,ij->i", place - starts, directions) > 0.0) & (
                np.einsum("ij,ij->i", ends - place, directions) > 0.0
            )
            assert ((off < 1e-12) & between).sum() == (bend > 0.0)
        length += float(np.linalg.norm(vertices[b] - vertices[a])) if bend > 0.0 else 0.0
    # Coordinates of 3 m, some hundred edges.
    assert np.linalg.norm(ends - starts, axis=1).sum() == pytest.approx(length, abs=1e-12)


@pytest.mark.parametrize("part", PARTS)
def test_triangles_are_in_faces(part):
    """The middle of each triangle is in one face with its normal, as far from its outline as convex edges allow."""
    vertices, faces, solid = cut(part)
    bent = bends(vertices, faces)
    for face in faces:
        corners = vertices[face]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        middle = corners.mean(axis=0)
        (one,) = (other for other in faces_at(solid, middle) if other.normal @ normal > 1.0 - 1e-9)
        spans = np.roll(corners, -1, axis=0) - corners
        sides = np.linalg.norm(np.cross(middle - corners, spans), axis=1) / np.linalg.norm(spans, axis=1)
        assert one.inside(middle) >= min(sides) - 1e-12
        # Beyond a concave edge the plane goes on within the solid, where a cut may have it.
        outline = [d for d, a, b in zip(sides, face, np.roll(face, -1), strict=True) if bent[min(a, b), max(a, b)] > 0.0]
        assert one.inside(middle) <= min(outline, default=np.inf) + 1e-12
