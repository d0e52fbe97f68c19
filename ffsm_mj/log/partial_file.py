"""A file that one process writes under the name ``NAME.partial`` until it is complete; any process may read it."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: an open file can be neither replaced nor removed, so no lock is needed
    fcntl = None  # type: ignore[assignment]

_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class PartialFile:
    """A partial file locked by this process; the operating system releases the lock when the process ends, even if killed.

    Attributes:
        partial: Path of the file while it is written.
        left_bytes: Size of what a killed process left in it.
        stream: Stream to write to, after :meth:`begin`.
    """

    def __init__(self, path: Path) -> None:
        """Lock the file; its content is kept until :meth:`begin`.

        Args:
            path: Its path when it is complete.

        Raises:
            BlockingIOError: Another process, or another object of this one, is writing it.
            OSError: It cannot be created, or its name is not that of a regular file (symbolic link, folder, device).
        """
        self._path, self.partial = path, path.with_name(path.name + ".partial")
        self._take()

    def _take(self) -> None:
        # The lock belongs to the file, not to its name: after locking, the name may already refer to another file.
        while True:
            descriptor = os.open(self.partial, _FLAGS, 0o666)
            try:
                _lock(descriptor)
                status = os.fstat(descriptor)
                if not stat.S_ISREG(status.st_mode):
                    raise OSError(errno.EINVAL, "is not a regular file", str(self.partial))
            except BaseException:
                os.close(descriptor)
                raise
            if self._is_current(status):
                break
            os.close(descriptor)  # another process completed or removed it before this one got the lock
        self.left_bytes = status.st_size
        self.stream = os.fdopen(descriptor, "r+b")

    @classmethod
    def begun(cls, path: Path, opening: bytes) -> PartialFile:
        """Lock it and write its first bytes."""
        file = cls(path)
        file.begin(opening)
        return file

    @classmethod
    def appearing(cls, path: Path, nameless: int) -> PartialFile:
        """Link an unnamed file into a folder of the same file system: it appears with all its content at once.

        Raises:
            FileExistsError: The name is taken.
        """
        file = cls.__new__(cls)
        file._path, file.partial, file.left_bytes = path, path.with_name(path.name + ".partial"), 0
        # os.link follows the link in /proc only if src_dir_fd is given; an absolute path ignores its value.
        os.link(f"/proc/self/fd/{nameless}", file.partial, src_dir_fd=nameless, follow_symlinks=True)
        file.stream = os.fdopen(nameless, "r+b")
        file.stream.seek(0, os.SEEK_END)
        return file

    def _is_current(self, status: os.stat_result) -> bool:
        try:
            return os.path.samestat(os.lstat(self.partial), status)
        except FileNotFoundError:
            return False

    def begin(self, opening: bytes) -> None:
        """Replace its content by its first bytes."""
        if self.left_bytes:
            self.stream.truncate(0)
        self.stream.write(opening)
        self.stream.flush()

    def finish(self) -> None:
        """Rename it, then release the lock: in this order, no other process can take it in between."""
        self.stream.flush()
        os.replace(self.partial, self._path)
        self.stream.close()

    def discard(self) -> None:
        """Remove it unless a killed process left content in it, and release the lock."""
        if not self.left_bytes:
            self.partial.unlink(missing_ok=True)
        self.stream.close()


def nameless(folder: Path, opening: bytes) -> int | None:
    """Descriptor of a locked file with its first bytes that has no name yet, so that a kill leaves no file.

    None if the operating system or the file system does not support unnamed files.

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
