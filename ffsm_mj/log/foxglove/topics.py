"""The topics of ``run.mcap`` that viewers draw without set-up: frames, scene, marks of records, forces, plumes and text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.contact_forces import force_columns
from ffsm_mj.log.drawing import FramePicker, Frames, posed_bodies, shapes_by_body
from ffsm_mj.log.foxglove.messages import TransformsCodec, timestamp
from ffsm_mj.log.foxglove.outline import outline_cloud
from ffsm_mj.log.foxglove.scene import bodies_update, forces_update, frame_id, marks_update, plumes_update
from ffsm_mj.log.instants import MarkGroups, marks_topic
from ffsm_mj.log.wire import nanoseconds
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.facts import logged_task
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.kinds import RecordKind, kind_of, kinds_of
from ffsm_mj.records.signals import effort_key

TRANSFORMS_TOPIC = "/tf"
SCENE_TOPIC = "/scene"
PLUMES_TOPIC = "/scene/plumes"
FORCES_TOPIC = "/scene/contacts"
OUTLINE_TOPIC = "/outline"
LOG_TOPIC = "/log"


def viewer_topics(kinds: Sequence[RecordKind]) -> dict[str, Any]:
    """Message class of every topic but the outlines, in the order of the file, where a run has records of some kinds."""
    return {
        TRANSFORMS_TOPIC: FrameTransforms,
        SCENE_TOPIC: SceneUpdate,
        **{marks_topic(kind): SceneUpdate for kind in kinds if kind.marks is not None},
        FORCES_TOPIC: SceneUpdate,
        PLUMES_TOPIC: SceneUpdate,
        LOG_TOPIC: Log,
    }


def outline_topic(system: System, body: int) -> str:
    """Topic of the outline of a body: Rerun keeps one frame per topic."""
    return f"{OUTLINE_TOPIC}/{frame_id(system, body)}"


Packet = tuple[str, npt.NDArray[np.int64], npt.NDArray[np.uint8]]
"""Topic, times in ns (n,), messages (n, bytes of one)."""


class ViewerTopics:
    """Turns rows and events into messages for viewers."""

    def __init__(self, system: System, view_rate_hz: float) -> None:
        """Prepare for a model and a number of frames per simulated second."""
        self._system, self._view_rate_hz = system, view_rate_hz
        bodies = posed_bodies(system)
        self._codec = TransformsCodec(bodies, [frame_id(system, body) for body in bodies])
        self._thrusters = _thrusters(system)
        self._drawn = shapes_by_body(system)
        self._firing: list[tuple[int, int]] = []
        self._instants = MarkGroups()
        self._begun = self._pressing = False

    @property
    def topics(self) -> dict[str, Any]:
        """Message class of every topic, once the run is open."""
        return viewer_topics(self._kinds) | {outline_topic(self._system, body): PointCloud for body in self._drawn}

    def open(self, header: RunHeader) -> None:
        """Learn the columns of the rows, the kinds of records and the task."""
        task = logged_task(header.facts)
        self._kinds = kinds_of(header.kinds)
        self._target = task.point_m if task is not None else None
        self._picker = FramePicker(self._system, header.layout, self._view_rate_hz)
        self._forces = force_columns(header.layout)
        names = self._system.names("actuator")
        self._efforts = header.layout.places(effort_key(header.layout, names[i], "applied") for i in self._thrusters)

    def rows(self, block: FloatArray) -> Iterator[Packet]:
        """Frames of a block, the scene after the first of them, forces while any press, plumes where they change."""
        frames = self._picker.pick(block)
        if frames is None:
            return
        times = np.rint(frames.times * 1e9).astype(np.int64)
        yield TRANSFORMS_TOPIC, times, self._codec.encode(frames, times)
        if not self._begun:
            self._begun = True
            first = int(times[0])
            yield _packet(SCENE_TOPIC, first, bodies_update(self._system, self._drawn, self._target, first))
            yield from self._outlines(first)
        yield from self._arrows(frames, times)
        if self._thrusters:
            yield from self._plumes(frames, times)

    def _outlines(self, time_ns: int) -> Iterator[Packet]:
        for body, drawn in self._drawn.items():
            frame = frame_id(self._system, body)
            yield _packet(outline_topic(self._system, body), time_ns, outline_cloud(drawn, frame, time_ns))

    def _arrows(self, frames: Frames, times: npt.NDArray[np.int64]) -> Iterator[Packet]:
        """Forces of the contacts that press and the load on what is held, and once nothing where they cease to act."""
        rows, pressing = frames.rows, [pair.pressing(frames.rows) for pair in self._forces]
        for i in range(len(rows)) if self._pressing or any(map(np.any, pressing)) else ():
            at = [pair for pair, presses in zip(self._forces, pressing, strict=True) if presses[i]]
            if at or self._pressing:
                yield _packet(FORCES_TOPIC, int(times[i]), forces_update([(pair, rows[i]) for pair in at], int(times[i])))
            self._pressing = bool(at)

    def _plumes(self, frames: Frames, times: npt.NDArray[np.int64]) -> Iterator[Packet]:
        signs = np.sign(frames.rows[:, self._efforts]).astype(int)
        for time, row in zip(times.tolist(), signs.tolist(), strict=True):
            firing = [(actuator, sign) for actuator, sign in zip(self._thrusters, row, strict=True) if sign]
            if firing != self._firing:
                self._firing = firing
                yield _packet(PLUMES_TOPIC, time, plumes_update(self._system, firing, time))

    def event(self, event: Event | OutcomeRecord) -> Iterator[Packet]:
        """An event in words, and its marks beside all others of that instant."""
        kind = kind_of(event)
        time = nanoseconds(kind.time(event))
        level, text = Log.WARNING if kind.warning(event) else Log.INFO, kind.sentence(event)
        yield _packet(LOG_TOPIC, time, Log(timestamp=timestamp(time), level=level, message=text, name="ffsm"))
        drawn = self._instants.add(event)
        if drawn is not None:
            instant, _ = drawn
            name = f"{kind.name.replace('_', ' ')} {instant.number + 1}, contact"
            marks = [(f"{name} {i}", mark) for i, mark in enumerate(instant.marks, 1)]
            yield _packet(marks_topic(kind), time, marks_update(marks, time))


def _thrusters(system: System) -> list[int]:
    """Ids of the actuators that push at a site."""
    model = system.mj
    at_site = model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE
    return [int(i) for i in np.flatnonzero(at_site) if np.any(model.actuator_gear[i, :3])]


def _packet(topic: str, time_ns: int, message: Any) -> Packet:
    data = np.frombuffer(message.SerializeToString(), dtype=np.uint8)
    return topic, np.array([time_ns]), data[None]
