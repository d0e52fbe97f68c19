"""Random access to the bytes of a file without reading it into memory."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

_WINDOW = 1 << 20


class FileBytes:
    """Bytes of a file, up to its length at opening; a context manager."""

    def __init__(self, path: Path) -> None:
        """Open a file.

        Raises:
            OSError: The file cannot be opened.
        """
        self.path = path
        self._stream = path.open("rb")
        self._size = os.fstat(self._stream.fileno()).st_size

    def __len__(self) -> int:
        """Length of the file at opening."""
        return self._size

    def take(self, start: int, stop: int) -> bytes:
        """Bytes from ``start`` to ``stop``, fewer at the end of the file."""
        self._stream.seek(start)
        return self._stream.read(max(0, min(stop, self._size) - start))

    def find(self, mark: bytes, start: int) -> int:
        """Position of the first occurrence of ``mark`` at or after ``start``; -1 if there is none."""
        for at in range(start, self._size, _WINDOW):
            found = self.take(at, at + _WINDOW + len(mark) - 1).find(mark)
            if found >= 0:
                return at + found
        return -1

    def checksum(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes from ``start`` to ``stop``."""
        checksum = 0
        for window in self._windows(start, stop):
            checksum = zlib.crc32(window, checksum)
        return checksum

    def _windows(self, start: int, stop: int) -> Iterator[bytes]:
        for at in range(start, stop, _WINDOW):
            yield self.take(at, min(at + _WINDOW, stop))

    def __enter__(self) -> FileBytes:
        """Return the object itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close the file."""
        self._stream.close()
