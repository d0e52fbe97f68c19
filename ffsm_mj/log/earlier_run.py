"""What stands in a folder where a run is to be written, and what of it ``--force`` may replace: an earlier run, no more."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath

from mcap.exceptions import McapError
from mcap.records import Attachment, Chunk
from mcap.stream_reader import StreamReader

from ffsm_mj.errors import InputError
from ffsm_mj.log.mcap.format import is_plain

MODELS = "mjcf"
"""Folder of the models in a run folder and in a log."""
_NOISE = (McapError, OSError, struct.error, ValueError, LookupError, MemoryError, OverflowError, StopIteration)


def in_the_way(folder: Path, names: Iterable[str]) -> list[str]:
    """Those of some names, relative to a folder, under which there is something already, if only a link to nothing.

    Raises:
        InputError: A folder on the way to one of them is a symbolic link, or no folder.
    """
    taken = []
    for name in names:
        blocked = _blocked(folder, name)
        if blocked is not None:
            raise InputError(f"{blocked}: is no folder of its own, the run's models cannot be written there; move it away")
        if os.path.lexists(folder / name):
            taken.append(name)
    return taken


def replaceable(folder: Path, taken: Sequence[str], logs: Sequence[str], own: Sequence[str]) -> list[str]:
    """What ``--force`` removes: the files of the earlier run, by the names that a run gives and those that its log carries.

    Args:
        folder: The run folder.
        taken: Names that are needed and in the way.
        logs: Names of logs, of which the first that is there tells of the run.
        own: Names that every run writes.

    Raises:
        InputError: The folder is a symbolic link; it holds no run; or something that no run wrote is in the way.
    """
    if folder.is_symlink():
        raise InputError(f"{folder}: is a symbolic link, which --force does not follow; name the folder itself")
    log = next((name for name in logs if os.path.lexists(folder / name)), None)
    if taken and log is None:
        raise InputError(f"{folder}: holds {taken[0]} but no run, which alone --force replaces; choose another --out")
    models = _models(folder / log) if log is not None else []
    for name in taken:
        if name not in own and name not in models:
            raise InputError(f"{folder / name}: is not of the run that --force replaces; move it away")
        if (folder / name).is_dir() and not (folder / name).is_symlink():
            raise InputError(f"{folder / name}: is a folder, which no run writes under this name; move it away")
    return [*own, *(name for name in models if _blocked(folder, name) is None)]


def remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files, and the folders that this leaves empty; a symbolic link goes, what it leads to stays."""
    for name in names:
        (folder / name).unlink(missing_ok=True)
        for parent in _above(folder, name):
            with suppress(OSError):  # something else is in it
                parent.rmdir()


def _above(folder: Path, name: str) -> list[Path]:
    """Folders between a folder and a file in it, innermost first."""
    return [folder / parent for parent in PurePosixPath(name).parents if parent.parts]


def _blocked(folder: Path, name: str) -> Path | None:
    """What stands on the way to a file and is no real folder."""
    return next((path for path in _above(folder, name) if path.is_symlink() or (path.exists() and not path.is_dir())), None)


def _models(log: Path) -> list[str]:
    """Names of the models' files that a log carries, as far as it can be read; only what is in its own folder of models."""
    names = []
    try:
        with log.open("rb") as stream:
            for record in StreamReader(stream, emit_chunks=True, record_size_limit=log.stat().st_size).records:
                if isinstance(record, Chunk):
                    break
                if isinstance(record, Attachment) and record.name.startswith(f"{MODELS}/") and is_plain(record.name):
                    names.append(record.name)
    except _NOISE:
        pass
    return names
