"""Records of an MCAP file that are readable, even if the file is damaged or incomplete.

They are read by the package ``mcap``, one by one, so that a long file is never in memory. Chunks and attachments have
checksums: those that do not match are skipped. If the length of a record is wrong, reading continues at the next chunk.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from ffsm_mj.errors import LogError
from ffsm_mj.log import limits
from ffsm_mj.log.mcap.format import MESSAGE_HEAD, RECORD_HEAD

MAGIC = b"\x89MCAP0\r\n"
UNREADABLE = (
    *(McapError, zstandard.ZstdError, struct.error, StopIteration),
    *(ArithmeticError, LookupError, ValueError, MemoryError),
)
"""What reading damaged bytes may raise."""
_USED = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END}
# Bytes in every chunk that ffsm-mj writes, after opcode, length, two times, size and checksum.
_CHUNK_MARK, _CHUNK_MARK_AT = b"\x04\x00\x00\x00zstd", 9 + 8 + 8 + 8 + 4
_WINDOW = 1 << 20


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
        return table.reshape(self.count, self.size)[:, MESSAGE_HEAD.itemsize :]


@contextmanager
def opened(path: Path) -> Iterator[LogFile]:
    """Open a log.

    Raises:
        LogError: There is no such file, it cannot be read, or is not an MCAP file.
    """
    try:
        with path.open("rb") as stream:
            yield LogFile(path, stream)
    except OSError as error:
        raise LogError(path, f"cannot be read ({error.strerror})") from error


class LogFile:
    """The records of a file in one pass, up to its length at opening, and the content of its chunks.

    Attributes:
        size: Length of the file, bytes.
        lost_bytes: Number of unreadable bytes that are followed by readable ones.
        holes: Positions in the file of what is lost, its end included where it breaks off within a record.
        data_match: Whether the checksum of the data section matches; True before its end.
        index_match: Whether the index after the data section is intact.
    """

    def __init__(self, path: Path, stream: BinaryIO) -> None:
        """Start before the first record.

        Raises:
            LogError: It is not an MCAP file.
        """
        self._path, self._stream, self.size = path, stream, os.fstat(stream.fileno()).st_size
        self.lost_bytes = self._unpacked = 0
        self.holes: list[int] = []
        self.data_match, self.index_match = True, False
        if self._take(0, len(MAGIC)) != MAGIC:
            raise LogError(path, "not an MCAP file")

    def records(self) -> Iterator[Any]:
        """Records in the order of the file, including those inside chunks, and then schemas and channels of the summary.

        Messages are yielded as :class:`Batch`. Reading ends at a record that extends beyond the end of the file, where a
        kill or a full disk stopped the writer.

        Raises:
            LogError: The stated size of the chunks is too large for a file of this length.
        """
        at = len(MAGIC)
        while at < self.size:
            end = self._end(at)
            read = self._read(at, end) if end is not None else None
            if self._unpacked > max(limits.UNPACKED_BYTES, limits.UNPACKED_RATIO * self.size):
                raise LogError(self._path, f"its chunks contain {self._unpacked} bytes or more, too many for its length")
            if end is None or read is None:
                # A valid record after this one shows that its length is right: skip it. Otherwise the length may be damaged
                # too, and only the signature of a chunk gives the next position.
                following = end if end is not None and self._end(end) is not None else self._next_chunk(at + 1)
                self.holes.append(at)
                if following is None:
                    return
                self.lost_bytes += following - at
                at = following
                continue
            yield from read
            if self._opcode(at) == Opcode.DATA_END:
                yield from self._summary(at, end)
                return
            at = end

    def content(self, chunk: tuple[int, int]) -> bytes:
        """Decompressed content of the chunk at a position, with a verified checksum.

        Raises:
            ValueError: The checksum does not match, the chunk is too large, or its compression is not supported.
            mcap.exceptions.McapError, struct.error, zstandard.ZstdError: It is damaged.
        """
        return _unpacked(_record(self._take(*chunk)))

    def _take(self, start: int, stop: int) -> bytes:
        """Bytes from ``start`` to ``stop``, fewer at the end of the file."""
        self._stream.seek(start)
        return self._stream.read(max(0, min(stop, self.size) - start))

    def _opcode(self, at: int) -> int:
        return self._take(at, at + 1)[0]

    def _end(self, at: int) -> int | None:
        """End of the record at a position; None if there is no record or it extends beyond the file."""
        if at + RECORD_HEAD.size > self.size:
            return None
        opcode, length = RECORD_HEAD.unpack(self._take(at, at + RECORD_HEAD.size))
        end = at + RECORD_HEAD.size + int(length)
        return end if Opcode.HEADER <= opcode <= Opcode.DATA_END and end <= self.size else None

    def _read(self, at: int, end: int) -> list[Any] | None:
        """Content of a record; None if it is damaged."""
        opcode = self._opcode(at)
        if opcode not in _USED:
            return []
        data = self._take(at, min(end, at + limits.RECORD_BYTES))
        if opcode == Opcode.ATTACHMENT and zlib.crc32(data[RECORD_HEAD.size : -4]) != int.from_bytes(data[-4:], "little"):
            return None
        try:
            record = _record(data)
            if not isinstance(record, Chunk):
                return [record]
            self._unpacked += record.uncompressed_size if record.uncompressed_size <= limits.CHUNK_BYTES else 0
            return list(_records_in(_unpacked(record), (at, end)))
        except UNREADABLE:
            return None

    def _next_chunk(self, start: int) -> int | None:
        """Position at which the next chunk appears to start; None if there is none."""
        overlap = len(_CHUNK_MARK) - 1
        for window in range(start + _CHUNK_MARK_AT, self.size, _WINDOW):
            data, mark = self._take(window, window + _WINDOW + overlap), -1
            while (mark := data.find(_CHUNK_MARK, mark + 1)) >= 0:
                at = window + mark - _CHUNK_MARK_AT
                if self._opcode(at) == Opcode.CHUNK and self._end(at) is not None:
                    return at
        return None

    def _summary(self, data_end: int, start: int) -> Iterator[Any]:
        """Schemas and channels of the summary section, if its checksum matches; all bytes are read again for checksums."""
        stated = int.from_bytes(self._take(data_end + RECORD_HEAD.size, start), "little")
        self.data_match = stated in {0, self._checksum(0, data_end)}
        checksum = self.size - len(MAGIC) - 4
        self.index_match = self._take(checksum + 4, self.size) == MAGIC and (
            self._checksum(start, checksum) == int.from_bytes(self._take(checksum, checksum + 4), "little")
        )
        # Schemas and channels are repeated here: those of a damaged chunk are recovered.
        at = start
        while self.index_match and self._opcode(at) in {Opcode.SCHEMA, Opcode.CHANNEL}:
            end = self._end(at) or self.size
            yield from self._read(at, end) or []
            at = end

    def _checksum(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes from ``start`` to ``stop``."""
        checksum = 0
        for at in range(start, stop, _WINDOW):
            checksum = zlib.crc32(self._take(at, min(at + _WINDOW, stop)), checksum)
        return checksum


