"""Folder of a campaign; it holds everything that is needed to continue the campaign on any machine."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.storage.exclusive import LOCK, exclusive, is_unfinished, write_whole
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import option
from ffsm_mj.log.run_folder import SUMMARY
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.output_place import refuse_link
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml.parser import write_yaml

CAMPAIGN = "campaign.yaml"
DESIGN = "design.json"
TABLE = "rows.sqlite"
SCENARIO = "scenario/scenario.yaml"
RERUNS = "reruns"


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
        """Whether the folder holds a campaign: the design is written before the first run."""
        return (self.path / DESIGN).is_file()

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
        for name in (LOCK, CAMPAIGN, DESIGN, TABLE, "scenario", RERUNS):
            refuse_link(self.path / name)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Context with exclusive access for one driver; the operating system releases the lock when the process ends.

        Raises:
            InputError: Another process runs this campaign, or the folder cannot be created.
        """
        self.refuse_links()
        with exclusive(self.path, "campaign"):
            yield

    def write(self, config: Mapping[str, Any], scenario_yaml: str, files: Mapping[str, bytes], design: Design) -> None:
        """Write all files of a new campaign; the design comes last and marks the folder as complete.

        Args:
            config: The campaign file.
            scenario_yaml: Resolved base scenario.
            files: Model files by name.
            design: Samples of all runs.

        Raises:
            InputError: The folder holds other files.
            LogWriteError: A file cannot be written (full disk).
        """
        ours = (LOCK, CAMPAIGN, TABLE, "scenario")
        others = [
            each.name
            for each in self.path.iterdir()
            if each.name not in ours and not is_unfinished(each.name, (CAMPAIGN, DESIGN))
        ]
        if others:
            raise InputError(f"{self.path}: holds {sorted(others)[0]} but no campaign; choose another {option('out')}")
        if (self.path / CAMPAIGN).is_file() and (self.path / CAMPAIGN).read_bytes() != _file_content(config):
            raise InputError(f"{self.path}: holds {CAMPAIGN}, which would be overwritten; choose another {option('out')}")
        models = {f"scenario/{name}": data for name, data in files.items()}
        for name, data in {SCENARIO: scenario_yaml.encode(), **models}.items():
            write_whole(self.path / name, data)
        self.write_config(config)
        self.write_design(design)

    def write_config(self, config: Mapping[str, Any]) -> None:
        """Write the campaign file; its scenario is the one in the folder."""
        write_whole(self.path / CAMPAIGN, _file_content(config))

    def write_design(self, design: Design) -> None:
        """Write the design, completely or not at all."""
        write_whole(self.path / DESIGN, design.to_json().encode())

    def design(self) -> Design:
        """Read the design.

        Raises:
            InputError: There is none, or it cannot be read.
        """
        file = self.path / DESIGN
        try:
            return Design.from_json(file.read_text(encoding="utf-8"))
        except OSError as error:
            there = self.path.is_dir()
            what = f"holds no campaign (no {DESIGN})" if there else f"no such campaign folder{similar_file(self.path)}"
            raise InputError(f"{self.path}: {what}") from error
        except InputError as error:
            raise InputError(f"{file}: {error}") from error


def _file_content(config: Mapping[str, Any]) -> bytes:
    """Content of the campaign file; its scenario is the one in the folder."""
    return write_yaml({**config, "scenario": SCENARIO, "overrides": {}}).encode()
