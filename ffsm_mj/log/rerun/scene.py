"""Drawn geoms as shapes of a recording, each in the frame of its body."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import rerun as rr

from ffsm_mj.log.drawing import DrawnShape, shapes
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import identifier


def body_path(system: System, body: int) -> str:
    """Entity of a body, such as ``world/robot/base``. They are not nested: all poses are in the world frame."""
    tree, _, name = system.mj.body(body).name.partition("/")
    return f"world/{identifier(tree)}/{identifier(name)}"


def log_shapes(recording: rr.RecordingStream, system: System) -> None:
    """Log every drawn geom once, in the frame of its body."""
    for shape in shapes(system):
        parent = body_path(system, shape.body) if shape.body else "world/static"
        recording.log(f"{parent}/{identifier(shape.name)}", _archetype(shape), static=True)


def _archetype(shape: DrawnShape) -> Any:
    colour = [round(255 * c) for c in shape.rgba]
    if shape.kind == "mesh":
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, shape.quaternion)
        vertices = shape.vertices @ rotation.reshape(3, 3).T + shape.position
        return rr.Mesh3D(vertex_positions=vertices, triangle_indices=shape.triangles, albedo_factor=colour)
    look: dict[str, Any] = {
        "quaternions": [np.roll(shape.quaternion, -1)],  # xyzw
        "colors": [colour],
        "fill_mode": "solid",
    }
    if shape.kind == "box":
        return rr.Boxes3D(half_sizes=[shape.size], centers=[shape.position], **look)
    if shape.kind == "ellipsoid":
        return rr.Ellipsoids3D(half_sizes=[shape.size], centers=[shape.position], **look)
    radius, half_length = shape.size[:2]
    if shape.kind == "cylinder":
        return rr.Cylinders3D(lengths=[2 * half_length], radii=[radius], centers=[shape.position], **look)
    # A capsule of Rerun extends from its origin along +z; MuJoCo's is centred.
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, half_length]), shape.quaternion)
    return rr.Capsules3D(lengths=[2 * half_length], radii=[radius], translations=[shape.position - axis], **look)
