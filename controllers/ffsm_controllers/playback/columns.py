"""Columns of a recorded file: which actuator each one drives, in which unit, and when its samples are played."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ffsm_controllers.playback.config import DIPOLES, FORCES, TORQUES, EffortColumnConfig, PlaybackConfig
from ffsm_controllers.playback.record import EffortRecord
from ffsm_mj.controller_protocol import (
    Fault,
    Faults,
    FloatArray,
    IntArray,
    RecordedTable,
    ScenarioFaults,
    System,
    TableError,
    control_unit,
    identifier,
    is_servo,
)

_FACTORS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "A m^2": 1.0}
_EFFORTS = {"N": ("force", FORCES), "N m": ("torque", TORQUES), "A m^2": ("dipole", DIPOLES)}
"""What an actuator takes by the unit of its command, and in which units it may be recorded."""
_SETPOINTS = ("rad", "rad/s", "m", "m/s", "V", "N", "N m")
"""Units of setpoints; others have none."""
_TIME_FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_TIMES = ("time_s", "state.time_s")
_TIME_OF_UNITS, _OF_UNITS = "time", "actuators."
"""Column of the times in tables of co-simulations, in s by the standard, and how the names of their commands begin."""


@dataclass(frozen=True)
class _Driven:
    """An actuator with its column, what is said of it, and the keys in the scenario that say so."""

    actuator: int
    column: str | int
    config: EffortColumnConfig
    path: tuple[str, ...]


def effort_record(config: PlaybackConfig, table: RecordedTable, system: System) -> tuple[IntArray, EffortRecord]:
    """Actuators that a file drives, and their efforts over time.

    Raises:
        ScenarioFaults: An unknown actuator or column, a unit that is not stated or does not fit, times that do not ascend,
            or a cell that is no finite number.
    """
    driven = _driven(config, table, system)
    faults: list[Fault] = []
    times, efforts = np.zeros(0), list[FloatArray]()
    with _collected(faults, ("time",)):
        times = _times(config, table)
    for channel in driven:
        with _collected(faults, channel.path):
            efforts.append(_efforts(config, table, system, channel))
    with _collected(faults, ("interpolation",) if config.interpolation == "linear" else ("file",)):
        _refuse_single(config, table)
    if faults:
        raise ScenarioFaults(faults)
    actuators = np.array([channel.actuator for channel in driven], dtype=np.intp)
    record = EffortRecord(
        times,
        np.column_stack(efforts),
        config.interpolation,
        _end_s(config, times),
        hold_before=config.before == "hold",
        hold_after=config.after == "hold",
    )
    return actuators, record


@contextmanager
def _collected(faults: list[Fault], path: tuple[str, ...]) -> Iterator[None]:
    """Collect a fault of the file at some keys of the scenario."""
    try:
        yield
    except TableError as error:
        faults.append(Fault(str(error), path))


def _driven(config: PlaybackConfig, table: RecordedTable, system: System) -> list[_Driven]:
    """The actuators to drive.

    Raises:
        ScenarioFaults: One is unknown or named twice, or the file has no column of any.
    """
    names = system.names("actuator")
    if config.columns is None:
        channels = [
            _Driven(i, column, EffortColumnConfig(), ("file",))
            for i, name in enumerate(names)
            if (column := _column_of(name, names, table.columns)) is not None
        ]
        if not channels:
            message = f"{table.place} has no column of an actuator; write 'columns', the column of each actuator to drive"
            has, known = ", ".join(table.columns), ", ".join(names)
            raise ScenarioFaults([Fault(f"{message}; its columns: {has}; actuators: {known}", ("file",))])
        return channels
    driven: dict[int, _Driven] = {}
    with Faults() as faults:
        for name, stated in config.columns.items():
            path = ("columns", name)
            with faults.below(*path):
                i = system.index("actuator", name)
                if i in driven:
                    faults.add(f"names the actuator {names[i]} a second time; each has one column", *path)
                said = stated if isinstance(stated, EffortColumnConfig) else EffortColumnConfig(column=stated)
                source = said.column if said.column is not None else _column_of(names[i], names, table.columns)
                if source is None:
                    faults.add(f"{table.place} has no column of this name; write 'column'", *path)
                else:
                    driven[i] = _Driven(i, source, said, path)
    return list(driven.values())


def _column_of(actuator: str, actuators: Collection[str], columns: Collection[str]) -> str | None:
    """The column of an actuator by their names: its name, with or without a unit, or its effort in our logs and units."""
    short = actuator.rpartition("/")[2]
    of_several = sum(name.rpartition("/")[2] == short for name in actuators) > 1
    stems = (actuator, *(() if of_several else (short,)), identifier(actuator))
    ends = ("", *(_end_of(unit) for unit in (*_FACTORS, *_SETPOINTS)))
    wanted = [
        f"{group}{stems[-1]}_{what}{end}" for what in ("applied", "command") for group in (_OF_UNITS, "") for end in ends
    ]
    wanted += [f"{stem}{end}" for stem in stems for end in ends]
    return next((name for name in wanted if name in columns), None)


def _efforts(config: PlaybackConfig, table: RecordedTable, system: System, driven: _Driven) -> FloatArray:
    """Efforts of one actuator, (number of samples,), N, N m or A m^2.

    Raises:
        TableError: The column is unknown, its unit is not stated or does not fit, or a cell is no finite number.
    """
    name = table.name_of(driven.column)
    if is_servo(system.mj, driven.actuator):
        return _setpoints(table, system, driven, name)
    unit = _unit(name, driven.config.unit or config.unit, _FACTORS, f"unit: {FORCES[0]} or {TORQUES[0]}")
    what, allowed = _EFFORTS[control_unit(system.mj, driven.actuator)]
    if unit not in allowed:
        actuator = system.names("actuator")[driven.actuator]
        raise TableError(f"column {name!r} is in {unit}, and {actuator} takes a {what}; allowed: {', '.join(allowed)}")
    with np.errstate(over="ignore"):
        efforts = table.numbers(name) * (_FACTORS[unit] * driven.config.scale)
    if not np.isfinite(efforts).all():
        raise TableError(f"column {name!r} times {driven.config.scale:g} is beyond all numbers")
    return efforts


def _setpoints(table: RecordedTable, system: System, driven: _Driven, column: str) -> FloatArray:
    """Setpoints of a servo, (number of samples,), in the unit that its law gives them.

    Raises:
        TableError: The column is in another unit by its name, or one is stated.
    """
    unit_of_control = control_unit(system.mj, driven.actuator)
    by_name = next((unit for unit in sorted(_SETPOINTS, key=len, reverse=True) if _ends_in(column, unit)), unit_of_control)
    if driven.config.unit is not None or by_name != unit_of_control:
        actuator = system.names("actuator")[driven.actuator]
        raise TableError(
            f"{actuator} is a servo: column {column!r} must have its setpoints, in {unit_of_control or 'its own unit'}"
        )
    return np.asarray(table.numbers(column) * driven.config.scale)


def _unit(column: str, stated: str | None, units: Collection[str], example: str) -> str:
    """Unit of a column: stated in the scenario, or at the end of its name.

    Raises:
        TableError: It is not stated, or differently by the name.
    """
    by_name = next((unit for unit in sorted(units, key=len, reverse=True) if _ends_in(column, unit)), None)
    if stated is None and by_name is None:
        raise TableError(f"the unit of column {column!r} is not stated; write '{example}'")
    if stated is not None and by_name is not None and stated != by_name:
        raise TableError(f"column {column!r} is in {by_name} by its name, and 'unit' says {stated}")
    return str(stated or by_name)


def _ends_in(column: str, unit: str) -> bool:
    return column.endswith(_end_of(unit))


def _end_of(unit: str) -> str:
    """End of the name of a column in a unit."""
    return f"_{unit}".replace(" ", "_").replace("/", "_").replace("^", "")


def _times(config: PlaybackConfig, table: RecordedTable) -> FloatArray:
    """Times of the samples since the start of the phase or of the run, (number of samples,), s.

    Raises:
        TableError: There is no such column, its unit is not stated, or its times do not ascend.
    """
    time = config.time
    if time.step_s is not None:
        return np.asarray(np.arange(len(table)) * time.step_s + time.offset_s)
    of_unit = _TIME_OF_UNITS in table.columns and any(name.startswith(_OF_UNITS) for name in table.columns)
    known_times = (*_TIMES, _TIME_OF_UNITS) if of_unit else _TIMES
    of_times = (
        time.column if time.column is not None else next((name for name in known_times if name in table.columns), None)
    )
    if of_times is None:
        known = ", ".join(table.columns)
        raise TableError(
            f"{table.place} has no column time_s; write 'column', or 'step_s' of samples without times; columns: {known}"
        )
    name = table.name_of(of_times)
    unit = time.unit or ("s" if of_unit and name == _TIME_OF_UNITS else None)
    factor = _TIME_FACTORS[_unit(name, unit, _TIME_FACTORS, "unit: s")]
    times = (table.since_first(name) if time.zero == "first_sample" else table.numbers(name)) * factor
    backward = np.flatnonzero(np.diff(times) <= 0.0)
    if len(backward):
        k = int(backward[0]) + 1
        after, before = (table.columns[name][i] for i in (k, k - 1))
        raise TableError(f"{table.row_place(k)}: time {after} follows {before} in column {name!r}; times must ascend")
    return np.asarray(times + time.offset_s)


def _refuse_single(config: PlaybackConfig, table: RecordedTable) -> None:
    """Refuse a single sample where it does not say how long it lasts.

    Raises:
        TableError: It does not.
    """
    if len(table) > 1:
        return
    if config.interpolation == "linear":
        raise TableError(f"{table.place} has a single sample; straight lines need two")
    if config.after != "hold" and config.time.step_s is None:
        raise TableError(f"{table.place} has a single sample, which has no duration; write 'after: hold'")


def _end_s(config: PlaybackConfig, times: FloatArray) -> float:
    """End of the record, s: a held sample lasts as long as the one before it."""
    last = float(times[-1])
    if config.interpolation == "linear":
        return last
    return last + (config.time.step_s or (last - float(times[-2]) if len(times) > 1 else 0.0))
