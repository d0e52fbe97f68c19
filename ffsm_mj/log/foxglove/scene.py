"""Messages ``foxglove.SceneUpdate`` for Foxglove and Lichtblick: bodies, the target, marks of records, arrows and plumes.

Bodies are sent once, fixed to frames that ``foxglove.FrameTransforms`` moves. A viewer that jumps in time asks for the last
message of a topic, so each message contains everything that its topic shows from then on.
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
from ffsm_mj.log.arrows import ArrowSeries, arrow_colour
from ffsm_mj.log.drawing import DrawnShape
from ffsm_mj.log.foxglove.messages import ROOT_FRAME, duration, timestamp
from ffsm_mj.log.marks import SHOWN_S, DrawnMark
from ffsm_mj.log.palette import MARK, ON_ANY_GROUND, PLUME, PLUME_OPACITY, shares
from ffsm_mj.log.plumes import Thruster
from ffsm_mj.model.system import System

_TARGET, _MARK, _PLUME = shares(ON_ANY_GROUND), shares(MARK), shares(PLUME, PLUME_OPACITY)
_PLUME_M = 0.3
"""Length of a plume at scale 1, whatever its force: a message is sent when it appears, not when the force changes."""
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


def frame_id(system: System, body: int) -> str:
    """Name of the frame of a body: its full name, such as ``robot/base``; ``world`` for the world."""
    return str(system.mj.body(body).name) if body else ROOT_FRAME


def bodies_update(
    system: System, drawn: Mapping[int, Sequence[DrawnShape]], target_m: FloatArray | None, scale: float, time_ns: int
) -> SceneUpdate:
    """All drawn geoms, one entity per body, and a cross at a target of the tip that stands still, at a scale of markers."""
    update = SceneUpdate()
    for body, shapes in drawn.items():
        name = frame_id(system, body)
        entity = _entity(update, name, name, time_ns)
        for shape in shapes:
            _add_shape(entity, shape)
    if target_m is not None:
        _add_cross(update, target_m, scale, time_ns)
    return update


def target_update(target_m: FloatArray, scale: float, time_ns: int) -> SceneUpdate:
    """A cross at a target that moves."""
    update = SceneUpdate()
    _add_cross(update, target_m, scale, time_ns)
    return update


def _add_cross(update: SceneUpdate, target_m: FloatArray, scale: float, time_ns: int) -> None:
    cross = _entity(update, "target", ROOT_FRAME, time_ns)
    for axis in range(3):
        size = np.full(3, 0.024 * scale)
        size[axis] = 0.3 * scale
        cross.cubes.add(pose=_pose(target_m, _NO_TURN), size=_vector(size), color=_colour(_TARGET))


def marks_update(marks: Sequence[tuple[str, DrawnMark]], scale: float, time_ns: int) -> SceneUpdate:
    """Marks of records of one instant, shown for two seconds: an arrow or a dot, and a text.

    Args:
        marks: A unique name for each mark, and the mark.
        scale: Scale of markers.
        time_ns: Time of the records.
    """
    update = SceneUpdate()
    for name, drawn in marks:
        entity = _entity(update, name, ROOT_FRAME, time_ns)
        entity.lifetime.CopyFrom(duration(SHOWN_S))
        point, vector = np.array(drawn.mark.point_m), drawn.vector
        if vector.any():
            _add_arrow(entity, point - vector, vector, _MARK, scale)
            away = -vector - 0.15 * scale * np.array(drawn.mark.direction)
        else:
            away = np.array([0.0, 0.0, 0.15 * scale])
            entity.spheres.add(pose=_pose(point, _NO_TURN), size=_vector(np.full(3, 0.1 * scale)), color=_colour(_MARK))
        entity.texts.add(
            pose=_pose(point + away, _NO_TURN),
            billboard=True,
            font_size=0.15 * scale,
            color=_colour(_MARK),
            text=drawn.mark.text,
        )
    return update


def _add_arrow(entity: Any, origin: FloatArray, vector: FloatArray, rgba: tuple[float, ...], scale: float) -> None:
    length = float(np.linalg.norm(vector))
    head = min(0.12 * scale, 0.4 * length)
    entity.arrows.add(
        pose=_pose(origin, _turn(np.array([1.0, 0.0, 0.0]), vector / length)),
        shaft_length=length - head,
        shaft_diameter=0.05 * scale,
        head_length=head,
        head_diameter=0.1 * scale,
        color=_colour(rgba),
    )


def arrows_update(arrows: Sequence[ArrowSeries], row: int, scale: float, time_ns: int) -> SceneUpdate:
    """The arrows of forces and torques that act in a row, and no others.

    Args:
        arrows: All arrows of the run.
        row: Index of the row in these series.
        scale: Scale of markers.
        time_ns: Time of the row.
    """
    update = SceneUpdate()
    update.deletions.add(type=SceneEntityDeletion.ALL, timestamp=timestamp(time_ns))
    for series in arrows:
        if series.acts[row]:
            entity = _entity(update, series.columns.name, ROOT_FRAME, time_ns)
            rgba = shares(arrow_colour(series.columns))
            _add_arrow(entity, series.origins[row], series.vectors[row], rgba, scale)
    return update


def plumes_update(
    system: System, firing: Sequence[tuple[Thruster, int]], positions: FloatArray, scale: float, time_ns: int
) -> SceneUpdate:
    """A cone at every thruster that fires, and no others.

    Args:
        system: The model.
        firing: Thrusters that fire and the signs of their forces.
        positions: World positions of all bodies, (nbody, 3), m.
        scale: Scale of markers.
        time_ns: Time from which they fire.
    """
    update = SceneUpdate()
    update.deletions.add(type=SceneEntityDeletion.ALL, timestamp=timestamp(time_ns))
    for thruster, sign in firing:
        frame = frame_id(system, thruster.body) if thruster.turns else ROOT_FRAME
        start = thruster.point if thruster.turns else positions[thruster.body]
        entity, exhaust = _entity(update, thruster.name, frame, time_ns), sign * thruster.exhaust
        pose = _pose(start + 0.5 * scale * _PLUME_M * exhaust, _turn(np.array([0.0, 0.0, 1.0]), exhaust))
        size = _vector(scale * np.array([0.16, 0.16, _PLUME_M]))
        entity.cylinders.add(pose=pose, size=size, bottom_scale=0.2, top_scale=1.0, color=_colour(_PLUME))
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
    """Add a sphere at each end of the cylinder: Foxglove has no capsule."""
    radius, half_length = shape.size[:2]
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, half_length]), shape.quaternion)
    for end in (shape.position - axis, shape.position + axis):
        size = _vector(np.full(3, 2 * radius))
        entity.spheres.add(pose=_pose(end, shape.quaternion), size=size, color=_colour(shape.rgba))


def _turn(start: FloatArray, end: FloatArray) -> FloatArray:
    """Shortest rotation of one unit vector onto another, as quaternion wxyz."""
    half = start + end
    if half @ half < 1e-12:  # opposite vectors: half a turn about any perpendicular axis
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
