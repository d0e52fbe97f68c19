"""Files with recorded numbers that the control laws of a scenario name: read once, and kept with the run."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ffsm_mj.config import RecordedInput, StrictModel
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.log.mcap.format import is_plain
from ffsm_mj.log.recorded_files import RecordedFile, read_recorded
from ffsm_mj.log.run_folder import RECORDED
from ffsm_mj.records.recorded_table import RecordedTable
from ffsm_mj.scenario.scenario import ScenarioConfig, located
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.similar_names import similar_file

KeyPath = tuple[str | int, ...]
PhaseTables = Mapping[KeyPath, Mapping[str, RecordedTable]]
"""Tables of each control law of a phase, by the keys in its section; laws by their keys in the phase."""


@dataclass(frozen=True)
class RecordedFiles:
    """The files of all control laws of a scenario.

    Attributes:
        tables: Table of each file, by the keys of the scenario that name it.
        names: Its name in run folder and log, by the same keys.
        contents: Contents by these names.
    """

    tables: Mapping[KeyPath, RecordedTable] = field(default_factory=dict)
    names: Mapping[KeyPath, str] = field(default_factory=dict)
    contents: Mapping[str, bytes] = field(default_factory=dict)

    def of_phase(self, phase: int) -> PhaseTables:
        """Tables of the control laws of a phase, given by its position."""
        found: dict[KeyPath, dict[str, RecordedTable]] = {}
        for (_, i, *law, key), table in self.tables.items():
            if i == phase:
                found.setdefault(tuple(law), {})[str(key)] = table
        return found


def recorded_files(scenario: ScenarioConfig, source: YamlSource) -> RecordedFiles:
    """Read the files.

    Raises:
        InputError: One is missing or holds no table.
    """
    tables: dict[KeyPath, RecordedTable] = {}
    names: dict[KeyPath, str] = {}
    contents: dict[str, bytes] = {}
    faults = []
    for keys, given in _named(scenario):
        path = Path(os.path.normpath(source.folder(keys) / given))
        try:
            if not os.path.lexists(path):
                raise InputError(f"no such file {path}{similar_file(path)}")
            found = read_recorded(path)
        except InputError as error:
            faults += [Fault(line, keys) for line in error.lines]
            continue
        tables[keys], names[keys] = found.table, _free_name(found, contents)
        contents[names[keys]] = found.content
    if faults:
        raise located(ScenarioFaults(faults), source)
    return RecordedFiles(tables, names, contents)


def _named(scenario: ScenarioConfig) -> Iterator[tuple[KeyPath, str]]:
    """Keys of the scenario that name a file, and its path."""
    for i, phase in enumerate(scenario.phases):
        for law, config in phase.laws.items():
            for key in _file_keys(config):
                yield ("phases", i, *law, key), getattr(config, key)


def _file_keys(config: Any) -> list[str]:
    """Keys of the configuration of a control law that name a file."""
    if not isinstance(config, StrictModel):
        return []
    fields = type(config).model_fields.items()
    return [key for key, each in fields if any(isinstance(mark, RecordedInput) for mark in each.metadata)]


def _free_name(file: RecordedFile, taken: Mapping[str, bytes]) -> str:
    """Name of a file in run folder and log: its own, below a number where another file has it."""
    own = file.name if is_plain(file.name) else "recorded"
    name, number = f"{RECORDED}/{own}", 1
    while taken.get(name, file.content) != file.content:
        number += 1
        name = f"{RECORDED}/{number}/{own}"
    return name
