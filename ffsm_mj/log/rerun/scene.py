"""Drawn geoms as shapes of a recording, each in the frame of its body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import DrawnShape, shapes
from ffsm_mj.log.palette import TARGET_ON_DARK
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import identifier


def body_path(system: System, body: int) -> str:
    """Entity of a body, such as ``world/robot/base``. They are not nested: all poses are in the world frame."""
    tree, _, name = system.mj.body(body).name.partition("/")
    return f"world/{identifier(tree)}/{identifier(name)}"


def log_shapes(recording: rr.RecordingStream, system: System) -> dict[int, str]:
    """Log every drawn geom once, in the frame of its body; returns the entity of the first one of each body."""
    first: dict[int, str] = {}
    for shape in shapes(system):
        parent = body_path(system, shape.body) if shape.body else "world/static"
        entity = f"{parent}/{identifier(shape.name)}"
        recording.log(entity, archetype(shape), static=True)
        first.setdefault(shape.body, entity)
    return first


def target_cross(point_m: FloatArray, name: str, scale: float) -> rr.LineStrips3D:
    """A small cross at a target, on a pole that carries its name above the motion, at a scale of markers."""
    x, y, z = scale * np.eye(3)
    arms = [[point_m, point_m + 0.6 * z], *([point_m - 0.2 * axis, point_m + 0.2 * axis] for axis in (x, y))]
    return rr.LineStrips3D(arms, colors=[TARGET_ON_DARK], radii=[0.02 * scale], labels=[name, "", ""], show_labels=True)


def archetype(shape: DrawnShape) -> Any:
    """A shape in the frame of its body."""
    colour = tuple(round(255 * c) for c in shape.rgba)
    if shape.kind != "mesh":
        return primitive(shape, colour)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, shape.quaternion)
    turn = rotation.reshape(3, 3)
    return rr.Mesh3D(  # without normals it would not be shaded
        vertex_positions=shape.vertices @ turn.T + shape.position,
        vertex_normals=shape.normals @ turn.T,
        triangle_indices=shape.triangles,
        albedo_factor=colour,
    )


def primitive(shape: DrawnShape, colour: Sequence[int], fill_mode: str = "solid") -> Any:
    """A shape in the frame of its body, solid or as a wireframe; the bounding box of a mesh.

    Args:
        shape: The shape.
        colour: Red, green, blue and opacity, each from 0 to 255.
        fill_mode: Fill mode of Rerun.
    """
    look: dict[str, Any] = {
        "quaternions": [np.roll(shape.quaternion, -1)],  # xyzw
        "colors": [colour],
        "fill_mode": fill_mode,
    }
    if shape.kind in ("box", "mesh"):
        size, centre = shape.size, shape.position
        if shape.kind == "mesh":
            low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
            offset = np.empty(3)
            mujoco.mju_rotVecQuat(offset, 0.5 * (low + high), shape.quaternion)
            size, centre = 0.5 * (high - low), shape.position + offset
        return rr.Boxes3D(half_sizes=[size], centers=[centre], **look)
    if shape.kind == "ellipsoid":
        return rr.Ellipsoids3D(half_sizes=[shape.size], centers=[shape.position], **look)
    radius, half_length = shape.size[:2]
    if shape.kind == "cylinder":
        return rr.Cylinders3D(lengths=[2 * half_length], radii=[radius], centers=[shape.position], **look)
    # A capsule of Rerun extends from its origin along +z; MuJoCo's is centred.
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, half_length]), shape.quaternion)
    return rr.Capsules3D(lengths=[2 * half_length], radii=[radius], translations=[shape.position - axis], **look)
