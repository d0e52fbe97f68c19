"""Paths of campaign files and files like them, and names of the shipped ones."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.scenario.shipped import scenarios_dir
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml.parser import read_node


@dataclass(frozen=True)
class ShippedFiles:
    """Files of one kind, of which some are shipped with the package.

    Attributes:
        kind: What such a file describes; also the key that each of them has.
        folder: Name of the folder of the shipped ones, below that of the shipped scenarios.
    """

    kind: str
    folder: str

    @property
    def directory(self) -> Path:
        """Folder of the shipped files; the shipped scenarios are in its parent."""
        return scenarios_dir() / self.folder

    def names(self) -> tuple[str, ...]:
        """Names of the shipped files, which commands accept, sorted."""
        return tuple(sorted(path.stem for path in self.directory.glob("*.yaml")))

    def path(self, given: str | Path) -> Path:
        """Path of a file from a path or the name of a shipped file.

        Raises:
            InputError: The text is neither a file nor the name of a shipped one.
        """
        text = str(given)
        if os.path.exists(text) and text not in self.names():
            return Path(given)
        if text.endswith((".yaml", ".yml")) or "/" in text:
            raise InputError(f"{text}: no such {self.kind} file{similar_file(Path(text))}")
        if text not in self.names():
            raise InputError(f"{text}: no such file, and {unknown_name(f'shipped {self.kind}', text, self.names())}")
        return self.directory / f"{text}.yaml"

    def described(self) -> dict[str, str]:
        """Descriptions of the shipped files by name."""
        return {name: str(read_node(self.path(name)).plain().get("description", "")) for name in self.names()}

    def has(self, given: str | Path) -> bool:
        """Whether a path or name is that of a file of this kind, not of a scenario."""
        try:
            return os.path.isfile(path := self.path(given)) and self.kind in read_node(path).value
        except InputError:
            return False  # it is then read as a scenario, which reports the fault


CAMPAIGNS = ShippedFiles("campaign", "campaigns")
