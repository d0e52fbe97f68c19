"""Encoding of Foxglove's well-known messages, with the schemas of the package foxglove-schemas-protobuf.

Foxglove, Lichtblick and Rerun recognise them by schema name. Quaternions are xyzw here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.mcap.format import varint

ROOT_FRAME = "world"
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
