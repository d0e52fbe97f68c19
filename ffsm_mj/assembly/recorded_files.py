"""Files with numbers that a scenario names, read once and kept with the run, and the scenario as a log keeps it.

The waypoints of a target are written into the scenario, which then needs their file no more.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ffsm_mj.config import RecordedInput, StrictModel
from ffsm_mj.errors import Fault, Faults, InputError, ScenarioFaults
from ffsm_mj.log.mcap.format import is_plain
from ffsm_mj.log.recorded_files import RecordedFile, read_recorded
from ffsm_mj.log.run_folder import BEFORE, RECORDED
from ffsm_mj.model.files import logged_name, stored_with
from ffsm_mj.model.system import System
from ffsm_mj.records.recorded_table import RecordedTable, TableError
from ffsm_mj.scenario.scenario import ScenarioConfig, TargetWaypoint, TaskConfig, TrajectoryConfig
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml import KeyPath, write_yaml

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
        tables: dict[KeyPath, dict[str, RecordedTable]] = {}
        for (_, i, *law, key), table in self.tables.items():
            if i == phase:
                tables.setdefault(tuple(law), {})[str(key)] = table
        return tables


def recorded_files(scenario: ScenarioConfig, source: YamlSource) -> RecordedFiles:
    """Read the files.

    Raises:
        InputError: One is missing or holds no table.
    """
    tables: dict[KeyPath, RecordedTable] = {}
    names: dict[KeyPath, str] = {}
    contents: dict[str, bytes] = {}
    with source.locating(), Faults() as faults:
        for keys, name in _named(scenario):
            with faults.below(*keys):
                file = _read(source, keys, name)
                tables[keys], names[keys] = file.table, _free_name(file, contents)
                contents[names[keys]] = file.content
    return RecordedFiles(tables, names, contents)


def _read(source: YamlSource, keys: KeyPath, name: str) -> RecordedFile:
    """The file that a key names.

    Raises:
        ScenarioFaults: It is missing or holds no table.
    """
    path = source.beside(keys, name)
    try:
        if not os.path.lexists(path):
            raise InputError(f"no such file {path}{similar_file(path)}")
        return read_recorded(path)
    except InputError as error:
        raise ScenarioFaults([Fault(line) for line in error.lines]) from error


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
    return [key for key, field in fields if any(isinstance(mark, RecordedInput) for mark in field.metadata)]


def _free_name(file: RecordedFile, contents: Mapping[str, bytes]) -> str:
    """Name of a file in run folder and log: its own, below a number where another file has it."""
    plain = file.name if is_plain(file.name) else "recorded"
    name, number = f"{RECORDED}/{plain}", 1
    while contents.get(name, file.content) != file.content:
        number += 1
        name = f"{RECORDED}/{number}/{plain}"
    return name


_MOST = 2000
_PATH = ("task", "trajectory", "file")


def with_waypoints(scenario: ScenarioConfig, source: YamlSource) -> ScenarioConfig:
    """The scenario with the waypoints of the file that its task names; the same one if it names none.

    Raises:
        InputError: There is no such file, or its waypoints are wrong.
    """
    task = scenario.task
    if task is None or task.trajectory is None or task.trajectory.file is None:
        return scenario
    with source.locating(), Faults() as faults, faults.below(*_PATH):
        try:
            waypoints = _waypoints(_read(source, _PATH, task.trajectory.file).table, task, task.trajectory.start_s)
        except TableError as error:
            raise ScenarioFaults([Fault(str(error))]) from error
    trajectory = TrajectoryConfig(start_s=task.trajectory.start_s, waypoints=waypoints)
    return scenario.model_copy(update={"task": task.model_copy(update={"trajectory": trajectory})})


def _waypoints(table: RecordedTable, task: TaskConfig, start_s: float) -> tuple[TargetWaypoint, ...]:
    """Rows of the table, without one at the start.

    Raises:
        TableError: A column is missing, or rows are wrong.
    """
    if not 1 <= len(table) <= _MOST:
        raise TableError(f"{table.place} has {len(table)} rows; 1 to {_MOST} are allowed")
    times, *places = (table.numbers(table.name_of(name)) for name in ("time_s", *(f"{axis}_m" for axis in task.axes)))
    positions = np.column_stack(places)
    first = int(times[0] == start_s)
    if first and np.abs(positions[0] - task.target_m).max() > 1e-9:
        began = ", ".join(f"{x:g}" for x in positions[0])
        raise TableError(f"{table.row_place(0)}: the target is at ({began}) at start_s; write that as target_m")
    wrong = np.flatnonzero(np.diff(times[first:], prepend=start_s) <= 0.0)
    if len(wrong):
        row = int(wrong[0]) + first
        raise TableError(f"{table.row_place(row)}: time_s is {times[row]:g}; times must ascend from start_s, {start_s:g} s")
    rows = zip(times[first:].tolist(), positions[first:].tolist(), strict=True)
    return tuple(TargetWaypoint(at_s=time_s, position_m=tuple(position)) for time_s, position in rows)


def resolved_yaml(scenario: ScenarioConfig, system: System, recorded: RecordedFiles) -> str:
    """YAML of a scenario that runs again from a run folder."""
    return write_yaml(resolved_data(scenario, system, recorded))


def resolved_data(scenario: ScenarioConfig, system: System, recorded: RecordedFiles) -> dict[str, Any]:
    """The same as plain data."""
    data = scenario.model_dump(mode="json", by_alias=True)
    if scenario.initial.from_ is not None:
        data["initial"]["from"] = BEFORE
    for name, files in system.files.items():
        part = data["robot"] if name == "robot" else data["objects"][name]
        stored = stored_with(name, system.files)
        part["mjcf"] = logged_name(stored, files.main)
        part["asset_folders"] = [] if files.beside else [logged_name(stored, "")]
        part["package_paths"] = []  # files of packages are stored beside the model
    for (*keys, last), name in recorded.names.items():
        section: Any = data
        for key in keys:
            section = section[key]
        section[last] = name
    without: dict[str, Any] = _without_none(data)
    return without


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return value if not isinstance(value, list) else [_without_none(item) for item in value]