def _record(data: bytes) -> Any:
    """The record in some bytes."""
    return next(StreamReader(BytesIO(data), skip_magic=True, emit_chunks=True).records)


def _unpacked(chunk: Chunk) -> bytes:
    """Decompressed content of a chunk; see :meth:`LogFile.content`."""
    size = chunk.uncompressed_size
    if chunk.compression not in {"", "zstd"} or size > limits.CHUNK_BYTES:
        raise ValueError("unsupported compression or size")
    # The decompressor allocates the size stated in the frame before it checks anything.
    if chunk.compression and zstandard.frame_content_size(chunk.data) != size:
        raise ValueError("inconsistent sizes")
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    if length != size:
        raise ValueError("inconsistent sizes")
    return stream.read(size)


def _records_in(content: bytes, chunk: tuple[int, int]) -> Iterator[Batch | Channel | Schema]:
    """Records in the content of a chunk, in order.

    Raises:
        ValueError: A record extends beyond the content, or there are too many.
        struct.error: A record is cut off.
        mcap.exceptions.McapError: A channel or schema is damaged.
    """
    at = parts = 0
    while at < len(content):
        parts += 1
        if parts > limits.CHUNK_PARTS:
            raise ValueError("too many records")
        opcode, length = RECORD_HEAD.unpack_from(content, at)
        size = RECORD_HEAD.size + length
        if at + size > len(content):
            raise ValueError("a record extends beyond the chunk")
        count = 1
        if opcode == Opcode.MESSAGE:
            count = _equal_records(content, at, size)
            first, last = (np.frombuffer(content, MESSAGE_HEAD, 1, at + size * i)[0] for i in (0, count - 1))
            times_ns = int(first["log_time"]), int(last["log_time"])
            yield Batch(chunk, int(first["channel"]), at, size, count, times_ns)
        elif opcode in {Opcode.CHANNEL, Opcode.SCHEMA}:
            yield _record(content[at : at + size])
        at += size * count


def _equal_records(content: bytes, at: int, size: int) -> int:
    """Number of consecutive records with the opcode, length and channel of the first; searched with doubling steps."""
    head = np.frombuffer(content, dtype=np.uint8, count=RECORD_HEAD.size + 2, offset=at)
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
