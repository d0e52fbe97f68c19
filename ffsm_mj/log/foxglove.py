"""Topics of ``run.mcap`` that viewers draw without configuration: frames, scene, marks, forces, plumes and text.

Their schemas are those of the package foxglove-schemas-protobuf; viewers recognise them by name. Bodies
are sent once, fixed to frames that ``foxglove.FrameTransforms`` moves. A viewer that jumps in time asks for the last message
of a topic, so each message contains everything that its topic shows from then on. Rerun does not draw
``foxglove.SceneUpdate``: it gets the edges of the bodies as ``foxglove.PointCloud``. Quaternions are xyzw in messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.log import limits
from ffsm_mj.log.drawing import (
    DrawnShape,
    FramePicker,
    Frames,
    marker_scale,
    posed_bodies,
    rotated,
    shapes_by_body,
)
from ffsm_mj.log.markers import (
    SHOWN_S,
    DrawnMark,
    MarkSequence,
    arrow_colour,
    arrow_series,
    declared_arrows,
    marks_topic,
    thrusters,
)
from ffsm_mj.log.mcap.format import nanoseconds, varint
from ffsm_mj.log.palette import MARK, ON_ANY_GROUND, PLUME, PLUME_OPACITY, shares
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.kinds import RecordKind, kind_of, kinds_of
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.records.run_log import RunHeader

ROOT_FRAME = "world"
TRANSFORMS_TOPIC = "/tf"
SCENE_TOPIC = "/scene"
TARGET_TOPIC = "/scene/target"
PLUMES_TOPIC = "/scene/plumes"
ARROWS_TOPIC = "/scene/contacts"
OUTLINE_TOPIC = "/outline"
LOG_TOPIC = "/log"


def viewer_topics(kinds: Sequence[RecordKind]) -> dict[str, Any]:
    """Message class of every topic but the outlines, in the order of the file, for a run with records of some kinds."""
    return {
        TRANSFORMS_TOPIC: FrameTransforms,
        SCENE_TOPIC: SceneUpdate,
        **{marks_topic(kind): SceneUpdate for kind in kinds if kind.marks is not None},
        ARROWS_TOPIC: SceneUpdate,
        PLUMES_TOPIC: SceneUpdate,
        LOG_TOPIC: Log,
    }


def outline_topic(system: System, body: int) -> str:
    """Topic of the outline of a body: Rerun accepts one frame per topic."""
    return f"{OUTLINE_TOPIC}/{frame_id(system, body)}"


Packet = tuple[str, npt.NDArray[np.int64], npt.NDArray[np.uint8]]
"""Topic, times in ns (n,), and messages of equal size (n, bytes of one)."""


class ViewerTopics:
    """Converts rows and events to messages for viewers."""

    def __init__(self, system: System, view_rate_hz: float) -> None:
        """Prepare for a model and a number of frames per simulated second."""
        self._system, self._view_rate_hz = system, view_rate_hz
        bodies = posed_bodies(system)
        self._codec = TransformsCodec(bodies, [frame_id(system, body) for body in bodies])
        self._drawn = shapes_by_body(system)
        self._scale = marker_scale(system)
        self._marks = MarkSequence(self._scale)
        self._begun = self._arrows_shown = False

    @property
    def topics(self) -> dict[str, Any]:
        """Message class of every topic; valid after :meth:`open`."""
        moving = {TARGET_TOPIC: SceneUpdate} if self._target_columns else {}
        return viewer_topics(self._kinds) | moving | {outline_topic(self._system, body): PointCloud for body in self._drawn}

    def open(self, header: RunHeader) -> None:
        """Take the columns of the rows, the kinds of records and the task from the header of the run."""
        task = logged_task(header.metadata)
        self._kinds = kinds_of(header.kinds)
        self._target_columns = task.moving_columns(header.layout) if task is not None else []
        self._target = task.point_m if task is not None and not self._target_columns else None
        self._picker = FramePicker(self._system, header.layout, self._view_rate_hz)
        self._arrows = declared_arrows(header)
        self._thrusters = thrusters(self._system, header.layout)
        self._forces = [thruster.applied for thruster in self._thrusters]
        self._signs = [0] * len(self._thrusters)

    def rows(self, block: FloatArray) -> Iterator[Packet]:
        """Frames of a block, the scene after the first one, arrows while any force acts, plumes when they change."""
        frames = self._picker.pick(block)
        if frames is None:
            return
        times = np.rint(frames.times * 1e9).astype(np.int64)
        yield TRANSFORMS_TOPIC, times, self._codec.encode(frames, times)
        if not self._begun:
            self._begun = True
            first = int(times[0])
            yield from self._bodies(first)
        if self._target_columns:
            for time, place in zip(times.tolist(), frames.rows[:, self._target_columns], strict=True):
                update = _Update(self._scale, time)
                update.add_cross(place)
                yield update.packet(TARGET_TOPIC)
        yield from self._arrow_updates(frames, times)
        if self._thrusters:
            yield from self._plume_updates(frames, times)

    def _bodies(self, time_ns: int) -> Iterator[Packet]:
        """All drawn geoms, one entity per body, with a cross at a target that stands still; then their outlines."""
        update = _Update(self._scale, time_ns)
        for body, shapes in self._drawn.items():
            name = frame_id(self._system, body)
            entity = update.entity(name, name)
            for shape in shapes:
                _add_shape(entity, shape)
        if self._target is not None:
            update.add_cross(self._target)
        yield update.packet(SCENE_TOPIC)
        for body, shapes in self._drawn.items():
            cloud = outline_cloud(shapes, frame_id(self._system, body), time_ns)
            yield _packet(outline_topic(self._system, body), time_ns, cloud)

    def _arrow_updates(self, frames: Frames, times: npt.NDArray[np.int64]) -> Iterator[Packet]:
        """Arrows in every frame in which a force acts, and an empty update when the last one ends."""
        if not self._arrows:
            return
        series = [arrow_series(arrow, frames.rows, self._scale) for arrow in self._arrows]
        shown = np.asarray(np.any([part.acts for part in series], axis=0)).tolist()
        for i, (time, acts) in enumerate(zip(times.tolist(), shown, strict=True)):
            if acts or self._arrows_shown:
                self._arrows_shown = acts
                update = _Update(self._scale, time, replaces=True)
                for arrow in series:
                    if arrow.acts[i]:
                        entity, rgba = update.entity(arrow.columns.name), shares(arrow_colour(arrow.columns))
                        update.add_arrow(entity, arrow.origins[i], arrow.vectors[i], rgba)
                yield update.packet(ARROWS_TOPIC)

    def _plume_updates(self, frames: Frames, times: npt.NDArray[np.int64]) -> Iterator[Packet]:
        """Plumes when the set of firing thrusters changes; in every frame while one fires that does not turn with its body.

        An entity moves with the frame of its body. A plume of constant direction has no such frame, so its position is sent.
        """
        signs = np.sign(frames.rows[:, self._forces]).astype(int).tolist()
        for time, row, positions in zip(times.tolist(), signs, frames.positions, strict=True):
            firing = [(thruster, sign) for thruster, sign in zip(self._thrusters, row, strict=True) if sign]
            if row != self._signs or not all(thruster.turns for thruster, _ in firing):
                self._signs = row
                update = _Update(self._scale, time, replaces=True)
                for thruster, sign in firing:
                    frame = frame_id(self._system, thruster.body) if thruster.turns else ROOT_FRAME
                    start = thruster.point if thruster.turns else positions[thruster.body]
                    update.add_plume(update.entity(thruster.name, frame), start, sign * thruster.exhaust)
                yield update.packet(PLUMES_TOPIC)

    def event(self, event: Event | OutcomeRecord) -> Iterator[Packet]:
        """Text of an event, and its marks together with the earlier ones of that instant."""
        kind = kind_of(event)
        time = nanoseconds(kind.time(event))
        level, text = Log.WARNING if kind.warning(event) else Log.INFO, kind.sentence(event)
        yield _packet(LOG_TOPIC, time, Log(timestamp=timestamp(time), level=level, message=text, name="ffsm"))
        if self._marks.add(event):
            # Viewers that jump in time get the last message only: it repeats the earlier marks of the instant.
            drawn = self._marks.of_instant(kind)
            name = f"{kind.name.replace('_', ' ')} {drawn[0].instant + 1}, contact"
            update = _Update(self._scale, time)
            for mark in drawn:
                update.add_mark(update.entity(f"{name} {mark.number + 1}"), mark)
            yield update.packet(marks_topic(kind))


def _packet(topic: str, time_ns: int, message: Any) -> Packet:
    data = np.frombuffer(message.SerializeToString(), dtype=np.uint8)
    return topic, np.array([time_ns]), data[None]


_TARGET, _MARK, _PLUME = shares(ON_ANY_GROUND), shares(MARK), shares(PLUME, PLUME_OPACITY)
_PLUME_M = 0.3
"""Length of a plume at scale 1, whatever its force: a message is sent when it appears, not when the force changes."""
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


def frame_id(system: System, body: int) -> str:
    """Name of the frame of a body: its full name, such as ``robot/base``; ``world`` for the world."""
    return str(system.mj.body(body).name) if body else ROOT_FRAME


class _Update:
    """A ``foxglove.SceneUpdate`` at a time, with markers at their scale."""

    def __init__(self, scale: float, time_ns: int, *, replaces: bool = False) -> None:
        """Start without entities; with ``replaces`` those of the earlier messages of the topic are removed."""
        self._scale, self._time_ns, self._message = scale, time_ns, SceneUpdate()
        if replaces:
            self._message.deletions.add(type=SceneEntityDeletion.ALL, timestamp=timestamp(time_ns))

    def packet(self, topic: str) -> Packet:
        """The message on a topic."""
        return _packet(topic, self._time_ns, self._message)

    def entity(self, name: str, frame: str = ROOT_FRAME) -> Any:
        """Add an entity, which is fixed to a frame."""
        entity: SceneEntity = self._message.entities.add(id=name, frame_id=frame, frame_locked=True)
        entity.timestamp.CopyFrom(timestamp(self._time_ns))
        return entity

    def add_cross(self, target_m: FloatArray) -> None:
        """Add a cross at the target of the tip."""
        cross = self.entity("target")
        for axis in range(3):
            size = np.full(3, 0.024 * self._scale)
            size[axis] = 0.3 * self._scale
            cross.cubes.add(pose=_pose(target_m, _NO_TURN), size=_vector(size), color=_colour(_TARGET))

    def add_mark(self, entity: Any, drawn: DrawnMark) -> None:
        """Add a mark of a record, shown for two seconds: an arrow or a dot, and a text."""
        scale, point, vector = self._scale, np.array(drawn.mark.point_m), drawn.vector
        entity.lifetime.CopyFrom(duration(SHOWN_S))
        if vector.any():
            self.add_arrow(entity, point - vector, vector, _MARK)
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

    def add_arrow(self, entity: Any, origin: FloatArray, vector: FloatArray, rgba: tuple[float, ...]) -> None:
        """Add an arrow of a vector that starts at a point."""
        length = float(np.linalg.norm(vector))
        head = min(0.12 * self._scale, 0.4 * length)
        entity.arrows.add(
            pose=_pose(origin, _turn(np.array([1.0, 0.0, 0.0]), vector / length)),
            shaft_length=length - head,
            shaft_diameter=0.05 * self._scale,
            head_length=head,
            head_diameter=0.1 * self._scale,
            color=_colour(rgba),
        )

    def add_plume(self, entity: Any, start: FloatArray, exhaust: FloatArray) -> None:
        """Add a cone at a thruster, along the unit vector of its exhaust."""
        pose = _pose(start + 0.5 * self._scale * _PLUME_M * exhaust, _turn(np.array([0.0, 0.0, 1.0]), exhaust))
        size = _vector(self._scale * np.array([0.16, 0.16, _PLUME_M]))
        entity.cylinders.add(pose=pose, size=size, bottom_scale=0.2, top_scale=1.0, color=_colour(_PLUME))


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
    axis = rotated(np.array([0.0, 0.0, half_length]), shape.quaternion)
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


_SPACING_M = 0.01
_NAMES = ("x", "y", "z", "red", "green", "blue", "alpha")
_POINT = np.dtype(list(zip(_NAMES, ["<f4"] * 3 + ["u1"] * 4, strict=True)))


def outline_cloud(shapes: Sequence[DrawnShape], frame_id: str, time_ns: int) -> PointCloud:
    """Edges of all shapes of one body, in its frame."""
    lines = [[] if shape.kind == "mesh" else _edges(shape) for shape in shapes]
    spacing = max(_SPACING_M, sum(_lengths(line)[-1] for edges in lines for line in edges) / limits.OUTLINE_POINTS)
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
    return points[:: -(-len(points) // limits.OUTLINE_POINTS) or 1]


def _placed(shape: DrawnShape, local: FloatArray) -> FloatArray:
    """Transform points from the frame of the geom to that of the body, (n, 3), m."""
    return np.asarray(local @ rotation_matrix(shape.quaternion).T + shape.position)


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


_NS = 1_000_000_000
_VARINT = 5  # bytes of a padded varint


def descriptor_set(message: Any) -> bytes:
    """FileDescriptorSet of a message class and all its dependencies, including Google's timestamp and duration."""
    files: dict[str, FileDescriptorProto] = {}

    def collect(file: Any) -> None:
        if file.name not in files:
            for dependency in file.dependencies:
                collect(dependency)
            files[file.name] = FileDescriptorProto()
            file.CopyToProto(files[file.name])

    collect(message.DESCRIPTOR.file)
    return FileDescriptorSet(file=files.values()).SerializeToString()


