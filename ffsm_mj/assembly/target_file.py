"""Waypoints of a target from a file: written into the scenario, which then needs the file no more."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.log.recorded_files import read_recorded
from ffsm_mj.records.recorded_table import RecordedTable, TableError
from ffsm_mj.scenario.scenario import ScenarioConfig, located
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.scenario.task_config import TargetWaypoint, TaskConfig, TrajectoryConfig
from ffsm_mj.similar_names import similar_file

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
    path = Path(os.path.normpath(source.folder(_PATH) / task.trajectory.file))
    try:
        if not os.path.lexists(path):
            raise InputError(f"no such file {path}{similar_file(path)}")
        waypoints = _waypoints(read_recorded(path).table, task, task.trajectory.start_s)
    except (InputError, TableError) as error:
        lines = error.lines if isinstance(error, InputError) else [str(error)]
        raise located(ScenarioFaults([Fault(line, _PATH) for line in lines]), source) from error
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
