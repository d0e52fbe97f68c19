"""The folder that a run leaves: log, recording, inputs that run again, summary."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ffsm_mj.errors import InputError, LogWriteError
from ffsm_mj.log.mcap_sink import McapSink
from ffsm_mj.log.sink import RunHeader, Sink
from ffsm_mj.model import System

LOG = "run.mcap"
PARTIAL_LOG = "run.mcap.partial"
RECORDING = "run.rrd"
SCENARIO = "scenario.yaml"
SUMMARY = "summary.json"
_OURS = (LOG, PARTIAL_LOG, RECORDING, SCENARIO, SUMMARY)


def default_folder(scenario_name: str) -> Path:
    """``logs/<scenario>-<UTC time>`` below the current folder, with a number behind where that exists."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    base = Path("logs") / f"{scenario_name}-{stamp}"
    candidates = [base, *(base.with_name(f"{base.name}-{i}") for i in range(2, 1000))]
    return next(path for path in candidates if not path.exists())


def link_latest(folder: Path) -> None:
    """Point ``logs/latest`` to a folder in ``logs/``; where links are not possible, leave it."""
    link = folder.parent / "latest"
    try:
        temporary = link.with_name(f".latest-{os.getpid()}")
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(folder.name, target_is_directory=True)
        os.replace(temporary, link)
    except OSError:
        return


@dataclass(frozen=True)
class RunFolder:
    """A folder for one run."""

    path: Path

    @property
    def log(self) -> Path:
        """The log, by the name that it has now."""
        return self.path / (LOG if (self.path / LOG).is_file() else PARTIAL_LOG)

    @classmethod
    def create(cls, path: Path, *, force: bool) -> RunFolder:
        """Make the folder, or take one that holds no run.

        Raises:
            InputError: It holds a run and ``force`` is not given, or cannot be made.
        """
        held = [name for name in _OURS if (path / name).exists()]
        if held and not force:
            raise InputError(f"{path}: holds a run already ({held[0]}); choose another --out, or --force to replace it")
        try:
            path.mkdir(parents=True, exist_ok=True)
            for name in held:
                (path / name).unlink()
        except OSError as error:
            raise InputError(f"{path}: cannot be used as a run folder ({error.strerror})") from error
        return cls(path)

    def write_inputs(self, header: RunHeader) -> None:
        """Write the resolved scenario and the models it refers to.

        Raises:
            LogWriteError: A file cannot be written (full disk).
        """
        for name, content in {SCENARIO: header.scenario_yaml.encode(), **header.files}.items():
            file = self.path / name
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
            except OSError as error:
                raise LogWriteError(file, error) from error

    def sinks(self, system: System, *, with_rerun: bool, view_rate_hz: float) -> list[Sink]:
        """The log, and the recording where it is wanted."""
        sinks: list[Sink] = [McapSink(self.path / LOG, system, view_rate_hz)]
        if with_rerun:
            # Rerun reports an error at the end of its file (full disk) on stderr and nowhere else.
            os.environ.setdefault("RUST_LOG", "error")
            from ffsm_mj.log.rerun_sink import RerunSink  # a second to import, for those who want a recording

            sinks.append(RerunSink(self.path / RECORDING, system, view_rate_hz))
        return sinks

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write ``summary.json``, whole or not at all; a full disk here loses nothing that the log does not hold."""
        file = self.path / SUMMARY
        try:
            file.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        except OSError:
            file.unlink(missing_ok=True)


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