def timestamp(time_ns: int) -> Timestamp:
    """Simulation time as a protobuf timestamp."""
    return Timestamp(seconds=time_ns // _NS, nanos=time_ns % _NS)


def duration(seconds: float) -> Duration:
    """A duration in s as a protobuf duration."""
    return Duration(seconds=int(seconds), nanos=round((seconds % 1.0) * _NS))


class TransformsCodec:
    """Encodes many ``foxglove.FrameTransforms`` messages at once.

    Messages differ in times and poses only. Protobuf accepts varints that are padded with empty groups: seconds and
    nanoseconds take five bytes each, and every value has a fixed offset in a constant template.
    """

    def __init__(self, bodies: Sequence[int], frame_ids: Sequence[str]) -> None:
        """Build the template for some bodies and the ids of their frames."""
        self._bodies = list(bodies)
        template = bytearray()
        stamps, values = [], []
        for frame_id in frame_ids:
            body = _STAMP + _field(2, ROOT_FRAME.encode()) + _field(3, frame_id.encode()) + _TRANSLATION + _ROTATION
            transform = _field(1, body)
            start, end = len(template) + len(transform) - len(body), len(template) + len(transform)
            template += transform
            stamps.append(start + 2)
            values += [end - len(_ROTATION) - len(_TRANSLATION) + 3 + 9 * i for i in range(3)]
            values += [end - len(_ROTATION) + 3 + 9 * i for i in range(4)]
        self._template = np.frombuffer(bytes(template), dtype=np.uint8)
        self._seconds = np.array(stamps)[:, None] + 1 + np.arange(_VARINT)
        self._nanos = self._seconds + _VARINT + 1
        self._values = np.array(values)[:, None] + np.arange(8)

    def encode(self, frames: Frames, times_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        """One message per frame, (n, bytes of one)."""
        out = np.tile(self._template, (len(times_ns), 1))
        out[:, self._seconds] = _padded_varints(times_ns // _NS)[:, None]
        out[:, self._nanos] = _padded_varints(times_ns % _NS)[:, None]
        poses = np.concatenate(
            (frames.positions[:, self._bodies], np.roll(frames.quaternions[:, self._bodies], -1, axis=-1)), axis=2
        )
        out[:, self._values] = np.ascontiguousarray(poses, dtype="<f8").view(np.uint8).reshape(len(out), -1, 8)
        return out


def _padded_varints(numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    """Numbers below 2^35 as varints of five bytes, (n, 5)."""
    groups = numbers[:, None] >> (7 * np.arange(_VARINT)) & 0x7F
    return (groups | [0x80] * (_VARINT - 1) + [0]).astype(np.uint8)


def _field(number: int, content: bytes) -> bytes:
    """A field of bytes, text or a nested message."""
    return varint(number << 3 | 2) + varint(len(content)) + content


def _doubles(count: int) -> bytes:
    """A message with fields 1 to ``count``, all double, present and zero."""
    return b"".join(varint(i << 3 | 1) + bytes(8) for i in range(1, count + 1))


# Parts of a FrameTransform: timestamp {1: seconds, 2: nanos}, translation {x, y, z} and rotation {x, y, z, w}.
_STAMP = _field(1, b"\x08" + bytes(_VARINT) + b"\x10" + bytes(_VARINT))
_TRANSLATION, _ROTATION = _field(4, _doubles(3)), _field(5, _doubles(4))
