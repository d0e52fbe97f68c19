"""Writer of the package ``mcap``, extended by blocks of messages of equal size."""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import Writer

_HEADER = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)


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
        records = np.empty((count, _HEADER.itemsize + size), dtype=np.uint8)
        header = np.zeros(count, dtype=_HEADER)
        header["opcode"], header["length"] = Opcode.MESSAGE, records.shape[1] - 9
        header["channel"], header["log_time"], header["publish_time"] = channel, times_ns, times_ns
        records[:, : _HEADER.itemsize] = header.view(np.uint8).reshape(count, -1)
        records[:, _HEADER.itemsize :] = messages
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
