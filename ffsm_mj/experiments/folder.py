"""Folder of a campaign: files that are written whole, one process at a time."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from filelock import FileLock, Timeout
from pydantic import TypeAdapter, ValidationError

from ffsm_mj.config import first_fault
from ffsm_mj.errors import InputError, one_line
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.invocation import option
from ffsm_mj.log.run_folder import SUMMARY
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.output_place import UNFINISHED, new_file, refuse_link
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml import write_yaml

CAMPAIGN, DESIGN, TABLE, SCENARIO = "campaign.yaml", "design.json", "rows.sqlite", "scenario/scenario.yaml"
RECORD, METRICS, VARIANTS, RERUNS, LOCK = "record.json", "metrics.py", "variants", "reruns", "driver.lock"
_ALL = (LOCK, CAMPAIGN, DESIGN, TABLE, "scenario", RECORD, METRICS, VARIANTS, RERUNS)


@dataclass(frozen=True)
class Record:
    """What the folder of a campaign holds besides the campaign file.

    Attributes:
        not_applicable: Why the control laws of a variant cannot be created for its scenario, by name of the variant.
        metrics: Names of metrics that are functions of the caller.
        metrics_file: Name of the Python file that defines them, whose copy is in the folder; empty for those of a script.
        format: Version of the file.
    """

    not_applicable: Mapping[str, str] = field(default_factory=dict)
    metrics: tuple[str, ...] = ()
    metrics_file: str = ""
    format: Literal[1] = 1


class CampaignFolder:
    """File names and files of a campaign.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        """Store the path; nothing is created."""
        self.path = path

    @property
    def is_initialized(self) -> bool:
        """Whether the folder holds a campaign: its record is written last, before the first run."""
        return (self.path / RECORD).is_file()

    @property
    def has_variants(self) -> bool:
        """Whether the folder holds the variants of a campaign."""
        return (self.path / VARIANTS).is_dir()

    def variant(self, name: str) -> CampaignFolder:
        """Folder of a variant, which is a campaign."""
        return CampaignFolder(self.path / VARIANTS / name)

    @property
    def table(self) -> Path:
        """Path of the SQLite file with the rows."""
        return self.path / TABLE

    @property
    def scenario(self) -> Path:
        """Path of the resolved base scenario, beside its models."""
        return self.path / SCENARIO

    def rerun(self, index: int) -> Path:
        """Run folder of a repeated run."""
        return self.path / RERUNS / f"{index:06d}"

    def has_rerun(self, index: int) -> bool:
        """Whether a run was repeated without interruption."""
        try:
            summary = json.loads((self.rerun(index) / SUMMARY).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        return bool(summary.get("outcome") != Outcome.INTERRUPTED)

    def refuse_links(self) -> None:
        """Refuse symbolic links inside the folder: nothing is written through them. The folder itself may be a link.

        Raises:
            InputError: A file or folder of the campaign is a symbolic link.
        """
        variants = self.path / VARIANTS
        for path in (*(self.path / name for name in _ALL), *(variants.iterdir() if self.has_variants else ())):
            refuse_link(path)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Context with exclusive access for one driver; the operating system releases the lock when the process ends.

        Raises:
            InputError: Another process runs this campaign, or the folder cannot be created.
        """
        self.refuse_links()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.path / LOCK)
            lock.acquire(timeout=0)
        except Timeout as error:
            raise InputError(f"{self.path}: another process is running this campaign") from error
        except OSError as error:
            raise InputError(f"{self.path}: cannot be used as a campaign folder ({error.strerror})") from error
        try:
            yield
        finally:
            lock.release()

    def refuse_other_files(self, config: CampaignFile) -> None:
        """Refuse a folder that holds anything but a campaign that has not begun.

        Raises:
            InputError: It holds another file, or another campaign file.
        """
        for name in sorted(entry.name for entry in self.path.iterdir()):
            if name not in _ALL and not UNFINISHED.fullmatch(name):
                raise InputError(f"{self.path}: holds {name} but no campaign; choose another {option('out')}")
        file = self.path / CAMPAIGN
        if file.is_file() and file.read_bytes() != _content(config):
            raise InputError(f"{self.path}: holds {CAMPAIGN}, which would be overwritten; choose another {option('out')}")

    def write_runs(self, scenario_yaml: str, files: Mapping[str, bytes], design: Design) -> None:
        """Write what the runs of a new campaign are made of.

        Args:
            scenario_yaml: Resolved base scenario.
            files: Model files by name.
            design: Samples of all runs.

        Raises:
            OutputLostError: A file cannot be written (full disk).
        """
        for name, data in {SCENARIO: scenario_yaml.encode(), **{f"scenario/{n}": data for n, data in files.items()}}.items():
            self._write(name, data)
        self.write_design(design)

    def write_record(self, config: CampaignFile, record: Record, metrics: str) -> None:
        """Write the campaign file, a copy of the metrics file, which is never executed, and last the record.

        Args:
            config: The campaign file.
            record: What the folder holds besides it.
            metrics: Content of the metrics file; empty: there is none, or that of before stays.

        Raises:
            OutputLostError: A file cannot be written (full disk).
        """
        self.write_config(config)
        if metrics:
            self._write(METRICS, metrics.encode())
        self._write(RECORD, json.dumps(asdict(record), indent=1).encode())

    def write_config(self, config: CampaignFile) -> None:
        """Write the campaign file; without variants, its scenario is the one in the folder."""
        self._write(CAMPAIGN, _content(config))

    def write_design(self, design: Design) -> None:
        """Write the design."""
        self._write(DESIGN, design.to_json().encode())

    def _write(self, name: str, data: bytes) -> None:
        """Write a file, completely or not at all; its folder is created if it does not exist."""
        file = self.path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        with new_file(file) as place:
            place.write_bytes(data)

    def record(self) -> Record:
        """Read what the folder holds besides the campaign file.

        Raises:
            InputError: There is none, or it cannot be read.
        """
        try:
            return TypeAdapter(Record).validate_json(self._text(RECORD), strict=True)
        except ValueError as error:
            why = first_fault(error) if isinstance(error, ValidationError) else one_line(str(error))
            raise InputError(f"{self.path / RECORD}: is not the record of a campaign ({why})") from error

    def design(self) -> Design:
        """Read the design.

        Raises:
            InputError: There is none, or it cannot be read.
        """
        text = self._text(DESIGN)
        try:
            return Design.from_json(text)
        except InputError as error:
            raise InputError(f"{self.path / DESIGN}: {error}") from error

    def _text(self, name: str) -> str:
        """Content of a file that every campaign has.

        Raises:
            InputError: There is none.
        """
        try:
            return (self.path / name).read_text(encoding="utf-8")
        except OSError as error:
            there = self.path.is_dir()
            what = f"holds no campaign (no {name})" if there else f"no such campaign folder{similar_file(self.path)}"
            raise InputError(f"{self.path}: {what}") from error


def _content(config: CampaignFile) -> bytes:
    """Content of the campaign file."""
    keys = config.model_dump(mode="json", exclude_none=True)
    return write_yaml(keys if config.variants else keys | {"scenario": SCENARIO, "overrides": {}}).encode()
