"""The folder that a run leaves: log, recording, inputs that run again, summary."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, LogWriteError
from ffsm_mj.log.earlier_run import in_the_way, remove, replaceable
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.partial_file import PartialFile, nameless
from ffsm_mj.log.recorder import Sink
from ffsm_mj.log.rerun.viewer import rust_log
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader

LOG = "run.mcap"
PARTIAL_LOG = "run.mcap.partial"
RECORDING = "run.rrd"
SCENARIO = "scenario.yaml"
SUMMARY = "summary.json"
_OURS = (LOG, PARTIAL_LOG, RECORDING, SCENARIO, SUMMARY)


class RunFolder:
    """A folder for one run. It is made when the run's log begins, not before: a start-up that is killed leaves nothing.

    Attributes:
        path: The folder; of one that is to get the next free name, the first that is tried, until it is made.
    """

    def __init__(self, path: Path, *, force: bool = False, next_name: bool = False) -> None:
        """Nothing is made yet.

        Args:
            path: The folder.
            force: Replace the run that it holds.
            next_name: Where it exists take the next name that does not, with a number behind.
        """
        self.path, self._force, self._next_name = path, force, next_name
        self._replaced: Sequence[str] = ()

    @property
    def log(self) -> Path:
        """The log, by the name that it has now."""
        return self.path / (LOG if (self.path / LOG).is_file() else PARTIAL_LOG)

    @classmethod
    def in_logs(cls, scenario_name: str) -> RunFolder:
        """``logs/<scenario>-<UTC time>`` below the current folder, with a number behind where that exists."""
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        return cls(Path("logs") / f"{scenario_name}-{stamp}", next_name=True)

    def sinks(self, header: RunHeader, system: System, *, with_rerun: bool, view_rate_hz: float) -> list[Sink]:
        """The log, which makes the folder when it is opened, then the inputs, and the recording where it is wanted."""
        sinks: list[Sink] = [
            McapSink(lambda opening: self._take(opening, header.files), system, view_rate_hz),
            _Inputs(self),
        ]
        if with_rerun:
            # Rerun reports an error at the end of its file (full disk) on stderr and nowhere else.
            with rust_log("error"):
                from ffsm_mj.log.rerun.sink import RerunSink  # a second to import, for those who want a recording

            sinks.append(RerunSink(lambda: self.path / RECORDING, system, view_rate_hz))
        return sinks

    def _take(self, opening: bytes, models: Iterable[str]) -> PartialFile:
        """Make the folder, or take one that holds no run, and the log in it, for this run alone.

        The log is written before the folder is made and appears in it whole: a kill comes before, or finds a log.

        Raises:
            InputError: It holds a run that is not to be replaced, another run is writing there, or it cannot be used.
            LogWriteError: The log cannot be written (full disk).
        """
        ready: int | None = None
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self._writing():
                ready = nameless(self.path.parent, opening)
            ours = self._make()
            if ours and ready is not None:
                try:
                    file, ready = PartialFile.appearing(self.path / LOG, ready), None
                    return file
                except FileExistsError:
                    ours = False  # another run found the new folder empty and took it
            file = self._log() if ours else self._claim([*_OURS, *models])
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
        """Make the folder; False where it is there already."""
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
        """The log's file, where nothing is in the way that may not be replaced."""
        self._refuse(in_the_way(self.path, names))
        if (self.path / PARTIAL_LOG).is_symlink():  # by force: the link goes, what it leads to stays
            (self.path / PARTIAL_LOG).unlink()
        file = self._log()
        try:
            # Once more: another run may have come and gone before the file was ours.
            taken = in_the_way(self.path, names)
            self._refuse([name for name in taken if name != PARTIAL_LOG or file.left_bytes])
        except BaseException:
            file.discard()
            raise
        return file

    def _log(self) -> PartialFile:
        try:
            return PartialFile(self.path / LOG)
        except BlockingIOError as error:
            raise InputError(f"{self.path}: another run is being written there; choose another --out") from error

    def _refuse(self, taken: Sequence[str]) -> None:
        if taken and not self._force:
            holds = f"a run already ({taken[0]})" if taken[0] in _OURS else f"{taken[0]}, a name that the run needs,"
            raise InputError(f"{self.path}: holds {holds}; choose another --out, or --force to replace a run")
        if self._force:
            self._replaced = replaceable(self.path, taken, (LOG, PARTIAL_LOG), _OURS)

    def write_inputs(self, header: RunHeader) -> None:
        """Write the resolved scenario and the models it refers to, in place of those of the run that is replaced.

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
        """Write ``summary.json``, whole or not at all; a full disk here loses nothing that the log does not hold."""
        file = self.path / SUMMARY
        unfinished = file.with_name(f".{file.name}-{os.getpid()}")
        try:
            with unfinished.open("x", encoding="utf-8") as stream:
                stream.write(json.dumps(summary, indent=2, allow_nan=False) + "\n")
            os.replace(unfinished, file)
        except OSError:
            unfinished.unlink(missing_ok=True)

    def link_latest(self) -> None:
        """Point ``latest`` beside the folder to it; where that is not possible, or something else has the name, leave it."""
        link = self.path.parent / "latest"
        unfinished = link.with_name(f".latest-{os.getpid()}")
        try:
            unfinished.symlink_to(self.path.name, target_is_directory=True)
            os.replace(unfinished, link)
        except OSError:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)


class _Inputs:
    """Writes scenario and models when the run is opened, and nothing while it goes."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder

    def open(self, header: RunHeader) -> None:
        self._folder.write_inputs(header)

    def rows(self, block: FloatArray) -> None: ...

    def event(self, event: Event) -> None: ...

    def flush(self) -> None: ...

    def close(self, outcome: OutcomeRecord | None) -> None: ...


def find_log(run: Path) -> Path:
    """The log of a run given as a folder or as the file itself.

    Raises:
        InputError: There is none.
    """
    if run.is_dir():
        for name in (LOG, PARTIAL_LOG):
            if (run / name).is_file():
                return run / name
        raise InputError(f"{run}: holds no {LOG}")
    if not run.is_file():
        hint = "; run 'ffsm run baseline' first" if run.name == "latest" else ""
        raise InputError(f"{run}: no such run{hint}")
    return run


def finished_recording(run: Path) -> Path | None:
    """The recording of a finished run; None where it must be made from the log: none was written, or it breaks off."""
    recording = run / RECORDING
    return recording if recording.is_file() and (run / LOG).is_file() else None
