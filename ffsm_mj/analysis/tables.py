"""What a log holds as plain tables of named columns: samples, impacts, phases and laws, each with units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.analysis.verdicts import DEFAULT_TOLERANCE, Tolerance, check_laws
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import MissingPackageError, unknown_name
from ffsm_mj.records.kinds import field_of
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout

TABLES = ("samples", "impacts", "phases", "laws")
"""Names of the tables of every run."""

_IMPACT_COLUMNS = {
    "time_s": ("s", "simulation time"),
    "event": ("", "number of the impact, from 0; contacts at one instant share it"),
    "pair": ("", "name of the pair of geoms that touch"),
    "geoms_{ab}": ("", "geom of the pair"),
    "robot_geom": ("", "geom a where the robot touches an object, else empty"),
    "object_geom": ("", "geom b where the robot touches an object, else empty"),
    "manifold": ("", "point, edge or face"),
    "law": ("", "contact law that made the result"),
    "restitution": ("", "coefficient of restitution"),
    "point_{xyz}_m": ("m", "contact point, world frame"),
    "normal_{xyz}": ("", "normal from a to b, world frame"),
    "approach_speed_m_s": ("m/s", "normal speed of approach before"),
    "separation_speed_m_s": ("m/s", "normal speed of separation after"),
    "impulse_N_s": ("N s", "impulse on b along the normal"),
    "angular_impulse_{xyz}_N_m_s": ("N m s", "angular impulse on b about the centre of mass of its robot or object"),
    "gap_m": ("m", "signed distance at the event"),
    "energy_change_J": ("J", "kinetic energy gained by the whole system"),
    "linear_momentum_change_N_s": ("N s", "norm of the change of the whole system's linear momentum"),
    "angular_momentum_change_N_m_s": ("N m s", "norm of the change of the whole system's angular momentum about the origin"),
}


@dataclass(frozen=True)
class Table:
    """Columns of equal length, in order, with unit and description of each.

    Attributes:
        name: One of ``TABLES``.
        columns: Values by column name; the name ends in the unit.
        units: Unit of each column, empty where it has none.
        descriptions: What each column means.
    """

    name: str
    columns: Mapping[str, npt.NDArray[Any]]
    units: Mapping[str, str]
    descriptions: Mapping[str, str]

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``; units and descriptions are in its ``attrs``.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        frame = _package("pandas", "to_pandas").DataFrame(dict(self.columns))
        frame.attrs.update(units=dict(self.units), descriptions=dict(self.descriptions))
        return frame

    def to_polars(self) -> Any:
        """A ``polars.DataFrame``.

        Raises:
            MissingPackageError: polars is not installed.
        """
        return _package("polars", "to_polars").DataFrame(dict(self.columns))


def _package(name: str, purpose: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingPackageError(purpose, name, "tables") from error


def table(log: RunLog, name: str, tolerance: Tolerance = DEFAULT_TOLERANCE) -> Table:
    """One table of a run by name.

    Raises:
        KeyError: No such table.
    """
    if name == "samples":
        return samples(log.header.layout, np.asarray(log.rows[:]))
    if name == "impacts":
        return _impacts(log)
    if name == "phases":
        return _records(name, _PHASE_COLUMNS, log.phases)
    if name == "laws":
        return _records(name, _LAW_COLUMNS, check_laws(log, tolerance))
    raise KeyError(unknown_name("table", name, TABLES))


_PHASE_COLUMNS = {
    "index": ("", "position in the scenario, from 0"),
    "name": ("", "name of the phase"),
    "controller": ("", "kind of its controller"),
    "start_s": ("s", "when it begins"),
    "reason": ("", "why it begins"),
}
_LAW_COLUMNS = {
    "name": ("", "what is conserved"),
    "party": ("", "of whom"),
    "component": ("", "where the residual is worst"),
    "residual": ("", "worst magnitude in a stretch of 100 000 steps, in the unit of its row"),
    "time_s": ("s", "when that is"),
    "tolerance": ("", "what is allowed, in the unit of its row"),
    "unit": ("", "unit of residual and tolerance"),
    "holds": ("", "whether the residual is within the tolerance"),
    "drift": ("", "worst magnitude since the first sample, in the unit of its row"),
}


def samples(layout: Layout, rows: FloatArray) -> Table:
    """Some or all rows of a run, (n, number of signals), as a table."""
    return Table(
        "samples",
        {signal.key: rows[:, i] for i, signal in enumerate(layout.signals)},
        {signal.key: signal.unit for signal in layout.signals},
        {signal.key: signal.description for signal in layout.signals},
    )


def _records(name: str, meaning: Mapping[str, tuple[str, str]], records: Sequence[Any]) -> Table:
    return Table(
        name,
        {column: np.array([getattr(record, column) for record in records]) for column in meaning},
        {column: unit for column, (unit, _) in meaning.items()},
        {column: text for column, (_, text) in meaning.items()},
    )


def _impacts(log: RunLog) -> Table:
    """One row per contact; vectors as one column per axis."""
    columns: dict[str, npt.NDArray[Any]] = {}
    meaning: dict[str, tuple[str, str]] = {}
    for pattern, about in _IMPACT_COLUMNS.items():
        name, letters = field_of(pattern)
        values = [getattr(record, name) for record in log.impacts]
        if not letters:
            columns[pattern], meaning[pattern] = np.array(values), about
        for i, letter in enumerate(letters):
            column = pattern.replace(f"{{{letters}}}", letter)
            columns[column], meaning[column] = np.array([value[i] for value in values]), about
    return Table(
        "impacts",
        columns,
        {name: unit for name, (unit, _) in meaning.items()},
        {name: text for name, (_, text) in meaning.items()},
    )
