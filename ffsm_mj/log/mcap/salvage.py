"""Records of an MCAP file that are still readable if the file is damaged or incomplete.

Chunks and attachments have checksums: records that do not match are skipped. If the length of a record is wrong, reading
continues at the next chunk. Records are read one by one, so that a long file is never in memory.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from ffsm_mj.errors import LogError
from ffsm_mj.log.mcap.chunks import RECORD, content_of, records_of, stated_size
from ffsm_mj.log.mcap.file_bytes import FileBytes

MAGIC = b"\x89MCAP0\r\n"
_UNREADABLE = (McapError, ZstdError, ArithmeticError, LookupError, ValueError, MemoryError, struct.error, StopIteration)
_USED = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END}
_MOST_RECORD_BYTES = 1 << 28
"""Greatest size of a record; the rest of a longer one is not read, so that its checksum fails."""
_MOST_UNPACKED, _MOST_RATIO = 1 << 30, 500
"""Greatest size of all decompressed chunks, in bytes and relative to the file, against decompression bombs: rows compress
to a fifth, rows of a system at rest to less."""
# Bytes in every chunk that ffsm-mj writes, after opcode, length, two times, size and checksum.
_CHUNK_MARK, _CHUNK_MARK_AT = b"\x04\x00\x00\x00zstd", 9 + 8 + 8 + 8 + 4


class Salvage:
    """One pass over the bytes of a file.

    Attributes:
        lost_bytes: Number of unreadable bytes that are followed by readable ones.
        holes: Positions in the file of what is lost, its end included where it breaks off within a record.
        ended: Whether the data section was read to its end.
        data_match: Whether the checksum of the data section matches; True before its end.
        index_match: Whether the index after the data section is intact.
    """

    def __init__(self, data: FileBytes) -> None:
        """Start before the first record."""
        self._data = data
        self.lost_bytes = self._unpacked = 0
        self.holes: list[int] = []
        self.ended, self.data_match, self.index_match = False, True, False

    def records(self) -> Iterator[Any]:
        """Records in the order of the file, including those inside chunks, and then schemas and channels of the summary.

        Messages are yielded as :class:`.chunks.Batch`. Reading ends at a record that extends beyond the end of the file,
        where a kill or a full disk stopped the writer.

        Raises:
            LogError: The stated size of the chunks is too large for a file of this length.
        """
        at = len(MAGIC)
        while at < len(self._data):
            end = self._end(at)
            found = self._read(at, end) if end is not None else None
            if self._unpacked > max(_MOST_UNPACKED, _MOST_RATIO * len(self._data)):
                raise LogError(
                    self._data.path, f"its chunks contain {self._unpacked} bytes or more, too many for its length"
                )
            if found is None:
                # A valid record after this one shows that its length is right: skip it. Otherwise the length may be damaged
                # too, and only the signature of a chunk gives the next position.
                following = end if end is not None and self._end(end) is not None else self._next_chunk(at + 1)
                self.holes.append(at)
                if following is None:
                    return
                self.lost_bytes += following - at
                at = following
                continue
            yield from found
            if self._opcode(at) == Opcode.DATA_END:
                yield from self._summary(at, int(end or 0))
                return
            at = int(end or 0)

    def _opcode(self, at: int) -> int:
        return self._data.take(at, at + 1)[0]

    def _end(self, at: int) -> int | None:
        """End of the record at a position; None if there is no record or it extends beyond the file."""
        if at + RECORD.size > len(self._data):
            return None
        opcode, length = RECORD.unpack(self._data.take(at, at + RECORD.size))
        end = at + RECORD.size + int(length)
        return end if Opcode.HEADER <= opcode <= Opcode.DATA_END and end <= len(self._data) else None

    def _read(self, at: int, end: int) -> list[Any] | None:
        """Content of a record; None if it is damaged."""
        opcode = self._opcode(at)
        if opcode not in _USED:
            return []
        record = self._data.take(at, min(end, at + _MOST_RECORD_BYTES))
        if opcode == Opcode.ATTACHMENT and zlib.crc32(record[RECORD.size : -4]) != int.from_bytes(record[-4:], "little"):
            return None
        try:
            if opcode == Opcode.CHUNK:
                self._unpacked += stated_size(record)
                return list(records_of(content_of(record), (at, end)))
            return [next(StreamReader(BytesIO(record), skip_magic=True, emit_chunks=True).records)]
        except _UNREADABLE:
            return None

    def _next_chunk(self, start: int) -> int | None:
        """Position at which the next chunk appears to start; None if there is none."""
        mark = self._data.find(_CHUNK_MARK, start + _CHUNK_MARK_AT)
        while mark >= 0:
            at = mark - _CHUNK_MARK_AT
            if self._opcode(at) == Opcode.CHUNK and self._end(at) is not None:
                return at
            mark = self._data.find(_CHUNK_MARK, mark + 1)
        return None

    def _summary(self, data_end: int, start: int) -> Iterator[Any]:
        """Schemas and channels of the summary section, if its checksum matches."""
        self.ended = True
        stated = int.from_bytes(self._data.take(data_end + RECORD.size, start), "little")
        self.data_match = stated in {0, self._data.checksum(0, data_end)}
        checksum = len(self._data) - len(MAGIC) - 4
        self.index_match = self._data.take(checksum + 4, len(self._data)) == MAGIC and (
            self._data.checksum(start, checksum) == int.from_bytes(self._data.take(checksum, checksum + 4), "little")
        )
        # Schemas and channels are repeated here: those of a damaged chunk are recovered.
        at = start
        while self.index_match and self._opcode(at) in {Opcode.SCHEMA, Opcode.CHANNEL}:
            end = self._end(at) or len(self._data)
            yield from self._read(at, end) or []
            at = end
