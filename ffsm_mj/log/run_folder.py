"""Run folders: the files of a run, the log while it is written, and those of an earlier run that may be replaced."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Any

from mcap.records import Attachment, Metadata

from ffsm_mj.errors import InputError, LogError, LogWriteError
from ffsm_mj.invocation import command, option
from ffsm_mj.log.mcap.format import is_plain
from ffsm_mj.log.mcap.salvage import opened
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.similar_names import similar_file

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
            with suppress(FileNotFoundError):
                if os.path.samestat(os.lstat(self.partial), status):
                    break
            os.close(descriptor)  # another process completed or removed it before this one got the lock
        self.left_bytes = status.st_size
        self.stream = os.fdopen(descriptor, "r+b")

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

    def begin(self, opening: bytes) -> PartialFile:
        """Replace its content by its first bytes; returns the file itself."""
        if self.left_bytes:
            self.stream.truncate(0)
        self.stream.write(opening)
        self.stream.flush()
        return self

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


MODELS = "mjcf"
"""Folder of the model files in a run folder and in a log."""
RECORDED = "recorded"
"""Folder of the files with recorded numbers that control laws play, likewise."""
BEFORE = "before"
"""Folder of what is kept of the run from which a run goes on, likewise."""
_FOLDERS = (f"{MODELS}/", f"{RECORDED}/", f"{BEFORE}/")


def existing(folder: Path, names: Iterable[str]) -> list[str]:
    """Names, relative to a folder, that exist already; a broken symbolic link exists.

    Raises:
        InputError: A parent folder of one of them is a symbolic link, or is not a folder.
    """
    present = []
    for name in names:
        blocked = _blocked(folder, name)
        if blocked is not None:
            raise InputError(
                f"{blocked}: is not a regular folder, so the models of the run cannot be written there; move it away"
            )
        if os.path.lexists(folder / name):
            present.append(name)
    return present


def _above(folder: Path, name: str) -> list[Path]:
    """Folders between a folder and a file in it, innermost first."""
    return [folder / parent for parent in PurePosixPath(name).parents if parent.parts]


def _blocked(folder: Path, name: str) -> Path | None:
    """The innermost parent of a file that exists and is not a regular folder."""
    return next((path for path in _above(folder, name) if path.is_symlink() or (path.exists() and not path.is_dir())), None)


def _models(log: Path) -> list[str]:
    """Names of the files of models and of control laws in a log, as far as it is readable; others are ignored."""
    names = []
    with suppress(LogError), opened(log) as file:
        for record in takewhile(lambda record: isinstance(record, Metadata | Attachment), file.records()):
            if isinstance(record, Attachment) and record.name.startswith(_FOLDERS) and is_plain(record.name):
                names.append(record.name)
    return names


LOG = "run.mcap"
PARTIAL_LOG = "run.mcap.partial"
RECORDING = "run.rrd"
SCENARIO = "scenario.yaml"
SUMMARY = "summary.json"
SENSITIVITY = "sensitivity.csv"
# The partial log first: one that is renamed while names are looked up is then found by its other name.
_RUN_FILES = (PARTIAL_LOG, LOG, RECORDING, SCENARIO, SUMMARY, SENSITIVITY)


class RunFolder:
    """A folder for one run. It is created when the log is opened: a run that is killed earlier leaves nothing.

    Attributes:
        path: The folder; with ``next_name`` its first candidate until the folder is created.
    """

    def __init__(self, path: Path, *, force: bool = False, next_name: bool = False) -> None:
        """Remember the path; nothing is created yet.

        Args:
            path: The folder.
            force: Replace a run that it contains.
            next_name: If it exists, append the first number that gives a free name.
        """
        self.path, self._force, self._next_name = path, force, next_name
        self._replaced: Sequence[str] = ()

    @property
    def log(self) -> Path:
        """Path of the log, complete or partial."""
        return _log_in(self.path) or self.path / PARTIAL_LOG

    @classmethod
    def in_logs(cls, scenario_name: str) -> RunFolder:
        """Folder ``logs/<scenario>-<UTC time>`` below the current folder; a number is appended if it exists."""
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        return cls(Path("logs") / f"{scenario_name}-{stamp}", next_name=True)

    def refuse_earlier_run(self) -> None:
        """Refuse a folder that holds a run, before any work is done for the new one; its log repeats the check.

        Raises:
            InputError: It contains files of a run that may not be replaced, or no folder can have its name.
        """
        try:
            self.path.lstat()
        except FileNotFoundError:
            pass
        except OSError as error:
            raise InputError(f"{self.path}: cannot be used as a run folder ({error.strerror})") from error
        if not self._next_name:
            self._refuse(existing(self.path, _RUN_FILES))

    def take(self, opening: bytes, header: RunHeader) -> PartialFile:
        """Create the folder, or use one without a run, and in it the log, locked for this run, and the inputs of the run.

        The opening bytes of the log are written before the folder is created, and the log appears with them: a kill leaves
        either no folder, or a folder with a readable log.

        Raises:
            InputError: It contains a run and ``force`` is not set, another run is being written there, or it is unusable.
            LogWriteError: A file cannot be written (full disk).
        """
        file = self._locked(opening, header.files)
        try:
            self._write_inputs(header)
        except BaseException:
            file.stream.close()
            raise
        return file

    def _locked(self, opening: bytes, models: Iterable[str]) -> PartialFile:
        """Create the log with its opening bytes."""
        # Two runs may start in one folder at the same time. mkdir decides which one creates it; in an existing folder the
        # lock on the log decides, and every check is repeated under the lock.
        ready: int | None = None
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self._writing():
                ready = nameless(self.path.parent, opening)
            created = self._make()
            if created and ready is not None:
                try:
                    file, ready = PartialFile.appearing(self.path / LOG, ready), None
                    return file
                except FileExistsError:
                    created = False  # another run took the new, empty folder
            file = self._log() if created else self._claim([*_RUN_FILES, *models])
        except OSError as error:
            raise InputError(f"{self.path}: cannot be used as a run folder ({error.strerror})") from error
        finally:
            if ready is not None:
                os.close(ready)
        with self._writing():
            return file.begin(opening)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise LogWriteError(self.path / PARTIAL_LOG, error) from error

    def _make(self) -> bool:
        """Create the folder; False if it exists."""
        first, number = self.path, 1
        while True:
            try:
                self.path.mkdir()
            except FileExistsError:
                if not self._next_name:
                    return False
                number += 1
                self.path = first.with_name(f"{first.name}-{number}")
            else:
                return True

    def _claim(self, names: Sequence[str]) -> PartialFile:
        """Lock the log file in an existing folder, unless it contains files that may not be replaced."""
        self._refuse(existing(self.path, names))
        if (self.path / PARTIAL_LOG).is_symlink():  # with force: remove the link, not its target
            (self.path / PARTIAL_LOG).unlink()
        file = self._log()
        try:
            # Check again: another run may have finished before this one got the lock.
            present = existing(self.path, names)
            self._refuse([name for name in present if name != PARTIAL_LOG or file.left_bytes])
        except BaseException:
            file.discard()
            raise
        return file

    def _log(self) -> PartialFile:
        try:
            return PartialFile(self.path / LOG)
        except BlockingIOError as error:
            raise InputError(f"{self.path}: another run is being written there; choose another {option('out')}") from error

    def _refuse(self, present: Sequence[str]) -> None:
        if present and not self._force:
            holds = f"a run ({present[0]})" if present[0] in _RUN_FILES else f"{present[0]}, a name that the run needs"
            remedy = f"choose another {option('out')}, or {option('force', 'True')} to replace a run"
            raise InputError(f"{self.path}: already contains {holds}; {remedy}")
        if self._force:
            self._replaced = self._replaceable(present)

    def _replaceable(self, present: Sequence[str]) -> list[str]:
        """Files that ``force`` removes: those that every run writes, and the models that the log of the earlier run names.

        Args:
            present: Names that the new run needs and that exist.

        Raises:
            InputError: The folder is a symbolic link, it contains no run, or one of the names is not a file of a run.
        """
        folder, force = self.path, option("force", "True")
        if folder.is_symlink():
            raise InputError(f"{folder}: is a symbolic link, which {force} does not follow; give the folder itself")
        log = next((folder / name for name in (LOG, PARTIAL_LOG) if os.path.lexists(folder / name)), None)
        if present and log is None:
            only = f"{force} replaces runs only; choose another {option('out')}"
            raise InputError(f"{folder}: contains {present[0]} but no run, and {only}")
        # A folder may contain files of the user: only names that a run writes, or that its log lists, are removed.
        models = _models(log) if log is not None else []
        for name in present:
            if name not in _RUN_FILES and name not in models:
                raise InputError(f"{folder / name}: does not belong to the run that {force} replaces; move it away")
            if (folder / name).is_dir() and not (folder / name).is_symlink():
                raise InputError(f"{folder / name}: is a folder, but a run writes a file of this name; move it away")
        return [*_RUN_FILES, *(name for name in models if _blocked(folder, name) is None)]

    def _write_inputs(self, header: RunHeader) -> None:
        """Remove the files of the replaced run, of a symbolic link only the link, and write scenario and model files."""
        file = self.path
        try:
            for name in self._replaced:
                if name != PARTIAL_LOG:
                    (self.path / name).unlink(missing_ok=True)
                    for parent in _above(self.path, name):
                        with suppress(OSError):  # it is not empty
                            parent.rmdir()
            for name, content in {SCENARIO: header.scenario_yaml.encode(), **header.files}.items():
                file = self.path / name
                file.parent.mkdir(parents=True, exist_ok=True)
                with file.open("xb") as stream:
                    stream.write(content)
        except OSError as error:
            raise LogWriteError(file, error) from error

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write ``summary.json`` completely or, on a full disk, not at all: the log contains all its data."""
        file = self.path / SUMMARY
        unfinished = file.with_name(f".{file.name}-{os.getpid()}")
        try:  # a rename is atomic: a reader never sees half a summary
            with unfinished.open("x", encoding="utf-8") as stream:
                stream.write(json.dumps(summary, indent=2, allow_nan=False) + "\n")
            os.replace(unfinished, file)
        except OSError:
            unfinished.unlink(missing_ok=True)

    def add_to_summary(self, entries: dict[str, Any]) -> None:
        """Write ``summary.json`` again with other entries; no effect if there is none (full disk)."""
        with suppress(OSError):
            written = json.loads((self.path / SUMMARY).read_text(encoding="utf-8"))
            self.write_summary(written | entries)

    def link_latest(self) -> None:
        """Link ``latest`` beside the folder to it, unless links are unavailable or the name is taken."""
        link = self.path.parent / "latest"
        unfinished = link.with_name(f".latest-{os.getpid()}")
        try:
            unfinished.symlink_to(self.path.name, target_is_directory=True)
            os.replace(unfinished, link)
        except OSError:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)


