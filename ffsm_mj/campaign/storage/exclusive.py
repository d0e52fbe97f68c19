"""Exclusive use of a folder by one process, and files in it that are written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from ffsm_mj.errors import InputError, LogWriteError

LOCK = "driver.lock"


@contextmanager
def exclusive(folder: Path, kind: str) -> Iterator[None]:
    """Context with exclusive use of a folder; the operating system releases it when the process ends.

    Args:
        folder: The folder, created if it does not exist.
        kind: What it holds, for messages: ``campaign`` or ``study``.

    Raises:
        InputError: Another process uses the folder, or it cannot be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK)
        lock.acquire(timeout=0)
    except Timeout as error:
        raise InputError(f"{folder}: another process is running this {kind}") from error
    except OSError as error:
        raise InputError(f"{folder}: cannot be used as a {kind} folder ({error.strerror})") from error
    try:
        yield
    finally:
        lock.release()


def write_whole(file: Path, data: bytes) -> None:
    """Write a file, completely or not at all; its folder is created if it does not exist.

    Raises:
        LogWriteError: It cannot be written (full disk).
    """
    unfinished = file.with_name(f".{file.name}-{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished.unlink(missing_ok=True)
        with unfinished.open("xb") as stream:
            stream.write(data)
        os.replace(unfinished, file)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise LogWriteError(file, error) from error


def is_unfinished(name: str, files: tuple[str, ...]) -> bool:
    """Whether a file name is that of one of these files before a process that was killed had completed it."""
    return name.startswith(tuple(f".{file}-" for file in files))
