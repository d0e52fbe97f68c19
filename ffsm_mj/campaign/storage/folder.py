"""The folder of a campaign: all that is needed to go on with it, anywhere."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.errors import InputError, LogWriteError
from ffsm_mj.log.run_folder import SUMMARY
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.output_place import refuse_link
from ffsm_mj.scenario.source import write_yaml

CAMPAIGN = "campaign.yaml"
DESIGN = "design.json"
TABLE = "rows.sqlite"
SCENARIO = "scenario/scenario.yaml"
RERUNS = "reruns"
_LOCK = "driver.lock"


class CampaignFolder:
    """Names and files of a campaign.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        """Nothing is made yet."""
        self.path = path

    @property
    def begun(self) -> bool:
        """Whether it holds a campaign: its design is written, before the first run."""
        return (self.path / DESIGN).is_file()

    @property
    def table(self) -> Path:
        """The SQLite file."""
        return self.path / TABLE

    @property
    def scenario(self) -> Path:
        """The base scenario, every default written out, beside its models."""
        return self.path / SCENARIO

    def rerun(self, index: int) -> Path:
        """Run folder of a run that was made again."""
        return self.path / RERUNS / f"{index:06d}"

    def has_rerun(self, index: int) -> bool:
        """Whether a run was made again, to its end."""
        try:
            summary = json.loads((self.rerun(index) / SUMMARY).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        return bool(summary.get("outcome") != Outcome.INTERRUPTED)

    def refuse_links(self) -> None:
        """Refuse to write into a folder through symbolic links, which may lead anywhere; the folder itself may be one.

        Raises:
            InputError: One of its names is a symbolic link.
        """
        for name in (_LOCK, CAMPAIGN, DESIGN, TABLE, "scenario", RERUNS):
            refuse_link(self.path / name)

    @contextmanager
    def driven(self) -> Iterator[None]:
        """One driver at a time; the operating system gives the lock back when a process ends, however.

        Raises:
            InputError: Another process drives this campaign, or the folder cannot be made.
        """
        self.refuse_links()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.path / _LOCK)
            lock.acquire(timeout=0)
        except Timeout as error:
            raise InputError(f"{self.path}: another process is running this campaign") from error
        except OSError as error:
            raise InputError(f"{self.path}: cannot be used as a campaign's folder ({error.strerror})") from error
        try:
            yield
        finally:
            lock.release()

    def write(self, config: Mapping[str, Any], scenario_yaml: str, files: Mapping[str, bytes], design: Design) -> None:
        """Write what the runs are made of; the design last, which says that all the rest is there.

        Args:
            config: The campaign file.
            scenario_yaml: Its base scenario with every default written out.
            files: Models by name.
            design: What is drawn.

        Raises:
            InputError: Something else is there.
            LogWriteError: A file cannot be written (full disk).
        """
        ours = (_LOCK, CAMPAIGN, TABLE, "scenario")
        unfinished = (f".{CAMPAIGN}-", f".{DESIGN}-")  # of a process that was killed as it began
        others = [
            each.name for each in self.path.iterdir() if each.name not in ours and not each.name.startswith(unfinished)
        ]
        if others:
            raise InputError(f"{self.path}: holds {sorted(others)[0]} and no campaign; choose another --out")
        if (self.path / CAMPAIGN).is_file() and (self.path / CAMPAIGN).read_bytes() != _stated(config):
            raise InputError(f"{self.path}: holds {CAMPAIGN}, which would be overwritten; choose another --out")
        models = {f"scenario/{name}": data for name, data in files.items()}
        for name, data in {SCENARIO: scenario_yaml.encode(), **models}.items():
            self._put(name, data)
        self.write_config(config)
        self.write_design(design)

    def write_config(self, config: Mapping[str, Any]) -> None:
        """Write the campaign file, which means the scenario of the folder."""
        self._put(CAMPAIGN, _stated(config))

    def write_design(self, design: Design) -> None:
        """Write the design, whole or not at all."""
        self._put(DESIGN, design.to_json().encode())

    def design(self) -> Design:
        """The design.

        Raises:
            InputError: There is none, or it cannot be read.
        """
        file = self.path / DESIGN
        try:
            return Design.from_json(file.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"{self.path}: holds no campaign (no {DESIGN})") from error
        except InputError as error:
            raise InputError(f"{file}: {error}") from error

    def _put(self, name: str, data: bytes) -> None:
        file = self.path / name
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


def _stated(config: Mapping[str, Any]) -> bytes:
    """The campaign file as it is written, which means the scenario of the folder."""
    return write_yaml({**config, "scenario": SCENARIO, "overrides": {}}).encode()
