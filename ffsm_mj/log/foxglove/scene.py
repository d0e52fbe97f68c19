"""What Foxglove and Lichtblick draw, as ``foxglove.SceneUpdate``: bodies, the target, marks of records, forces and plumes.

Bodies are sent once, fixed to frames that ``foxglove.FrameTransforms`` moves. A viewer that jumps in time asks for the last
message of a topic, so each message states all that its topic shows from then on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.contact_forces import ForceColumns
from ffsm_mj.log.drawing import DrawnShape
from ffsm_mj.log.foxglove.messages import ROOT_FRAME, duration, timestamp
from ffsm_mj.log.instants import SHOWN_S
from ffsm_mj.model.system import System
from ffsm_mj.records.kinds import Mark

_ARROW_LENGTH_M = (0.3, 1.5)
_YELLOW, _FLAME = (0.94, 0.89, 0.26, 1.0), (0.9, 0.62, 0.1, 0.7)
_GREEN, _ORANGE = (0.0, 0.62, 0.45, 1.0), (0.9, 0.62, 0.0, 1.0)
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


def frame_id(system: System, body: int) -> str:
    """Frame of a body: its full name, ``robot/base``; that of the world is the root."""
    return str(system.mj.body(body).name) if body else ROOT_FRAME


def bodies_update(
    system: System, drawn: Mapping[int, Sequence[DrawnShape]], target_m: FloatArray | None, time_ns: int
) -> SceneUpdate:
    """All drawn geoms, one entity per body, and a cross where the tip is wanted."""
    update = SceneUpdate()
    for body, shapes in drawn.items():
        name = frame_id(system, body)
        entity = _entity(update, name, name, time_ns)
        for shape in shapes:
            _add_shape(entity, shape)
    if target_m is not None:
        cross = _entity(update, "target", ROOT_FRAME, time_ns)
        for axis in range(3):
            size = np.full(3, 0.024)
            size[axis] = 0.3
            cross.cubes.add(pose=_pose(target_m, _NO_TURN), size=_vector(size), color=_colour(_YELLOW))
    return update


def marks_update(marks: Sequence[tuple[str, Mark]], time_ns: int) -> SceneUpdate:
    """What records of one instant draw, for two seconds: an arrow or a dot, and a text; 1 m for a unit within limits.

    Args:
        marks: A unique name for each mark, and the mark.
        time_ns: When they are made.
    """
    update = SceneUpdate()
    for name, mark in marks:
        entity = _entity(update, name, ROOT_FRAME, time_ns)
        entity.lifetime.CopyFrom(duration(SHOWN_S))
        point, along = np.array(mark.point_m), np.array(mark.direction)
        if along.any():
            away = -(_add_arrow(entity, point, along, mark.magnitude) + 0.15) * along
        else:
            away = np.array([0.0, 0.0, 0.15])
            entity.spheres.add(pose=_pose(point, _NO_TURN), size=_vector(np.full(3, 0.1)), color=_colour(_YELLOW))
        entity.texts.add(
            pose=_pose(point + away, _NO_TURN),
            billboard=True,
            font_size=0.15,
            color=_colour(_YELLOW),
            text=mark.text,
        )
    return update


def _add_arrow(
    entity: Any, point: FloatArray, along: FloatArray, magnitude: float, rgba: tuple[float, ...] = _YELLOW
) -> float:
    """An arrow that ends at a point, where what it pushes does not hide it; returns its length, m."""
    length = float(np.clip(magnitude, *_ARROW_LENGTH_M))
    head = min(0.12, 0.4 * length)
    entity.arrows.add(
        pose=_pose(point - length * along, _turn(np.array([1.0, 0.0, 0.0]), along)),
        shaft_length=length - head,
        shaft_diameter=0.05,
        head_length=head,
        head_diameter=0.1,
        color=_colour(rgba),
    )
    return length


def forces_update(forces: Sequence[tuple[ForceColumns, FloatArray]], time_ns: int) -> SceneUpdate:
    """An arrow for every force and torque that acts, and none for the others: up to where it acts.

    Args:
        forces: Of each its columns, and a row.
        time_ns: When.
    """
    update = SceneUpdate()
    update.deletions.add(type=SceneEntityDeletion.ALL, timestamp=timestamp(time_ns))
    for pair, row in forces:
        force, point = row[pair.vector], row[pair.centre]
        size = float(np.linalg.norm(force))
        if size > 0.0:
            entity, colour = _entity(update, pair.pair, ROOT_FRAME, time_ns), _ORANGE if pair.turns else _GREEN
            _add_arrow(entity, point, force / size, size, colour)
    return update


def plumes_update(system: System, firing: list[tuple[int, int]], time_ns: int) -> SceneUpdate:
    """A cone at every thruster that fires, and none at the others.

    Args:
        system: The model.
        firing: Ids of the actuators that fire and the signs of their efforts.
        time_ns: When that begins.
    """
    model, update = system.mj, SceneUpdate()
    update.deletions.add(type=SceneEntityDeletion.ALL, timestamp=timestamp(time_ns))
    for actuator, sign in firing:
        site = int(model.actuator_trnid[actuator, 0])
        entity = _entity(update, model.actuator(actuator).name, frame_id(system, int(model.site_bodyid[site])), time_ns)
        exhaust = np.zeros(3)
        push = -sign * model.actuator_gear[actuator, :3]
        mujoco.mju_rotVecQuat(exhaust, push / np.linalg.norm(push), model.site_quat[site])
        pose = _pose(model.site_pos[site] + 0.15 * exhaust, _turn(np.array([0.0, 0.0, 1.0]), exhaust))
        size = _vector(np.array([0.16, 0.16, 0.3]))
        entity.cylinders.add(pose=pose, size=size, bottom_scale=0.2, top_scale=1.0, color=_colour(_FLAME))
    return update


def _entity(update: SceneUpdate, name: str, frame: str, time_ns: int) -> Any:
    entity: SceneEntity = update.entities.add(id=name, frame_id=frame, frame_locked=True)
    entity.timestamp.CopyFrom(timestamp(time_ns))
    return entity


def _add_shape(entity: Any, shape: DrawnShape) -> None:
    look = {"pose": _pose(shape.position, shape.quaternion), "color": _colour(shape.rgba)}
    radius, half_length = shape.size[:2]
    if shape.kind == "box":
        entity.cubes.add(size=_vector(2 * shape.size), **look)
    elif shape.kind == "ellipsoid":
        entity.spheres.add(size=_vector(2 * shape.size), **look)
    elif shape.kind == "mesh":
        mesh = entity.triangles.add(indices=shape.triangles.ravel().tolist(), **look)
        for x, y, z in shape.vertices.tolist():
            mesh.points.add(x=x, y=y, z=z)
    else:
        size = np.array([2 * radius, 2 * radius, 2 * half_length])
        entity.cylinders.add(size=_vector(size), bottom_scale=1.0, top_scale=1.0, **look)
        if shape.kind == "capsule":
            _add_caps(entity, shape)


def _add_caps(entity: Any, shape: DrawnShape) -> None:
    """Foxglove knows no capsule: a sphere at each end of the cylinder."""
    radius, half_length = shape.size[:2]
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, half_length]), shape.quaternion)
    for end in (shape.position - axis, shape.position + axis):
        size = _vector(np.full(3, 2 * radius))
        entity.spheres.add(pose=_pose(end, shape.quaternion), size=size, color=_colour(shape.rgba))


def _turn(start: FloatArray, end: FloatArray) -> FloatArray:
    """The shortest rotation of one unit vector onto another, wxyz."""
    half = start + end
    if half @ half < 1e-12:  # opposite: half a turn about any axis across
        across = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
        return np.concatenate(([0.0], across / np.linalg.norm(across)))
    half /= np.linalg.norm(half)
    return np.concatenate(([start @ half], np.cross(start, half)))


def _pose(position: FloatArray, wxyz: FloatArray) -> Pose:
    w, x, y, z = map(float, wxyz)
    return Pose(position=_vector(position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def _vector(values: FloatArray) -> Vector3:
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)


def _colour(rgba: tuple[float, ...]) -> Color:
    r, g, b, a = rgba
    return Color(r=r, g=g, b=b, a=a)
