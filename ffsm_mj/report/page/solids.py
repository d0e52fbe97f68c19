"""Triangle meshes of drawn shapes; all but boxes and meshes are surfaces of revolution about their z axis."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.log.drawing import DrawnShape

_AROUND, _ALONG = 40, 12
"""Number of edges per turn, and per quarter of a meridian."""
_ARROW = (
    [(0.0, 0.0), (0.035, 0.0)],
    [(0.035, 0.0), (0.035, 0.75)],
    [(0.035, 0.75), (0.09, 0.75)],
    [(0.09, 0.75), (0.0, 1.0)],
)
"""Meridians of an arrow of 1 m: end cap, shaft, back of the head, head."""

Triangles = tuple[FloatArray, npt.NDArray[np.int32]]
"""Vertices (n, 3) in m, and vertex indices of triangles, (m, 3), anticlockwise from outside."""


def triangles(shape: DrawnShape) -> Triangles:
    """Surface of a shape in the frame of its body; smooth faces share no vertices, so edges stay sharp."""
    if shape.kind == "mesh":
        corners, faces = shape.vertices, shape.triangles
    elif shape.kind == "box":
        corners, faces = _box(shape.size)
    else:
        corners, faces = joined([_revolved(profile) for profile in _profiles(shape)])
    if shape.kind == "ellipsoid":
        corners = corners * shape.size
    return corners @ rotation_matrix(shape.quaternion).T + shape.position, faces


def arrow_solid(scale: float) -> Triangles:
    """An arrow from the origin to 1 m up the z axis, its thickness at a scale of markers."""
    return joined([_revolved(np.array(line) * (scale, 1.0)) for line in _ARROW])


def plume_solid(scale: float) -> Triangles:
    """A cone that opens from the origin to 1 m up the z axis, its thickness at a scale of markers."""
    meridians = ([(0.02, 0.0), (0.14, 1.0)], [(0.14, 1.0), (0.0, 1.0)])
    return joined([_revolved(np.array(line) * (scale, 1.0)) for line in meridians])


def joined(parts: list[Triangles]) -> Triangles:
    """Concatenate several surfaces."""
    firsts = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    faces = [faces + first for (_, faces), first in zip(parts, firsts, strict=False)]
    return np.concatenate([corners for corners, _ in parts]), np.concatenate(faces).astype(np.int32)


def _box(half: FloatArray) -> Triangles:
    sides = []
    for axis in range(3):
        u, v, out = np.roll(np.eye(3), -axis, axis=0)  # u x v = out
        for sign in (1.0, -1.0):
            corners = [sign * out + a * sign * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            sides.append((np.array(corners) * half, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))
    return joined(sides)


def _profiles(shape: DrawnShape) -> list[FloatArray]:
    """Meridians from the lower to the upper end, (distance from the axis, height) each, (n, 2); one for each smooth face."""
    quarter = np.linspace(0.0, 0.5 * np.pi, _ALONG + 1)
    dome = np.column_stack((np.cos(quarter), np.sin(quarter)))
    bowl = dome[::-1] * (1.0, -1.0)
    radius, half_length = shape.size[:2]
    if shape.kind == "ellipsoid":
        return [np.vstack((bowl, dome[1:]))]
    if shape.kind == "capsule":
        return [np.vstack((bowl * radius - (0.0, half_length), dome * radius + (0.0, half_length)))]
    low, high = -half_length, half_length
    return [
        np.array(line) for line in ([(0, low), (radius, low)], [(radius, low), (radius, high)], [(radius, high), (0, high)])
    ]


def _revolved(profile: FloatArray) -> Triangles:
    angle = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    x, y = (profile[:, :1] * turn for turn in (np.cos(angle), np.sin(angle)))
    corners = np.stack((x, y, np.repeat(profile[:, 1:], _AROUND, axis=1)), axis=-1).reshape(-1, 3)
    ring, place = np.divmod(np.arange((len(profile) - 1) * _AROUND), _AROUND)
    a, b = ring * _AROUND + place, ring * _AROUND + (place + 1) % _AROUND
    faces = np.concatenate((np.column_stack((a, b, b + _AROUND)), np.column_stack((a, b + _AROUND, a + _AROUND))))
    return corners, faces.astype(np.int32)
