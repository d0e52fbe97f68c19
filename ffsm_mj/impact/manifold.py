"""Where two convex geoms touch: a point, an edge or a face, by its extreme points.

A face contact has no single witness (it jumps from corner to corner at 1e-9 rad of tilt), so the touching set is built from
the geoms' own features: everything of a geom that is extreme along the contact normal, intersected with the other's.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model import FloatArray

PARALLEL = 1e-6
"""Normals closer than this in rad count as parallel."""
_SINGLE = 2e-7
_DISC_POINTS = 8
"""A disc is represented by this many points of its rim."""
_KINDS = {1: "point", 2: "edge"}


def manifold_name(count: int) -> str:
    """``point``, ``edge`` or ``face`` by the number of extreme points."""
    return _KINDS.get(count, "face")


def extreme_points(model: Any, data: Any, geom: int, direction: FloatArray, width: float = PARALLEL) -> FloatArray:
    """All extreme points of a geom along a world direction, (k, 3), at the poses in ``data``.

    Args:
        model: MuJoCo model.
        data: Its data with current kinematics.
        geom: Id of a convex geom.
        direction: Unit vector.
        width: Edges and faces within this angle of being square to the direction count whole, rad.
    """
    rotation = data.geom_xmat[geom].reshape(3, 3)
    local = rotation.T @ direction
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        points = size[0] * local[None]
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        points = (size**2 * local / np.linalg.norm(size * local))[None]
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        points = np.array(list(product(*(_ends(c, half, width) for c, half in zip(local, size, strict=True)))))
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        points = np.array([[0.0, 0.0, z] for z in _ends(local[2], size[1], width)]) + size[0] * local
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        points = _cylinder_points(local, size[0], size[1], width)
    else:
        points = _mesh_points(model, geom, local, width)
    return np.asarray(data.geom_xpos[geom] + points @ rotation.T)


def _ends(component: float, half: float, width: float) -> tuple[float, ...]:
    """Extreme coordinate along one axis; both ends where the direction is square to it."""
    return (-half, half) if abs(component) <= width else (float(np.copysign(half, component)),)


def _cylinder_points(local: FloatArray, radius: float, half: float, width: float) -> FloatArray:
    radial = float(np.hypot(local[0], local[1]))
    if radial <= width:
        angles = 2.0 * np.pi * np.arange(_DISC_POINTS) / _DISC_POINTS
        rim = np.column_stack((radius * np.cos(angles), radius * np.sin(angles)))
    else:
        rim = radius / radial * local[None, :2]
    return np.array([[x, y, z] for z in _ends(local[2], half, width) for x, y in rim])


def _mesh_points(model: Any, geom: int, local: FloatArray, width: float) -> FloatArray:
    mesh = int(model.geom_dataid[geom])
    first = int(model.mesh_vertadr[mesh])
    vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64)
    heights = vertices @ local
    # Vertices are stored in single precision: a face is flat to that only.
    reach = max(width, _SINGLE) * float(model.geom_rbound[geom]) if width > 0.0 else 0.0
    return np.unique(vertices[heights >= heights.max() - reach], axis=0)


def touching_set(first: FloatArray, second: FloatArray, normal: FloatArray) -> FloatArray:
    """Extreme points of the intersection of two features in the plane across the normal, (k, 3).

    Args:
        first: Extreme points of one geom along the normal, (m, 3).
        second: Extreme points of the other against it, (n, 3).
        normal: Common normal.

    Returns:
        Points midway between both features; empty where they do not overlap within rounding.
    """
    if min(len(first), len(second)) == 1:
        return first if len(first) == 1 else second
    axis = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = np.cross(normal, axis)
    u /= np.linalg.norm(u)
    plane = np.stack((u, np.cross(normal, u)))
    a, b = _hull(first @ plane.T), _hull(second @ plane.T)
    reach = 1e-9 + 1e-7 * max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()))
    candidates = [p for p in a if _inside(p, b, reach)] + [p for p in b if _inside(p, a, reach)] + _crossings(a, b)
    if not candidates:
        return np.empty((0, 3))
    hull = _hull(np.array(candidates), reach)
    height = 0.5 * (float(np.mean(first @ normal)) + float(np.mean(second @ normal)))
    return np.asarray(hull @ plane + height * normal)


def _hull(points: FloatArray, merge: float = 1e-12) -> FloatArray:
    """Corners of the convex hull of planar points, counter-clockwise; one or two where they are a point or a segment."""
    order = sorted(map(tuple, points))
    distinct = [order[0]]
    for p in order[1:]:
        if all(abs(p[0] - q[0]) + abs(p[1] - q[1]) > merge for q in distinct):
            distinct.append(p)
    if len(distinct) < 3:
        return np.array(distinct)
    span = max(np.ptp([p[0] for p in distinct]), np.ptp([p[1] for p in distinct]))
    chain: list[tuple[float, ...]] = []
    for half in (distinct, distinct[::-1]):
        start = len(chain)
        for p in half:
            while len(chain) - start >= 2 and _turn(chain[-2], chain[-1], p) <= 1e-9 * span * span:
                chain.pop()
            chain.append(p)
        chain.pop()
    return np.array(chain)


def _turn(o: Any, a: Any, b: Any) -> float:
    return float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))


def _inside(p: FloatArray, polygon: FloatArray, reach: float) -> bool:
    """Whether a point lies in a convex polygon, on a segment or at a point, within a distance."""
    if len(polygon) == 1:
        return bool(np.linalg.norm(p - polygon[0]) <= reach)
    if len(polygon) == 2:
        along = polygon[1] - polygon[0]
        t = float(np.clip((p - polygon[0]) @ along / (along @ along), 0.0, 1.0))
        return bool(np.linalg.norm(p - polygon[0] - t * along) <= reach)
    edges = zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    return all(_turn(a, b, p) >= -reach * float(np.linalg.norm(b - a)) for a, b in edges)


def _crossings(a: FloatArray, b: FloatArray) -> list[FloatArray]:
    """Points where an edge of one polygon crosses an edge of the other."""
    found = []
    for p, q in _edges(a):
        for r, s in _edges(b):
            d, e = q - p, s - r
            cross = d[0] * e[1] - d[1] * e[0]
            if abs(cross) <= PARALLEL * float(np.linalg.norm(d) * np.linalg.norm(e)):
                continue
            w = r - p
            t, v = (w[0] * e[1] - w[1] * e[0]) / cross, (w[0] * d[1] - w[1] * d[0]) / cross
            if 0.0 <= t <= 1.0 and 0.0 <= v <= 1.0:
                found.append(p + t * d)
    return found


def _edges(polygon: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    if len(polygon) < 2:
        return []
    closed = zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    return list(closed)[: 1 if len(polygon) == 2 else None]
