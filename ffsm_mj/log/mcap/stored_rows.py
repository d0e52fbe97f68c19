"""Rows of a log on disk that are read on demand: a long run is never completely in memory."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from zstandard import ZstdError

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import LogError
from ffsm_mj.log.mcap.chunks import Batch, content_of
from ffsm_mj.log.mcap.file_bytes import FileBytes
from ffsm_mj.log.mcap.format import SampleCodec
from ffsm_mj.records.run_log import BLOCK_ROWS
from ffsm_mj.records.signals import Layout

KEPT_BYTES = 1 << 26
"""Rows up to this size are kept in memory after the first access; of larger ones, the last few columns."""
_KEPT_COLUMNS = 6


class StoredRows:
    """Rows of one log, indexed like an array; each access reads the file in one pass and verifies its checksums again."""

    def __init__(self, path: Path, layout: Layout, batches: Sequence[Batch] | Callable[[], Sequence[Batch]]) -> None:
        """Remember the file; nothing is read yet.

        Args:
            path: The log.
            layout: Its columns.
            batches: Positions of its samples, or a function that finds them and is called once, on first use.
        """
        self._path, self._codec, self._width = path, SampleCodec(layout), len(layout.signals)
        self._file = path.absolute()  # the process may change its folder before rows are read
        self._given, self._stamp = batches, _stamp(self._file)
        self._column = lru_cache(_KEPT_COLUMNS)(self._read_column)

    @cached_property
    def batches(self) -> Sequence[Batch]:
        """Positions of the samples in the file."""
        return self._given() if callable(self._given) else self._given

    @cached_property
    def _count(self) -> int:
        return sum(batch.count for batch in self.batches)

    @cached_property
    def _all(self) -> FloatArray:
        return self._read(slice(None), None)

    def __len__(self) -> int:
        """Number of rows."""
        return self._count

    @property
    def small(self) -> bool:
        """Whether all rows may be kept in memory."""
        return 8 * self._count * self._width <= KEPT_BYTES

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns."""
        return self._count, self._width

    def blocks(self, columns: Sequence[int] | None = None) -> Iterator[FloatArray]:
        """Rows in order, in blocks of a few thousand, (n, number of columns), with all or some columns.

        Raises:
            LogError: The file was removed or replaced.
        """
        if _stamp(self._file) != self._stamp:
            raise LogError(self._path, "has changed since the run was read")
        try:
            with FileBytes(self._file) as data:
                for chunk, batches in groupby(self.batches, key=lambda batch: batch.chunk):
                    content = content_of(data.take(*chunk))
                    for batch in batches:
                        messages = batch.messages(content)
                        for first in range(0, batch.count, BLOCK_ROWS):
                            yield self._codec.decode(messages[first : first + BLOCK_ROWS], columns)
        except OSError as error:
            raise LogError(self._path, f"cannot be read ({error.strerror})") from error
        except (ValueError, struct.error, ZstdError) as error:
            raise LogError(self._path, f"not of this version's format ({error})") from error

    def __getitem__(self, key: Any) -> Any:
        """Index like an array: ``rows[10:20]``, ``rows[-1, 3]``, ``rows[chosen, 3]``, ``rows[:, [1, 2]]``.

        Raises:
            IndexError: Out of range.
        """
        if self.small:
            return self._all[key]
        rows, columns = key if isinstance(key, tuple) else (key, slice(None))
        if isinstance(columns, int | np.integer):
            return self._column(int(columns) % self._width)[rows]
        chosen = np.arange(self._width)[columns]
        if isinstance(rows, int | np.integer):
            row = int(np.arange(self._count)[rows])
            return self._read(slice(row, row + 1), chosen.tolist())[0]
        return self._read(rows, chosen.tolist())

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        """All rows, for numpy."""
        return np.asarray(self[:], dtype=dtype)

    def copy(self) -> FloatArray:
        """All rows as a new array."""
        return np.array(self[:])

    def _read_column(self, column: int) -> FloatArray:
        found = self._read(slice(None), [column])[:, 0]
        found.flags.writeable = False
        return found

    def _read(self, rows: Any, columns: Sequence[int] | None) -> FloatArray:
        """Read some rows and columns in one pass."""
        # One pass over the file serves any order of rows: they are sorted, found block by block, and stored in place.
        wanted = np.arange(self._count)[rows]
        order = np.argsort(wanted, kind="stable")
        ascending = wanted[order]
        found = np.empty((len(wanted), self._width if columns is None else len(columns)))
        start = 0
        for block in self.blocks(columns):
            first, last = np.searchsorted(ascending, (start, start + len(block)))
            found[order[first:last]] = block[ascending[first:last] - start]
            start += len(block)
            if last == len(ascending):
                break
        return found


def _stamp(path: Path) -> tuple[int, int, int] | None:
    """Identity of a complete log, which changes if the file is replaced; None for a partial or missing one."""
    try:
        known = os.stat(path)
    except OSError:
        return None
    return None if path.name.endswith(".partial") else (known.st_ino, known.st_size, known.st_mtime_ns)
