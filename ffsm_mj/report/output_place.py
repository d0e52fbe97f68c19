"""Output files and folders: checked for writability before the work, and written atomically.

A folder may belong to another user. A file is therefore written under a temporary name and then renamed: an existing file
stays intact until then, and a symbolic link of that name is replaced, never followed.
"""

from __future__ import annotations

import os
import re
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from ffsm_mj.errors import InputError, OutputLostError

_LONGEST_SUFFIX = 8
UNFINISHED = re.compile(r"\.[0-9a-f]{16}(\.\w+)?")
"""Names of files that a process that was killed has not completed; see :func:`new_file`."""


def usable_folder(path: Path) -> None:
    """Create a folder if it does not exist, and check that files can be created in it.

    Raises:
        InputError: It cannot be created (a file has its name, the name is too long), or is not writable.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise InputError(f"{path}: cannot be used as a folder to write to ({error.strerror or error})") from error


def folder_below(folder: Path, *names: str) -> Path:
    """A writable folder below one of unknown owner: none of these path components may be a symbolic link.

    Raises:
        InputError: One is a symbolic link, or :func:`usable_folder` refuses the folder.
    """
    path = folder
    for name in names:
        path = path / name
        refuse_link(path)
    usable_folder(path)
    return path


def refuse_link(path: Path) -> None:
    """Refuse to write through a symbolic link.

    Raises:
        InputError: The path is a symbolic link.
    """
    if os.path.islink(path):  # unlike Path.is_symlink, False for a name that is too long
        raise InputError(f"{path}: is a symbolic link; nothing is written through it")


def usable_file(path: Path) -> None:
    """Check that a file can be written or created; its folder is created if it does not exist. Devices count as files.

    Raises:
        InputError: It is a folder, its name is too long, or it cannot be written.
    """
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        usable_folder(path.parent)
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    if path.is_dir() and not stat.S_ISLNK(mode):
        raise InputError(f"{path}: is a folder; name the file to write")
    if not stat.S_ISLNK(mode) and not os.access(path, os.W_OK):
        raise InputError(f"{path}: cannot be written (Permission denied)")
    if not _is_device(path):
        usable_folder(path.parent)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Context with a temporary file in the same folder, renamed to the path at a successful exit.

    An interruption or a full disk leaves an existing file as it was. Devices and pipes are written to directly.

    Raises:
        OutputLostError: The file could not be written completely.
    """
    with writing(path):
        if _is_device(path):
            yield path
            return
        # ffmpeg selects the format by suffix; the final name may already have the greatest length that the system allows.
        unfinished = path.with_name(f".{token_hex(8)}{path.suffix if len(path.suffix) <= _LONGEST_SUFFIX else ''}")
        os.close(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        try:
            yield unfinished
            os.replace(unfinished, path)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise


def _is_device(path: Path) -> bool:
    """Whether a path is a device or a pipe, directly or through a link of the system (``/dev/stdout``)."""
    if os.path.abspath(path).startswith("/dev/"):
        return True
    try:
        mode = path.lstat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISLNK(mode) or stat.S_ISDIR(mode))


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context for writing to a path that was checked: errors (a full disk) become ``OutputLostError``.

    Raises:
        OutputLostError: A write failed.
    """
    try:
        yield
    except OSError as error:
        raise OutputLostError(path, error.strerror or str(error)) from error
