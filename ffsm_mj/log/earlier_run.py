"""Files that are already in a run folder, and which of them ``--force`` may replace: those of an earlier run only."""

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
from ffsm_mj.invocation import option
from ffsm_mj.log.mcap.format import is_plain

MODELS = "mjcf"
"""Folder of the model files in a run folder and in a log."""
RECORDED = "recorded"
"""Folder of the files with recorded numbers that control laws play, likewise."""
BEFORE = "before"
"""Folder of what is kept of the run from which a run goes on, likewise."""
_FOLDERS = (f"{MODELS}/", f"{RECORDED}/", f"{BEFORE}/")
_UNREADABLE = (McapError, OSError, struct.error, ValueError, LookupError, MemoryError, OverflowError, StopIteration)


def existing(folder: Path, names: Iterable[str]) -> list[str]:
    """Names, relative to a folder, that exist already; a broken symbolic link exists.

    Raises:
        InputError: A parent folder of one of them is a symbolic link, or is not a folder.
    """
    taken = []
    for name in names:
        blocked = _blocked(folder, name)
        if blocked is not None:
            raise InputError(
                f"{blocked}: is not a regular folder, so the models of the run cannot be written there; move it away"
            )
        if os.path.lexists(folder / name):
            taken.append(name)
    return taken


def replaceable(folder: Path, taken: Sequence[str], logs: Sequence[str], own: Sequence[str]) -> list[str]:
    """Files that ``--force`` removes: those that every run writes, and the model files named in the log of the earlier run.

    Args:
        folder: The run folder.
        taken: Names that the new run needs and that exist.
        logs: Possible names of the log; the first that exists is the log of the earlier run.
        own: Names that every run writes.

    Raises:
        InputError: The folder is a symbolic link, it contains no run, or one of the names is not a file of a run.
    """
    if folder.is_symlink():
        raise InputError(
            f"{folder}: is a symbolic link, which {option('force', 'True')} does not follow; give the folder itself"
        )
    log = next((name for name in logs if os.path.lexists(folder / name)), None)
    if taken and log is None:
        only = f"{option('force', 'True')} replaces runs only; choose another {option('out')}"
        raise InputError(f"{folder}: contains {taken[0]} but no run, and {only}")
    # A folder may contain files of the user: only names that a run writes, or that its log lists, are removed.
    models = _models(folder / log) if log is not None else []
    for name in taken:
        if name not in own and name not in models:
            raise InputError(
                f"{folder / name}: does not belong to the run that {option('force', 'True')} replaces; move it away"
            )
        if (folder / name).is_dir() and not (folder / name).is_symlink():
            raise InputError(f"{folder / name}: is a folder, but a run writes a file of this name; move it away")
    return [*own, *(name for name in models if _blocked(folder, name) is None)]


def remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files, and folders that become empty; of a symbolic link, only the link is removed."""
    for name in names:
        (folder / name).unlink(missing_ok=True)
        for parent in _above(folder, name):
            with suppress(OSError):  # it is not empty
                parent.rmdir()


def _above(folder: Path, name: str) -> list[Path]:
    """Folders between a folder and a file in it, innermost first."""
    return [folder / parent for parent in PurePosixPath(name).parents if parent.parts]


def _blocked(folder: Path, name: str) -> Path | None:
    """The innermost parent of a file that exists and is not a regular folder."""
    return next((path for path in _above(folder, name) if path.is_symlink() or (path.exists() and not path.is_dir())), None)


def _models(log: Path) -> list[str]:
    """Names of the files of models and of control laws in a log, as far as it is readable; others are ignored."""
    names = []
    try:
        with log.open("rb") as stream:
            for record in StreamReader(stream, emit_chunks=True, record_size_limit=log.stat().st_size).records:
                if isinstance(record, Chunk):
                    break
                if isinstance(record, Attachment) and record.name.startswith(_FOLDERS) and is_plain(record.name):
                    names.append(record.name)
    except _UNREADABLE:
        pass
    return names
