"""Sink that writes the log of a run while it runs: ``run.mcap.partial``, readable after a kill."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Concatenate, ParamSpec

import numpy as np
import numpy.typing as npt
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import CompressionType, Writer

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import LogWriteError
from ffsm_mj.log.foxglove import Packet, ViewerTopics, descriptor_set
from ffsm_mj.log.mcap import format as form
from ffsm_mj.log.mcap.format import MESSAGE_HEAD, RECORD_HEAD, encode_record, nanoseconds, record_schema
from ffsm_mj.log.recorder import Sink
from ffsm_mj.log.run_folder import PartialFile
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.kinds import kind_of, kinds_of
from ffsm_mj.records.run_log import RunHeader


class _BlockIndex(MessageIndex):
    """Index of messages, serialised by numpy."""

    def write(self, stream: RecordBuilder) -> None:
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(len(self.records) * 16)
        stream.write(np.array(self.records, dtype="<u8").tobytes())
        stream.finish_record()  # type: ignore[no-untyped-call]


class BlockWriter(Writer):
    """Writer with a method for many messages of one channel.

    ``Writer.add_message`` takes several microseconds of Python per message, more than encoding it. :meth:`add_block` does
    the same to the chunk builder and the statistics of the writer, which are private: pyproject.toml therefore bounds the
    version of ``mcap``.
    """

    def add_block(self, channel: int, times_ns: npt.NDArray[np.int64], messages: npt.NDArray[np.uint8]) -> None:
        """Add messages, (n, bytes of one), with their log times in ascending order, (n,)."""
        count, size = messages.shape
        records = np.empty((count, MESSAGE_HEAD.itemsize + size), dtype=np.uint8)
        header = np.zeros(count, dtype=MESSAGE_HEAD)
        header["opcode"], header["length"] = Opcode.MESSAGE, records.shape[1] - RECORD_HEAD.size
        header["channel"], header["log_time"], header["publish_time"] = channel, times_ns, times_ns
        records[:, : MESSAGE_HEAD.itemsize] = header.view(np.uint8).reshape(count, -1)
        records[:, MESSAGE_HEAD.itemsize :] = messages
        self._count(channel, times_ns.tolist(), records.shape[1])
        self._chunk.record_writer.write(records.data)
        self._Writer__maybe_finalize_chunk()  # type: ignore[attr-defined]

    def continue_in(self, stream: BinaryIO) -> None:
        """Continue in another stream that already contains everything written so far."""
        self._Writer__stream = stream

    @property
    def _chunk(self) -> Any:
        return self._Writer__chunk_builder  # type: ignore[attr-defined]

    def _count(self, channel: int, times: list[int], size: int) -> None:
        """Update the index of the chunk and the statistics of the file."""
        chunk, statistics = self._chunk, self._Writer__statistics  # type: ignore[attr-defined]
        start = chunk.count
        index = chunk.message_indices.setdefault(channel, _BlockIndex(channel_id=channel, records=[]))
        index.records.extend(zip(times, range(start, start + len(times) * size, size), strict=True))
        first, last = times[0], times[-1]
        chunk.message_start_time = min(chunk.message_start_time, first) if chunk.num_messages else first
        chunk.message_end_time = max(chunk.message_end_time, last)
        chunk.num_messages += len(times)
        empty = statistics.message_count == 0
        statistics.message_start_time = first if empty else min(statistics.message_start_time, first)
        statistics.message_end_time = max(statistics.message_end_time, last)
        statistics.channel_message_counts[channel] += len(times)
        statistics.message_count += len(times)


_Arguments = ParamSpec("_Arguments")


def _writes(method: Callable[Concatenate[McapSink, _Arguments], None]) -> Callable[Concatenate[McapSink, _Arguments], None]:
    """Method that writes to a log: it does nothing after a write that failed."""

    @wraps(method)
    def writes(sink: McapSink, /, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> None:
        if not sink.is_broken:
            try:
                method(sink, *arguments, **named)
            except OSError as error:
                raise sink.break_off(error) from error

    return writes


_MEDIA_TYPES = {".yaml": "application/yaml", ".xml": "application/xml", ".urdf": "application/xml"}


class McapSink(Sink):
    """Writes one run to one file. The first write that fails raises; everything after it is ignored."""

    def __init__(self, take: Callable[[bytes], PartialFile], system: System, view_rate_hz: float) -> None:
        """Remember the destination; nothing is written yet.

        Args:
            take: Called to create the file, with its opening bytes.
            system: The system of the run.
            view_rate_hz: Frames for viewers per simulated second.
        """
        self._take = take
        self._file: PartialFile | None = None
        self._viewer = ViewerTopics(system, view_rate_hz)
        self.is_broken = False

    def open(self, header: RunHeader) -> None:
        """Write metadata, signals, scenario and models, which every readable log needs.

        They are collected in memory and written at once: a kill leaves no file, or one with all of them but the channels,
        which are in the first chunk. From its first flushed samples on it is readable.
        """
        self._viewer.open(header)
        self._codec = form.SampleCodec(header.layout)
        self._time_column = header.layout.index["state.time_s"]
        opening = BytesIO()
        self._writer = BlockWriter(opening, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start(profile="", library="ffsm-mj")
        self._writer.add_metadata(form.RUN_METADATA, dict(header.metadata))
        self._writer.add_metadata(form.SIGNALS_METADATA, form.signals_metadata(header.layout))
        self._attach(form.SCENARIO_ATTACHMENT, header.scenario_yaml.encode())
        for name, content in header.files.items():
            self._attach(name, content)
        self._register(header)
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file = self._take(opening.getvalue())
        self._writer.continue_in(self._file.stream)

    def _attach(self, name: str, content: bytes) -> None:
        media_type = _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
        self._writer.add_attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=content)

    def _register(self, header: RunHeader) -> None:
        # The metadata are also those of a channel: channels are in a chunk with a checksum, and again in the summary.
        self._channels = {
            form.SAMPLE_TOPIC: self._channel(
                form.SAMPLE_TOPIC, form.SAMPLE_SCHEMA, form.sample_schema(header.layout), dict(header.metadata)
            )
        }
        for kind in kinds_of(header.kinds):
            self._channels[kind.topic] = self._channel(kind.topic, kind.schema, record_schema(kind), {})
        schemas: dict[str, int] = {}
        for topic, message in self._viewer.topics.items():
            name = message.DESCRIPTOR.full_name
            if name not in schemas:
                schemas[name] = self._writer.register_schema(name, "protobuf", descriptor_set(message))
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schemas[name])

    def _channel(self, topic: str, name: str, schema: bytes, metadata: dict[str, str]) -> int:
        number = self._writer.register_schema(name, "protobuf", schema)
        return self._writer.register_channel(topic, "protobuf", number, metadata)

    @_writes
    def rows(self, block: FloatArray) -> None:
        """Write one sample per row, and the messages for viewers."""
        times = np.rint(block[:, self._time_column] * 1e9).astype(np.int64)
        self._put((form.SAMPLE_TOPIC, times, self._codec.encode(block)), *self._viewer.rows(block))

    @_writes
    def state(self, time_s: float, state: bytes) -> None:
        """Write a state of the simulation at its time; its channel is registered with the first one."""
        if form.STATE_TOPIC not in self._channels:
            self._channels[form.STATE_TOPIC] = self._writer.register_channel(form.STATE_TOPIC, form.STATE_ENCODING, 0)
        time = nanoseconds(time_s)
        self._writer.add_message(self._channels[form.STATE_TOPIC], log_time=time, data=state, publish_time=time)

    @_writes
    def event(self, event: Event) -> None:
        """Write an event at its time."""
        self._record(event)

    def _record(self, event: Event | OutcomeRecord) -> None:
        kind = kind_of(event)
        time, data = nanoseconds(kind.time(event)), encode_record(event)
        self._writer.add_message(self._channels[kind.topic], log_time=time, data=data, publish_time=time)
        self._put(*self._viewer.event(event))

    def _put(self, *packets: Packet) -> None:
        for topic, times, messages in packets:
            self._writer.add_block(self._channels[topic], times, messages)

    @_writes
    def flush(self) -> None:
        """Finish the chunk and pass everything to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    @_writes
    def close(self, outcome: OutcomeRecord | None) -> None:
        """Write the outcome, the index and the footer, and rename the file to its final name."""
        if self._file is None:
            return
        try:
            if outcome is not None:
                self._record(outcome)
        finally:  # if the outcome cannot be written, the file is complete except for it
            self._writer.finish()  # type: ignore[no-untyped-call]
            if outcome is not None:
                self._file.finish()
            else:
                self._file.stream.close()

    def break_off(self, error: OSError) -> LogWriteError:
        """Write nothing any more; returns the error that names the log.

        Everything flushed before remains readable; the reader skips an incomplete chunk at the end.
        """
        assert self._file is not None
        self.is_broken = True
        with suppress(OSError):
            self._file.stream.close()
        return LogWriteError(self._file.partial, error)
