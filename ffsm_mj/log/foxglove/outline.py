"""Edges of drawn shapes as ``foxglove.PointCloud``, for Rerun, which does not draw ``foxglove.SceneUpdate``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import mujoco
import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import DrawnShape
from ffsm_mj.log.foxglove.messages import timestamp

_SPACING_M = 0.01
_MOST_POINTS = 100_000
"""Greatest number of points on all edges of a body, and of each of its meshes; large bodies get a larger spacing."""
_NAMES = ("x", "y", "z", "red", "green", "blue", "alpha")
_POINT = np.dtype(list(zip(_NAMES, ["<f4"] * 3 + ["u1"] * 4, strict=True)))


def outline_cloud(shapes: Sequence[DrawnShape], frame_id: str, time_ns: int) -> PointCloud:
    """Edges of all shapes of one body, in its frame."""
    lines = [[] if shape.kind == "mesh" else _edges(shape) for shape in shapes]
    spacing = max(_SPACING_M, sum(_lengths(line)[-1] for edges in lines for line in edges) / _MOST_POINTS)
    clouds = []
    for shape, edges in zip(shapes, lines, strict=True):
        points = _placed(shape, np.vstack([_along(line, spacing) for line in edges]) if edges else _thinned(shape.vertices))
        cloud = np.empty(len(points), dtype=_POINT)
        for name, column in zip(_NAMES[:3], points.T, strict=True):
            cloud[name] = column
        for name, value in zip(_NAMES[3:], shape.rgba, strict=True):
            cloud[name] = round(255 * value)
        clouds.append(cloud)
    message = PointCloud(timestamp=timestamp(time_ns), frame_id=frame_id, point_stride=_POINT.itemsize)
    message.pose.position.SetInParent()  # some readers take a missing message as null
    message.pose.orientation.w = 1.0
    for offset, name in zip((0, 4, 8, 12, 13, 14, 15), _NAMES, strict=True):
        message.fields.add(
            name=name, offset=offset, type=PackedElementField.FLOAT32 if offset < 12 else PackedElementField.UINT8
        )
    message.data = np.concatenate(clouds).tobytes()
    return message


def _thinned(points: FloatArray) -> FloatArray:
    return points[:: -(-len(points) // _MOST_POINTS) or 1]


def _placed(shape: DrawnShape, local: FloatArray) -> FloatArray:
    """Transform points from the frame of the geom to that of the body, (n, 3), m."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, shape.quaternion)
    return np.asarray(local @ rotation.reshape(3, 3).T + shape.position)


def _edges(shape: DrawnShape) -> list[FloatArray]:
    """Edges as polylines in the frame of the geom; rings and meridians of round shapes."""
    a, b, c = shape.size
    if shape.kind == "box":
        corners = np.array(list(product((-1.0, 1.0), repeat=3))) * shape.size
        pairs = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
        return [corners[list(pair)] for pair in pairs]
    angle = np.linspace(0.0, 2 * np.pi, 65)
    x, y, nought = np.cos(angle), np.sin(angle), np.zeros(65)
    if shape.kind == "ellipsoid":
        rings = ((x, y, nought), (x, nought, y), (nought, x, y))
        return [np.column_stack(ring) * (a, b, c) for ring in rings]
    ends = [np.column_stack((a * x, a * y, np.full(65, z))) for z in (-b, b)]
    if shape.kind == "cylinder":
        sides = [np.array([[u, v, -b], [u, v, b]]) for u, v in ((a, 0), (-a, 0), (0, a), (0, -a))]
        return [*ends, *sides]
    halves = np.r_[0:33, 32:65, 0]  # upper and lower half circle, closed
    wide, high = a * x[halves], a * y[halves] + np.repeat((b, -b, b), (33, 33, 1))
    level = np.zeros(len(halves))
    return [*ends, np.column_stack((wide, level, high)), np.column_stack((level, wide, high))]


def _lengths(line: FloatArray) -> FloatArray:
    """Arc length of a polyline from its first point to each point, m."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))))


def _along(line: FloatArray, spacing: float) -> FloatArray:
    """Evenly spaced points along a polyline."""
    length = _lengths(line)
    at = np.linspace(0.0, length[-1], max(2, round(length[-1] / spacing)))
    return np.column_stack([np.interp(at, length, line[:, i]) for i in range(3)])
