"""Run folders: log, recording, the inputs of the run, and its summary."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, LogWriteError
from ffsm_mj.invocation import command, option
from ffsm_mj.log.earlier_run import existing, remove, replaceable
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.partial_file import PartialFile, nameless
from ffsm_mj.log.recorder import Sink
from ffsm_mj.log.rerun.viewer import rust_log
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.similar_names import similar_file

LOG = "run.mcap"
PARTIAL_LOG = "run.mcap.partial"
RECORDING = "run.rrd"
SCENARIO = "scenario.yaml"
SUMMARY = "summary.json"
SENSITIVITY = "sensitivity.csv"
_RUN_FILES = (LOG, PARTIAL_LOG, RECORDING, SCENARIO, SUMMARY, SENSITIVITY)


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
        return self.path / (LOG if (self.path / LOG).is_file() else PARTIAL_LOG)

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

    def sinks(self, header: RunHeader, system: System, *, with_rerun: bool, view_rate_hz: float) -> list[Sink]:
        """Sinks for the log (opening it creates the folder), for the inputs, and optionally for the recording."""
        sinks: list[Sink] = [
            McapSink(lambda opening: self._take(opening, header.files), system, view_rate_hz),
            _Inputs(self),
        ]
        if with_rerun:
            # Rerun reports an error at the end of its file, such as a full disk, on stderr only.
            with rust_log("error"):
                from ffsm_mj.log.rerun.sink import RerunSink  # importing it takes a second

            sinks.append(RerunSink(lambda: self.path / RECORDING, system, view_rate_hz))
        return sinks

    def _take(self, opening: bytes, models: Iterable[str]) -> PartialFile:
        """Create the folder, or use one without a run, and create the log in it, locked for this run.

        The opening bytes of the log are written before the folder is created, and the log appears with them: a kill leaves
        either no folder, or a folder with a readable log.

        Raises:
            InputError: It contains a run and ``force`` is not set, another run is being written there, or it is unusable.
            LogWriteError: The log cannot be written (full disk).
        """
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
            file.begin(opening)
        return file

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
            taken = existing(self.path, names)
            self._refuse([name for name in taken if name != PARTIAL_LOG or file.left_bytes])
        except BaseException:
            file.discard()
            raise
        return file

    def _log(self) -> PartialFile:
        try:
            return PartialFile(self.path / LOG)
        except BlockingIOError as error:
            raise InputError(f"{self.path}: another run is being written there; choose another {option('out')}") from error

    def _refuse(self, taken: Sequence[str]) -> None:
        if taken and not self._force:
            holds = f"a run ({taken[0]})" if taken[0] in _RUN_FILES else f"{taken[0]}, a name that the run needs"
            remedy = f"choose another {option('out')}, or {option('force', 'True')} to replace a run"
            raise InputError(f"{self.path}: already contains {holds}; {remedy}")
        if self._force:
            self._replaced = replaceable(self.path, taken, (LOG, PARTIAL_LOG), _RUN_FILES)

    def write_inputs(self, header: RunHeader) -> None:
        """Remove the files of the replaced run, and write the resolved scenario and its model files.

        Raises:
            LogWriteError: A file cannot be written (full disk).
        """
        file = self.path
        try:
            remove(self.path, [name for name in self._replaced if name != PARTIAL_LOG])
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
    if taken := existing(folder, contents):
        raise InputError(f"{folder}: already contains {taken[0]}; choose another folder")
    try:
        for name, content in contents.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from error
    return folder / SCENARIO


class _Inputs:
    """Sink that writes scenario and models when the run is opened, and ignores rows and events."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder

    def open(self, header: RunHeader) -> None:
        self._folder.write_inputs(header)

    def rows(self, block: FloatArray) -> None: ...

    def event(self, event: Event) -> None: ...

    def flush(self) -> None: ...

    def close(self, outcome: OutcomeRecord | None) -> None: ...


def holds_log(path: Path) -> bool:
    """Whether a path is a run: a folder with a log, or a log."""
    if path.is_file():
        return path.name.endswith((Path(LOG).suffix, Path(LOG).suffix + Path(PARTIAL_LOG).suffix))
    return any((path / name).is_file() for name in (LOG, PARTIAL_LOG))


def find_log(run: Path) -> Path:
    """Path of the log of a run, given its folder or the log itself.

    Raises:
        InputError: There is no log.
    """
    if run.is_dir():
        for name in (LOG, PARTIAL_LOG):
            if (run / name).is_file():
                return run / name
        raise InputError(f"{run}: contains no {LOG}")
    if not run.is_file():
        hint = f"; run '{command('run', 'baseline')}' first" if run.name == "latest" else ""
        raise InputError(f"{run}: no such run{similar_file(run) or hint}")
    return run


def finished_recording(run: Path) -> Path | None:
    """Path of the recording of a finished run; None if it must be made from the log, as it is missing or incomplete."""
    recording = run / RECORDING
    return recording if recording.is_file() and (run / LOG).is_file() else None
