"""How far the convex hull of a mesh, which is what collides, stands off its triangles."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

_SAMPLES_PER_EDGE = 4
"""Points per edge of a facet of the hull."""
_MOST_SAMPLES = 400


def hull_offset(model: Any, geom: int) -> float:
    """Greatest distance of the convex hull of a geom's mesh from its triangles, m; 0 for other geoms.

    Evaluated at points of the facets, so it is a lower bound, close where facets are small or flat areas large.
    """
    if int(model.geom_type[geom]) != int(mujoco.mjtGeom.mjGEOM_MESH):
        return 0.0
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
    start = int(model.mesh_faceadr[mesh])
    triangles = vertices[model.mesh_face[start : start + int(model.mesh_facenum[mesh])]]
    return greatest_distance(_on_hull(vertices), triangles)


def _on_hull(vertices: FloatArray) -> FloatArray:
    """Points on the largest facets of the convex hull, (n, 3)."""
    from scipy.spatial import ConvexHull, QhullError  # takes long to import: only descriptions of scenarios pay

    try:
        facets = vertices[ConvexHull(vertices).simplices]
    except QhullError:  # flat: its hull is the mesh
        return np.zeros((0, 3))
    a, b, c = facets[:, 0], facets[:, 1], facets[:, 2]
    largest = np.argsort(-np.linalg.norm(np.cross(b - a, c - a), axis=1))
    steps = np.arange(1, _SAMPLES_PER_EDGE) / _SAMPLES_PER_EDGE
    weights = np.array([(u, v, 1.0 - u - v) for u in steps for v in steps if u + v < 1.0])
    kept = largest[: max(1, _MOST_SAMPLES // len(weights))]
    return np.asarray(np.einsum("sk,fkx->fsx", weights, facets[kept]).reshape(-1, 3))


def greatest_distance(points: FloatArray, triangles: FloatArray) -> float:
    """Greatest distance of some points, (n, 3), from the nearest of some triangles, (m, 3, 3), in m; 0 without points."""
    from scipy.spatial import KDTree  # takes long to import: see above

    centres = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - centres[:, None], axis=2).max(axis=1)
    # The centre of a triangle is one of its points: none is farther from the triangles than from the nearest centre.
    bounds, _ = KDTree(centres).query(points)
    greatest = 0.0
    for i in np.argsort(-bounds):
        if bounds[i] ** 2 <= greatest:
            break
        # Triangles beyond the bound are not the nearest; the margin is far above rounding of either distance.
        near = np.linalg.norm(centres - points[i], axis=1) - radii <= bounds[i] * (1.0 + 1e-9)
        greatest = max(greatest, _squared_distance(points[i], triangles[near]))
    return float(np.sqrt(greatest))


def _squared_distance(point: FloatArray, triangles: FloatArray) -> float:
    """Squared distance of a point from the nearest of some triangles: it projects into one, or is nearest to an edge."""
    edges = triangles[:, [1, 2, 0]] - triangles
    normals = np.cross(edges[:, 0], -edges[:, 2])
    area = np.einsum("ij,ij->i", normals, normals)
    to = point - triangles  # from each corner, (m, 3, 3)
    along = np.einsum("mkx,mkx->mk", to, edges) / np.maximum(np.einsum("mkx,mkx->mk", edges, edges), 1e-300)
    off = to - np.clip(along, 0.0, 1.0)[:, :, None] * edges
    best = float(np.einsum("mkx,mkx->mk", off, off).min())
    side = np.einsum("mx,mkx->mk", normals, np.cross(edges, to))
    inside = (area > 0.0) & (side >= 0.0).all(axis=1)
    if inside.any():
        height = np.einsum("mx,mx->m", to[inside, 0], normals[inside])
        best = min(best, float((height**2 / area[inside]).min()))
    return best
