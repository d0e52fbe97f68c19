"""Chunks of an MCAP file: decompression with verified checksum, and their messages in batches of one channel and size."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

RECORD = struct.Struct("<BQ")  # opcode and length of what follows
_HEAD = struct.Struct("<QQQII")  # times of first and last message, size and checksum of the content, length of a name
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, two times
MESSAGE_HEAD = RECORD.size + _MESSAGE.size
_MOST_BYTES = 1 << 28
"""Greatest decompressed size of a chunk; ffsm-mj closes chunks at 1 MiB plus a block of rows."""

_MOST_PARTS = 100_000
"""Greatest number of batches of a chunk; ffsm-mj writes a few for each block of rows and each event."""


@dataclass(frozen=True)
class Batch:
    """Consecutive messages of one channel and one size in a chunk.

    Attributes:
        chunk: Start and end of the record of the chunk in the file.
        channel: Id of the channel.
        at: Position of the first record in the content of the chunk.
        size: Size of a record including its header, bytes.
        count: Number of messages.
        times_ns: Times of the first and of the last message.
    """

    chunk: tuple[int, int]
    channel: int
    at: int
    size: int
    count: int
    times_ns: tuple[int, int]

    def messages(self, content: bytes) -> npt.NDArray[np.uint8]:
        """The messages, (count, bytes of one), given the content of the chunk."""
        table = np.frombuffer(content, dtype=np.uint8, count=self.size * self.count, offset=self.at)
        return table.reshape(self.count, self.size)[:, MESSAGE_HEAD:]


def stated_size(record: bytes) -> int:
    """Decompressed size of a chunk as stated in its header; zero if it is too large to be decompressed.

    Raises:
        struct.error: The record is too short.
    """
    size = int(_HEAD.unpack_from(record, RECORD.size)[2])
    return size if size <= _MOST_BYTES else 0


def content_of(record: bytes) -> bytes:
    """Decompressed content of a chunk, given the bytes of its record.

    Raises:
        ValueError: The checksum does not match, the chunk is too large, or its compression is not supported.
        struct.error: The record is too short.
        zstandard.ZstdError: It cannot be decompressed.
    """
    at = RECORD.size + _HEAD.size
    *_, size, checksum, length = _HEAD.unpack_from(record, RECORD.size)
    compression, at = record[at : at + length], at + length
    (packed_size,) = struct.unpack_from("<Q", record, at)
    packed = record[at + 8 : at + 8 + packed_size]
    if compression not in {b"", b"zstd"} or size > _MOST_BYTES:
        raise ValueError("unsupported compression or size")
    # The decompressor allocates the size stated in the frame before it checks anything.
    if compression and zstandard.frame_content_size(packed) != size:
        raise ValueError("inconsistent sizes")
    content = zstandard.decompress(packed, max_output_size=size) if compression else packed
    if len(content) != size or (checksum and zlib.crc32(content) != checksum):
        raise ValueError("wrong checksum")
    return bytes(content)


def records_of(content: bytes, chunk: tuple[int, int]) -> Iterator[Batch | Channel | Schema]:
    """Records in the content of a chunk, in order.

    Raises:
        ValueError: A record extends beyond the content, or there are too many.
        struct.error: A record is cut off.
        mcap.exceptions.McapError: A channel or schema is damaged.
    """
    at = parts = 0
    while at < len(content):
        parts += 1
        if parts > _MOST_PARTS:
            raise ValueError("too many records")
        opcode, length = RECORD.unpack_from(content, at)
        size = RECORD.size + length
        if at + size > len(content):
            raise ValueError("a record extends beyond the chunk")
        count = 1
        if opcode == Opcode.MESSAGE:
            channel, _, first_ns, _ = _MESSAGE.unpack_from(content, at + RECORD.size)
            count = _equal_records(content, at, size)
            last_ns = _MESSAGE.unpack_from(content, at + size * (count - 1) + RECORD.size)[2]
            yield Batch(chunk, channel, at, size, count, (first_ns, last_ns))
        elif opcode in {Opcode.CHANNEL, Opcode.SCHEMA}:
            body = ReadDataStream(BytesIO(content[at + RECORD.size : at + size]))
            yield Channel.read(body) if opcode == Opcode.CHANNEL else Schema.read(body)
        at += size * count


def _equal_records(content: bytes, at: int, size: int) -> int:
    """Number of consecutive records with the opcode, length and channel of the first; searched with doubling steps."""
    head = np.frombuffer(content, dtype=np.uint8, count=RECORD.size + 2, offset=at)
    # A block of rows is thousands of equal records. Doubling the step compares them in few numpy calls without reading far
    # beyond the end of a short batch.
    count, step = 1, 1
    while True:
        step = min(2 * step, (len(content) - at) // size - count)
        table = np.frombuffer(content, dtype=np.uint8, count=step * size, offset=at + count * size).reshape(step, size)
        same = (table[:, : len(head)] == head).all(axis=1)
        if step == 0 or not same.all():
            return count + (int(np.argmin(same)) if step else 0)
        count += step
