"""Where a command is to write: whether it can is asked before the work, and a loss while writing is told.

A folder may be somebody else's. So a file is written under a new name and then takes its place at once: what was there stays
whole until then, and a symbolic link that has the name is replaced, never followed.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from ffsm_mj.errors import InputError, OutputLostError

_LONGEST_SUFFIX = 8


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


def folder_below(folder: Path, *names: str) -> Path:
    """A usable folder below one that may be somebody else's: none of these names may be a symbolic link.

    Raises:
        InputError: One is, or :func:`usable_folder` refuses the folder.
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
        InputError: The path is one.
    """
    if path.is_symlink():
        raise InputError(f"{path}: is a symbolic link; nothing is written through it")


def usable_file(path: Path) -> None:
    """See whether a file can be written, or made in its folder, which is made where there is none; devices are files.

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
    """Where to write a file: an empty one beside its place, which takes the place when it is whole.

    An interruption or a full disk leaves what was there before. Devices and pipes are written to directly.

    Raises:
        OutputLostError: It could not be written to its end.
    """
    with writing(path):
        if _is_device(path):
            yield path
            return
        # ffmpeg goes by the suffix; the final name may be as long as a name can be.
        unfinished = path.with_name(f".{token_hex(8)}{path.suffix if len(path.suffix) <= _LONGEST_SUFFIX else ''}")
        os.close(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        try:
            yield unfinished
            os.replace(unfinished, path)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise


def _is_device(path: Path) -> bool:
    """Whether a path is a device or a pipe, by itself or as one of the links that a system keeps (``/dev/stdout``)."""
    if os.path.abspath(path).startswith("/dev/"):
        return True
    try:
        mode = path.lstat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISLNK(mode) or stat.S_ISDIR(mode))


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
