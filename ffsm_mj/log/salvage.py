"""Every record of an MCAP file that can still be read, whatever happened to the file.

Chunks and attachments carry checksums: what does not match is left out, and reading goes on behind it. Where even the length
of a record is wrong, reading goes on at the next chunk.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

MAGIC = b"\x89MCAP0\r\n"
_PREFIX = struct.Struct("<BQ")  # opcode and length of the content
_NOISE = (McapError, ZstdError, ArithmeticError, LookupError, ValueError, MemoryError, struct.error, StopIteration)
_USED = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END}
# What stands in every chunk of ours, and where: after opcode, length, two times, size and checksum.
_CHUNK_MARK, _CHUNK_MARK_AT = b"\x04\x00\x00\x00zstd", 9 + 8 + 8 + 8 + 4


class Salvage:
    """One pass over the bytes of a file.

    Attributes:
        lost_bytes: Bytes that could not be read, with something behind them that could.
        ended: Whether the data section was read to its end.
        data_match: Whether the checksum over that section holds; True before its end.
        index_match: Whether the index behind it is whole.
    """

    def __init__(self, data: bytes) -> None:
        """Begin before the first record."""
        self._data = data
        self.lost_bytes = 0
        self.ended, self.data_match, self.index_match = False, True, False

    def records(self) -> Iterator[Any]:
        """Records in the order of the file, those of chunks one by one, and at last the summary's schemas and channels.

        A record that breaks off with the file is where a kill or a full disk stopped the writer: reading ends there.
        """
        at = len(MAGIC)
        while at < len(self._data):
            end = self._end(at)
            found = self._read(at, end) if end is not None else None
            if found is None:
                behind = end if end is not None and self._end(end) is not None else self._next_chunk(at + 1)
                if behind is None:
                    return
                self.lost_bytes += behind - at
                at = behind
                continue
            yield from found
            if self._data[at] == Opcode.DATA_END:
                yield from self._summary(at, int(end or 0))
                return
            at = int(end or 0)

    def _end(self, at: int) -> int | None:
        """Where the record at some place ends; None where there is none, or where it does not fit into the file."""
        if at + _PREFIX.size > len(self._data):
            return None
        opcode, length = _PREFIX.unpack_from(self._data, at)
        end = at + _PREFIX.size + int(length)
        return end if Opcode.HEADER <= opcode <= Opcode.DATA_END and end <= len(self._data) else None

    def _read(self, at: int, end: int) -> list[Any] | None:
        """What a record holds; None where it is damaged."""
        if self._data[at] not in _USED:
            return []
        checksum = int.from_bytes(self._data[end - 4 : end], "little")
        if self._data[at] == Opcode.ATTACHMENT and zlib.crc32(self._data[at + _PREFIX.size : end - 4]) != checksum:
            return None
        try:
            record = next(StreamReader(BytesIO(self._data[at:end]), skip_magic=True, emit_chunks=True).records)
            return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]
        except _NOISE:
            return None

    def _next_chunk(self, start: int) -> int | None:
        """Where the next chunk seems to begin."""
        mark = self._data.find(_CHUNK_MARK, start + _CHUNK_MARK_AT)
        while mark >= 0:
            at = mark - _CHUNK_MARK_AT
            if self._data[at] == Opcode.CHUNK and self._end(at) is not None:
                return at
            mark = self._data.find(_CHUNK_MARK, mark + 1)
        return None

    def _summary(self, data_end: int, start: int) -> Iterator[Any]:
        """What stands behind the data, where its checksum holds."""
        self.ended = True
        stated = int.from_bytes(self._data[data_end + _PREFIX.size : start], "little")
        self.data_match = stated in {0, zlib.crc32(memoryview(self._data)[:data_end])}
        checksum = len(self._data) - len(MAGIC) - 4
        summary = memoryview(self._data)[start:checksum]
        self.index_match = self._data.endswith(MAGIC) and (
            zlib.crc32(summary) == int.from_bytes(self._data[checksum : checksum + 4], "little")
        )
        at = start
        while self.index_match and self._data[at] in {Opcode.SCHEMA, Opcode.CHANNEL}:
            end = self._end(at) or len(self._data)
            yield from self._read(at, end) or []
            at = end