def write_scenario(folder: Path, scenario_yaml: str, files: Mapping[str, bytes]) -> Path:
    """Write a scenario and the files that it names into a folder.

    Returns:
        The scenario file.

    Raises:
        InputError: The folder holds one of the files already, or cannot be written.
    """
    contents = {SCENARIO: scenario_yaml.encode(), **files}
    if present := existing(folder, contents):
        raise InputError(f"{folder}: already contains {present[0]}; choose another folder")
    try:
        for name, content in contents.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from error
    return folder / SCENARIO


def holds_log(path: Path) -> bool:
    """Whether a path is a run: a folder with a log, or a log."""
    if path.is_file():
        return path.name.endswith((Path(LOG).suffix, Path(LOG).suffix + Path(PARTIAL_LOG).suffix))
    return _log_in(path) is not None


def _log_in(folder: Path) -> Path | None:
    """The log in a folder, complete or partial; None if there is none."""
    return next((folder / name for name in (LOG, PARTIAL_LOG) if (folder / name).is_file()), None)


def find_log(run: Path) -> Path:
    """Path of the log of a run, given its folder or the log itself.

    Raises:
        InputError: There is no log.
    """
    if run.is_dir():
        if (log := _log_in(run)) is not None:
            return log
        raise InputError(f"{run}: contains no {LOG}")
    if not run.is_file():
        hint = f"; run '{command('run', 'baseline')}' first" if run.name == "latest" else ""
        raise InputError(f"{run}: no such run{similar_file(run) or hint}")
    return run


def finished_recording(run: Path) -> Path | None:
    """Path of the recording of a finished run; None if it must be made from the log, as it is missing or incomplete."""
    recording = run / RECORDING
    return recording if recording.is_file() and (run / LOG).is_file() else None
