"""Recordings of motions: coordinates and velocities of bodies of a scenario over time, from CSV or Parquet files.

Columns are named as in our logs, ``state.q_cube_free_x_m``, or without what is clear: ``cube_x_mm`` for a body with a free
joint, ``base_yaw_deg`` for a hinge. The name ends in the unit; quaternions (w, x, y, z) have none.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.log.recorded_files import is_log, read_table
from ffsm_mj.model.system import Joint, System, Tree
from ffsm_mj.records.recorded_table import RecordedTable, TableError
from ffsm_mj.records.signals import coordinate_names, identifier, rate_names, unit_of

_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0}
_UNITS: dict[str, dict[str, float]] = {
    "m": _LENGTHS,
    "rad": _ANGLES,
    "m/s": {f"{unit}_s": factor for unit, factor in _LENGTHS.items()},
    "rad/s": {f"{unit}_s": factor for unit, factor in _ANGLES.items()},
    "": {},
}
"""Units that a column may have by the end of its name, with their factors, by the unit of the coordinate."""
_POSE = re.compile(r"(?:state\.)?(?:q_|v_)?(\w+?)_(?:(?:x|y|z)_(?:m|cm|mm|um)|q[wxyz]|v[xyz]_\w+|w[xyz]_\w+)")
"""Columns that are part of a pose or a velocity, with the name of what has it."""
_OTHERS = ("state.tip_", "state.target_")
"""Columns of our logs that are no coordinates; those of other groups than ``state`` are not either."""
_UNIT_LENGTH = 0.02
"""Most that the length of a quaternion may differ from 1: rounding to two decimals, not another order or another unit."""

_LARGEST = 1e6
"""Largest coordinate or velocity, SI: beyond it differences of samples are rounding, and MuJoCo takes no state."""

Kind = Literal["poses", "velocities"]


@dataclass(frozen=True)
class Recording:
    """Motion of one run.

    Attributes:
        place: Its file, and its run if the file has several, for messages.
        times: Ascending, s, (n,).
        qpos: Coordinates of the whole system, (n, nq); of trees that were not recorded those of the scenario.
        qvel: Velocities of the whole system, (n, nv); None: they were not recorded.
    """

    place: str
    times: FloatArray
    qpos: FloatArray
    qvel: FloatArray | None

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True)
class Recordings:
    """Recordings of the same trees of a system.

    Attributes:
        runs: The runs.
        trees: Trees that were recorded.
    """

    runs: tuple[Recording, ...]
    trees: tuple[Tree, ...]

    @property
    def dofs(self) -> IntArray:
        """Velocity coordinates of these trees."""
        return np.concatenate([np.arange(tree.dofs.start, tree.dofs.stop) for tree in self.trees])


def read_recordings(
    paths: Sequence[Path], system: System, start: FloatArray, kind: Kind | None = None, run_column: str | None = None
) -> Recordings:
    """Read recordings of a system.

    Args:
        paths: CSV or Parquet files, each with one run, or with several told apart by a column.
        system: Robot and objects.
        start: Coordinates of what is not recorded, (nq,).
        kind: ``poses``: leave out velocities; ``velocities``: they are needed; None: they are read if they are there.
        run_column: Column that tells runs apart; None: ``run``, if there is one.

    Raises:
        InputError: A file cannot be read, a column is missing or unknown, its unit is not stated or unknown, a cell is no
            finite number, times do not ascend, or files have different bodies.
    """
    runs: list[Recording] = []
    trees: tuple[Tree, ...] | None = None
    for path in paths:
        if is_log(path):
            raise InputError(f"{path}: is a run of ffsm-mj; 'ffsm export {path} --csv' writes a table of it")
        table = read_table(path).table
        try:
            columns = _Columns(table, system, kind)
            if trees is not None and columns.trees != trees:
                raise TableError(f"{table.place}: {_listed(columns.trees)} and in {paths[0]} {_listed(trees)}")
            trees = columns.trees
            runs += columns.runs(start, run_column)
        except TableError as error:
            raise InputError(str(error)) from error
    return Recordings(tuple(runs), trees or ())


def _listed(trees: Iterable[Tree]) -> str:
    return f"has columns of {', '.join(tree.name for tree in trees)}"


@dataclass(frozen=True)
class _Entry:
    """One entry of ``qpos`` or ``qvel``: its place, its possible names without unit, its unit, and the name of its tree."""

    place: int
    stems: tuple[str, ...]
    unit: str
    tree: str

    @property
    def names(self) -> dict[str, float]:
        """Possible names of its column, with the factor to its unit."""
        units = _UNITS[self.unit] or {"": 1.0}
        return {f"{stem}_{unit}".rstrip("_"): factor for stem in self.stems for unit, factor in units.items()}


def _entries(system: System, *, rates: bool) -> list[_Entry]:
    """All entries of ``qpos``, or of ``qvel``."""
    bare = Counter(joint.name.rpartition("/")[2] for tree in system.trees for joint in tree.joints)
    entries = []
    for tree in system.trees:
        for joint in tree.joints:
            names, places = (rate_names(joint), joint.dofs) if rates else (coordinate_names(joint), joint.qpos)
            for place, name in zip(range(places.start, places.stop), names, strict=True):
                unit = unit_of(name)
                rest = name.removeprefix(identifier(joint.name))
                end = f"_{unit}".replace("/", "_") if unit else ""
                stems = [prefix + rest.removesuffix(end) for prefix in _prefixes(system, tree, joint, bare)]
                marked = [mark + stem for stem in stems for mark in ("", "v_" if rates else "q_")]
                marked.append(f"state.{'v' if rates else 'q'}_{stems[0]}")
                entries.append(_Entry(place, tuple(marked), unit, tree.name))
    return entries


def _prefixes(system: System, tree: Tree, joint: Joint, bare: Mapping[str, int]) -> Iterator[str]:
    """Names of a joint in columns: its own, without the model where that is clear, and of a free joint its body."""
    yield identifier(joint.name)
    short = joint.name.rpartition("/")[2]
    if bare[short] == 1:
        yield identifier(short)
    if joint.kind == "free":
        body = system.mj.body(joint.body).name
        yield from (identifier(name) for name in (tree.name, body, body.rpartition("/")[2]))


class _Columns:
    """The columns of a file that are coordinates and velocities of a system."""

    def __init__(self, table: RecordedTable, system: System, kind: Kind | None) -> None:
        self._table, self._system = table, system
        self._qpos = self._chosen(_entries(system, rates=False))
        self._qvel = {} if kind == "poses" else self._chosen(_entries(system, rates=True))
        self._refuse_unknown()
        if not self._qpos:
            example = _entries(system, rates=False)[0]
            raise TableError(
                f"{table.place}: has no column of a pose, such as {min(example.names, key=len)!r}; "
                f"bodies: {', '.join(tree.name for tree in system.trees)}; columns: {', '.join(table.columns)}"
            )
        self.trees = tuple(tree for tree in system.trees if any(one.tree == tree.name for one in self._qpos))
        self._refuse_missing(self._qpos, _entries(system, rates=False))
        if self._qvel or kind == "velocities":
            self._refuse_missing(self._qvel, _entries(system, rates=True))

    def _chosen(self, entries: Iterable[_Entry]) -> dict[_Entry, tuple[str, float]]:
        """Column and factor of each entry that has one.

        Raises:
            TableError: Two columns are of one entry.
        """
        chosen: dict[_Entry, tuple[str, float]] = {}
        for entry in entries:
            there = [(name, factor) for name, factor in entry.names.items() if name in self._table.columns]
            if len(there) > 1:
                raise TableError(f"{self._table.place}: columns {there[0][0]!r} and {there[1][0]!r} are the same coordinate")
            if there:
                chosen[entry] = there[0]
        return chosen

    def _refuse_unknown(self) -> None:
        """Refuse columns of a coordinate in an unknown unit, and of a pose of an unknown body.

        Raises:
            TableError: There is one.
        """
        entries = [one for rates in (False, True) for one in _entries(self._system, rates=rates)]
        known = {name for one in entries for name in one.names}
        for column in self._table.columns:
            if column in known or column.startswith(_OTHERS) or ("." in column and not column.startswith("state.")):
                continue
            for stem, unit in ((stem, one.unit) for one in entries for stem in one.stems if one.unit):
                # Another coordinate may begin with the stem of this one: 'x' of 'x_2_m'.
                if column == stem or (column.startswith(f"{stem}_") and not _has_known_end(column)):
                    has = f"its unit {column[len(stem) + 1 :]!r} is unknown" if column != stem else "its unit is not stated"
                    allowed = ", ".join(f"{stem}_{name}" for name in _UNITS[unit])
                    raise TableError(f"{self._table.place}: column {column!r}: {has}; allowed: {allowed}")
            if match := _POSE.fullmatch(column):
                names = [identifier(tree.name) for tree in self._system.trees]
                raise TableError(f"{self._table.place}: column {column!r}: {unknown_name('body', match[1], names)}")

    def _refuse_missing(self, chosen: Mapping[_Entry, object], entries: Iterable[_Entry]) -> None:
        """Refuse a tree of which some coordinates are missing.

        Raises:
            TableError: There is one.
        """
        recorded = [tree.name for tree in self.trees]
        missing = [one for one in entries if one.tree in recorded and one not in chosen]
        if missing:
            names = ", ".join(min(one.names, key=len) for one in missing)
            raise TableError(f"{self._table.place}: columns of {missing[0].tree} are missing: {names}")

    def runs(self, start: FloatArray, run_column: str | None) -> Iterator[Recording]:
        """The runs of the file.

        Raises:
            TableError: A cell is no finite number, a quaternion no unit quaternion, or times do not ascend.
        """
        table, times = self._table, self._times()
        qpos = np.tile(start, (len(table), 1))
        for entry, (name, factor) in self._qpos.items():
            qpos[:, entry.place] = self._numbers(name, factor)
        self._normalise(qpos)
        qvel = np.zeros((len(table), self._system.mj.nv)) if self._qvel else None
        for entry, (name, factor) in self._qvel.items():
            assert qvel is not None
            qvel[:, entry.place] = self._numbers(name, factor)
        column = run_column if run_column is not None else "run"
        labels = (
            [str(cell) for cell in table.columns[table.name_of(column)]] if run_column or column in table.columns else []
        )
        for label in dict.fromkeys(labels) if labels else [""]:
            rows = np.array([i for i, one in enumerate(labels) if one == label]) if labels else np.arange(len(table))
            self._refuse_backward(times, rows)
            place = f"{table.place}, {column} {label}" if labels else table.place
            yield Recording(place, times[rows], self._unwrapped(qpos[rows]), None if qvel is None else qvel[rows])

    def _numbers(self, name: str, factor: float) -> FloatArray:
        """A column in SI units, (number of rows,).

        Raises:
            TableError: A cell is no finite number, or far beyond what is recorded.
        """
        values = self._table.numbers(name) * factor
        wrong = np.flatnonzero(np.abs(values) > _LARGEST)
        if len(wrong):
            place, cell = self._table.row_place(int(wrong[0])), self._table.columns[name][wrong[0]]
            raise TableError(f"{place}: column {name!r} is {cell}; at most {_LARGEST:g} in SI units is allowed")
        return np.asarray(values)

    def _unwrapped(self, qpos: FloatArray) -> FloatArray:
        """Coordinates of a run whose angles pass half a turn without a jump: trackers give them within a turn."""
        hinges = [joint.qpos.start for tree in self.trees for joint in tree.joints if joint.kind == "hinge"]
        qpos[:, hinges] = np.unwrap(qpos[:, hinges], axis=0)
        return qpos

    def _times(self) -> FloatArray:
        """Times of all rows, s.

        Raises:
            TableError: There is no column of times, or a cell of it is no number.
        """
        names = {"state.time_s": 1.0} | {f"time_{unit}": factor for unit, factor in _TIMES.items()}
        self._time = next((name for name in names if name in self._table.columns), "")
        if not self._time:
            known = ", ".join(self._table.columns)
            raise TableError(f"{self._table.place}: has no column of times; allowed: {', '.join(names)}; columns: {known}")
        # Stamps since an epoch in ns would lose their digits as numbers.
        return self._table.since_first(self._time) * names[self._time]

    def _refuse_backward(self, times: FloatArray, rows: IntArray) -> None:
        """Refuse rows of a run whose times do not ascend.

        Raises:
            TableError: There is one.
        """
        backward = np.flatnonzero(np.diff(times[rows]) <= 0.0)
        if len(backward):
            row, last = int(rows[backward[0] + 1]), int(rows[backward[0]])
            after, before = (self._table.columns[self._time][i] for i in (row, last))
            place = self._table.row_place(row)
            raise TableError(f"{place}: column {self._time!r}: time {after} follows {before}; times must ascend")

    def _normalise(self, qpos: FloatArray) -> None:
        """Give quaternions the length 1.

        Raises:
            TableError: One is far from it.
        """
        for joint in (joint for tree in self.trees for joint in tree.joints if joint.kind in ("free", "ball")):
            part = slice(joint.qpos.stop - 4, joint.qpos.stop)
            lengths = np.linalg.norm(qpos[:, part], axis=1)
            wrong = np.flatnonzero(np.abs(lengths - 1.0) > _UNIT_LENGTH)
            if len(wrong):
                column = next(name for one, (name, _) in self._qpos.items() if one.place == part.start)
                raise TableError(
                    f"{self._table.row_place(int(wrong[0]))}: column {column!r}: the quaternion (w, x, y, z) has the length "
                    f"{lengths[wrong[0]]:.4g}; 1 is allowed"
                )
            qpos[:, part] /= lengths[:, None]


def _has_known_end(column: str) -> bool:
    """Whether a column ends in a unit."""
    return any(column.endswith(f"_{unit}") for units in _UNITS.values() for unit in units)
