"""A file as bytes, of which only what is asked for is in memory."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

_WINDOW = 1 << 20


class FileBytes:
    """Bytes of a file as long as it was when it was opened; a context manager."""

    def __init__(self, path: Path) -> None:
        """Open it.

        Raises:
            OSError: It cannot be opened.
        """
        self.path = path
        self._stream = path.open("rb")
        self._size = os.fstat(self._stream.fileno()).st_size

    def __len__(self) -> int:
        """Length of the file."""
        return self._size

    def take(self, start: int, stop: int) -> bytes:
        """Bytes from start to stop, fewer where the file ends before."""
        self._stream.seek(start)
        return self._stream.read(max(0, min(stop, self._size) - start))

    def find(self, mark: bytes, start: int) -> int:
        """Where a mark first stands at or after a place; -1 where it does not."""
        for at in range(start, self._size, _WINDOW):
            found = self.take(at, at + _WINDOW + len(mark) - 1).find(mark)
            if found >= 0:
                return at + found
        return -1

    def checksum(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes from start to stop."""
        checksum = 0
        for window in self._windows(start, stop):
            checksum = zlib.crc32(window, checksum)
        return checksum

    def _windows(self, start: int, stop: int) -> Iterator[bytes]:
        for at in range(start, stop, _WINDOW):
            yield self.take(at, min(at + _WINDOW, stop))

    def __enter__(self) -> FileBytes:
        """Use it."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close it."""
        self._stream.close()
