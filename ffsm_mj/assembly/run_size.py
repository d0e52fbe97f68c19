"""Size of a run, estimated before it starts, so that a run that does not fit is refused."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ffsm_mj.errors import InputError

_RECORD_BYTES = 100
"""Upper bound of the overhead per sample in the log, bytes."""
_PLENTY = 1 << 62
_BEST_COMPRESSION = 5
"""Least compression ratio; logs shrink to a half to a fifth of their size."""


def logged_bytes(ticks: int, columns: int) -> int:
    """Size of all samples before compression: a double and its tag per column."""
    return ticks * (9 * columns + _RECORD_BYTES)


def too_large(ticks: int, columns: int, limit_GB: float) -> str:
    """Message if the samples exceed a limit; empty if they do not."""
    size = logged_bytes(ticks, columns) / 1e9
    if size <= limit_GB:
        return ""
    return (
        f"{ticks} control periods of {columns} columns are {size:.3g} GB before compression, more than log.max_size_GB "
        f"({limit_GB:g}); shorten the run, lengthen control_period_s or raise that"
    )


def refuse_without_room(ticks: int, columns: int, folder: Path | None) -> None:
    """Check that a run fits on the disk or in memory.

    Args:
        ticks: Control ticks.
        columns: Of a sample.
        folder: The run folder, which need not exist yet; None for a run that is kept in memory.

    Raises:
        InputError: It does not fit, even with the best compression.
    """
    if folder is not None:
        need, room = logged_bytes(ticks, columns) // _BEST_COMPRESSION, _free(folder)
        if need > room:
            raise InputError(f"{folder}: the run takes {need / 1e9:.3g} GB at least, {room / 1e9:.3g} GB are free")
        return
    need, room = 8 * ticks * columns, _memory()
    if need > room:
        raise InputError(
            f"the run takes {need / 1e9:.3g} GB of memory, this machine has {room / 1e9:.3g} GB; give it a folder (out=...)"
        )


def _free(folder: Path) -> int:
    """Free space at a folder that need not exist yet, bytes; if unknown, more than any run needs."""
    try:
        there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.is_dir())
        return shutil.disk_usage(there).free
    except OSError:
        return _PLENTY


def _memory() -> int:
    """Memory of this machine, bytes; if unknown, more than any run needs."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return _PLENTY
