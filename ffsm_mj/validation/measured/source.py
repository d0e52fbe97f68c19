"""Where measured data come from, reading a user's copy of them, and what a group reports."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.identification.fit import Interval

Progress = Callable[..., Callable[[float, float], None] | None]
"""Begins a stage of work: name, what is counted, how many; returns a callback of what is done, if that is displayed."""


@dataclass(frozen=True)
class DataSource:
    """A public repository whose data a group reads.

    Attributes:
        repository: Owner and name on GitHub.
        commit: The version that was examined.
        licence: Of the data.
        digests: SHA-256 of what the group reads at that commit, by path in the repository.
        citation: Who measured.
    """

    repository: str
    commit: str
    licence: str
    digests: Mapping[str, str]
    citation: str

    @property
    def named(self) -> str:
        """The repository and its version."""
        return f"github.com/{self.repository} at commit {self.commit}"

    def read(self, folder: Path, file: str) -> bytes:
        """Contents of a file in a copy of the repository.

        Raises:
            InputError: There is no such folder, or no such file in it.
        """
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; --data takes a copy of {self.named}")
        path = folder / file
        try:
            return path.read_bytes()
        except OSError as error:
            raise InputError(
                f"{path}: cannot be read ({error.strerror or error}); --data takes a copy of {self.named}, with {file}"
            ) from error


def digest(data: bytes) -> str:
    """SHA-256 of some data, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


@dataclass(frozen=True)
class ReportTable:
    """A table of a report.

    Attributes:
        title: What it shows.
        head: Names of the columns, with units.
        rows: Cells.
        note: What it says and what not; may be empty.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class GroupReport:
    """What a group computed from the data.

    Attributes:
        digests: SHA-256 by file.
        notices: What is unexpected in the data, as a frame of the other handedness.
        failures: What is wrong with our numbers: checks of runs that fail, a law that is not its closed form.
        versions: Files that are not those of the examined version, a line for each.
        tables: The results.
        may: What may be claimed by these numbers.
        may_not: What may not.
        curves: Arrays of the figure by name.
    """

    digests: Mapping[str, str]
    versions: tuple[str, ...]
    notices: tuple[str, ...]
    failures: tuple[str, ...]
    tables: tuple[ReportTable, ...]
    may: tuple[str, ...]
    may_not: tuple[str, ...]
    curves: Mapping[str, FloatArray]


def other_versions(source: DataSource, digests: Mapping[str, str]) -> tuple[str, ...]:
    """One line for each file that is not that of the examined version."""
    return tuple(
        f"{file}: not that of {source.named} (SHA-256 of what is read {value[:12]}..., there"
        f" {source.digests[file][:12]}...): the numbers are those of another version of the data"
        for file, value in digests.items()
        if value != source.digests[file]
    )


def shown(interval: Interval, digits: int) -> str:
    """A value with its interval."""
    return f"{interval.value:.{digits}f} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"
