"""The ``mcap`` writer, with blocks of messages of equal size written at once."""

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
    """An index of messages that is written at once."""

    def write(self, stream: RecordBuilder) -> None:
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(len(self.records) * 16)
        stream.write(np.array(self.records, dtype="<u8").tobytes())
        stream.finish_record()  # type: ignore[no-untyped-call]


class BlockWriter(Writer):
    """A writer that takes many messages of one channel in one call.

    ``Writer.add_message`` costs several microseconds of Python per message, more than the message's bytes. This does the
    same to the same chunk builder and statistics for a block: hence the look at private attributes, and the upper bound on
    ``mcap`` in pyproject.toml.
    """

    def add_block(self, channel: int, times_ns: npt.NDArray[np.int64], messages: npt.NDArray[np.uint8]) -> None:
        """Add messages, (n, bytes of one), that were logged at some times, (n,), in ascending order."""
        count, size = messages.shape
        records = np.empty((count, _HEADER.itemsize + size), dtype=np.uint8)
        header = np.zeros(count, dtype=_HEADER)
        header["opcode"], header["length"] = Opcode.MESSAGE, records.shape[1] - 9
        header["channel"], header["log_time"], header["publish_time"] = channel, times_ns, times_ns
        records[:, : _HEADER.itemsize] = header.view(np.uint8).reshape(count, -1)
        records[:, _HEADER.itemsize :] = messages
        self._account(channel, times_ns.tolist(), records.shape[1])
        self._chunk.record_writer.write(records.data)
        self._Writer__maybe_finalize_chunk()  # type: ignore[attr-defined]

    def continue_in(self, stream: BinaryIO) -> None:
        """Write to another stream from here on, one that holds what the first one does."""
        self._Writer__stream = stream

    @property
    def _chunk(self) -> Any:
        return self._Writer__chunk_builder  # type: ignore[attr-defined]

    def _account(self, channel: int, times: list[int], size: int) -> None:
        """Do the balance of the chunk and of the file."""
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
