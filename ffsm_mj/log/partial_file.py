"""A file that one process at a time writes: ``NAME.partial``, which anyone may read, until it is whole."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: nobody can replace or remove a file there that somebody has open
    fcntl = None  # type: ignore[assignment]

_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class PartialFile:
    """The partial file in the hands of this process; the operating system gives it back when the process ends, however.

    Attributes:
        partial: Where it is while it is written.
        left_bytes: How much somebody else left in it, who was killed.
        stream: Where to write, once :meth:`begin` was called.
    """

    def __init__(self, path: Path) -> None:
        """Take it; what it holds stays until :meth:`begin`.

        Args:
            path: Its name once it is whole.

        Raises:
            BlockingIOError: Another process is writing it, or this one through another object.
            OSError: It cannot be made, or what has its name is no file (a symbolic link, a folder, a device).
        """
        self._path, self.partial = path, path.with_name(path.name + ".partial")
        self._take()

    def _take(self) -> None:
        while True:
            descriptor = os.open(self.partial, _FLAGS, 0o666)
            try:
                _lock(descriptor)
                status = os.fstat(descriptor)
                if not stat.S_ISREG(status.st_mode):
                    raise OSError(errno.EINVAL, "is no file", str(self.partial))
            except BaseException:
                os.close(descriptor)
                raise
            if self._is_still(status):
                break
            os.close(descriptor)  # it was finished, or removed, before the lock was ours
        self.left_bytes = status.st_size
        self.stream = os.fdopen(descriptor, "r+b")

    @classmethod
    def begun(cls, path: Path, opening: bytes) -> PartialFile:
        """Take it and write its first bytes."""
        file = cls(path)
        file.begin(opening)
        return file

    @classmethod
    def appearing(cls, path: Path, nameless: int) -> PartialFile:
        """Give a nameless file its name, at once with all that it holds, in a folder of the same file system.

        Raises:
            FileExistsError: Something has that name.
        """
        file = cls.__new__(cls)
        file._path, file.partial, file.left_bytes = path, path.with_name(path.name + ".partial"), 0
        # Python follows the link in /proc only where a folder's descriptor is given, of which an absolute path makes no use.
        os.link(f"/proc/self/fd/{nameless}", file.partial, src_dir_fd=nameless, follow_symlinks=True)
        file.stream = os.fdopen(nameless, "r+b")
        file.stream.seek(0, os.SEEK_END)
        return file

    def _is_still(self, status: os.stat_result) -> bool:
        try:
            return os.path.samestat(os.lstat(self.partial), status)
        except FileNotFoundError:
            return False

    def begin(self, opening: bytes) -> None:
        """Replace what it holds by its first bytes, at once."""
        if self.left_bytes:
            self.stream.truncate(0)
        self.stream.write(opening)
        self.stream.flush()

    def finish(self) -> None:
        """Give it its name, and it back: in this order, so that nobody takes it in between."""
        self.stream.flush()
        os.replace(self.partial, self._path)
        self.stream.close()

    def discard(self) -> None:
        """Remove it, where nothing was ever in it, and give it back."""
        if not self.left_bytes:
            self.partial.unlink(missing_ok=True)
        self.stream.close()


def nameless(folder: Path, opening: bytes) -> int | None:
    """Descriptor of a file in this process's hands that holds its first bytes and has no name yet, so that none is left.

    None where the operating system or the file system has no such files.

    Raises:
        OSError: The bytes cannot be written (full disk).
    """
    flag = getattr(os, "O_TMPFILE", None)
    if flag is None or not Path("/proc/self/fd").is_dir():
        return None
    try:
        descriptor = os.open(folder, os.O_RDWR | flag, 0o666)
    except OSError:
        return None
    try:
        _lock(descriptor)
        rest = memoryview(opening)
        while rest:
            rest = rest[os.write(descriptor, rest) :]
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _lock(descriptor: int) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno not in {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}:  # file systems without locks
            raise
