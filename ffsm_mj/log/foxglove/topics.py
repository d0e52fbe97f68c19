"""Topics of ``run.mcap`` that viewers draw without configuration: frames, scene, marks, forces, plumes and text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.arrows import arrow_series, declared_arrows
from ffsm_mj.log.drawing import FramePicker, Frames, posed_bodies, shapes_by_body
from ffsm_mj.log.foxglove.messages import TransformsCodec, timestamp
from ffsm_mj.log.foxglove.outline import outline_cloud
from ffsm_mj.log.foxglove.scene import arrows_update, bodies_update, frame_id, marks_update, plumes_update, target_update
from ffsm_mj.log.marker_scale import marker_scale
from ffsm_mj.log.marks import MarkSequence, marks_topic
from ffsm_mj.log.mcap.format import nanoseconds
from ffsm_mj.log.plumes import thrusters
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.kinds import RecordKind, kind_of, kinds_of
from ffsm_mj.records.metadata import logged_task

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
            yield _packet(SCENE_TOPIC, first, bodies_update(self._system, self._drawn, self._target, self._scale, first))
            yield from self._outlines(first)
        if self._target_columns:
            for time, place in zip(times.tolist(), frames.rows[:, self._target_columns], strict=True):
                yield _packet(TARGET_TOPIC, time, target_update(place, self._scale, time))
        yield from self._arrow_updates(frames, times)
        if self._thrusters:
            yield from self._plume_updates(frames, times)

    def _outlines(self, time_ns: int) -> Iterator[Packet]:
        for body, drawn in self._drawn.items():
            frame = frame_id(self._system, body)
            yield _packet(outline_topic(self._system, body), time_ns, outline_cloud(drawn, frame, time_ns))

    def _arrow_updates(self, frames: Frames, times: npt.NDArray[np.int64]) -> Iterator[Packet]:
        """Arrows in every frame in which a force acts, and an empty update when the last one ends."""
        if not self._arrows:
            return
        series = [arrow_series(arrow, frames.rows, self._scale) for arrow in self._arrows]
        shown = np.asarray(np.any([each.acts for each in series], axis=0)).tolist()
        for i, (time, acts) in enumerate(zip(times.tolist(), shown, strict=True)):
            if acts or self._arrows_shown:
                self._arrows_shown = acts
                yield _packet(ARROWS_TOPIC, time, arrows_update(series, i, self._scale, time))

    def _plume_updates(self, frames: Frames, times: npt.NDArray[np.int64]) -> Iterator[Packet]:
        """Plumes when the set of firing thrusters changes; in every frame while one fires that does not turn with its body.

        An entity moves with the frame of its body. A plume of constant direction has no such frame, so its position is sent.
        """
        signs = np.sign(frames.rows[:, self._forces]).astype(int).tolist()
        for time, row, positions in zip(times.tolist(), signs, frames.positions, strict=True):
            firing = [(thruster, sign) for thruster, sign in zip(self._thrusters, row, strict=True) if sign]
            if row != self._signs or not all(thruster.turns for thruster, _ in firing):
                self._signs = row
                yield _packet(PLUMES_TOPIC, time, plumes_update(self._system, firing, positions, self._scale, time))

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
            marks = [(f"{name} {mark.number + 1}", mark) for mark in drawn]
            yield _packet(marks_topic(kind), time, marks_update(marks, self._scale, time))


def _packet(topic: str, time_ns: int, message: Any) -> Packet:
    data = np.frombuffer(message.SerializeToString(), dtype=np.uint8)
    return topic, np.array([time_ns]), data[None]
