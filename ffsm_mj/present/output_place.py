"""Where a command is to write: whether it can is asked before the work, and a loss while writing is told."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ffsm_mj.errors import InputError, OutputLostError


def usable_folder(path: Path) -> None:
    """Make a folder where there is none, and see whether a file can be made in it.

    Raises:
        InputError: It cannot be made (a file is in the way, the name is too long), or takes no file.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise InputError(f"{path}: cannot be used as a folder to write to ({error.strerror or error})") from error


def usable_file(path: Path) -> None:
    """See whether a file can be written, or made in its folder, which is made where there is none; devices are files.

    Raises:
        InputError: It is a folder, its name is too long, or it cannot be written.
    """
    try:
        path.lstat()
    except FileNotFoundError:
        usable_folder(path.parent)
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the file to write")
    if not os.access(path, os.W_OK):
        raise InputError(f"{path}: cannot be written (Permission denied)")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Writing to a place that was found usable: what fails now (a full disk) is a loss.

    Raises:
        OutputLostError: Something could not be written.
    """
    try:
        yield
    except OSError as error:
        raise OutputLostError(path, error.strerror or str(error)) from error
