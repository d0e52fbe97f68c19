"""Tables of a log with named columns and units: samples, records of each kind, and checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import nan
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.analysis.digest import Digest
from ffsm_mj.analysis.intervals import ContactInterval, GraspInterval
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GRASP
from ffsm_mj.errors import MissingPackageError, unknown_name
from ffsm_mj.records.kinds import field_of
from ffsm_mj.records.record import Values, columns_of, declared, record
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout
from ffsm_mj.verification.check_result import Check

_CHECK_COLUMNS = {
    "name": ("", "name of the check"),
    "subsystem": ("", "subsystem"),
    "component": ("", "component of the worst residual"),
    "residual": ("", "largest magnitude in a window of 100 000 steps, in the unit of its row"),
    "time_s": ("s", "time of the largest residual"),
    "tolerance": ("", "allowed magnitude, in the unit of its row"),
    "unit": ("", "unit of residual and tolerance"),
    "passes": ("", "whether the residual is within the tolerance"),
    "drift": ("", "largest magnitude since the first sample, in the unit of its row"),
}


MOMENTUM_TABLE, CHECKS_TABLE = "angular_momentum", "checks"
"""Names of the tables of angular momentum by subsystem, body and actuator, and of checks."""


@dataclass(frozen=True)
class Table:
    """Columns of equal length, in order, with unit and description of each.

    Attributes:
        name: One of :func:`table_names`.
        columns: Values by column name; the name ends in the unit.
        units: Unit of each column, empty if dimensionless.
        descriptions: Meaning of each column.
    """

    name: str
    columns: Mapping[str, npt.NDArray[Any]]
    units: Mapping[str, str]
    descriptions: Mapping[str, str]

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``; units and descriptions are in its ``attrs``."""
        import pandas as pd  # slow to import

        frame = pd.DataFrame(dict(self.columns))
        frame.attrs.update(units=dict(self.units), descriptions=dict(self.descriptions))
        return frame

    def to_polars(self) -> Any:
        """A ``polars.DataFrame``.

        Raises:
            MissingPackageError: polars is not installed.
        """
        try:
            return import_module("polars").DataFrame(dict(self.columns))
        except ImportError as error:
            raise MissingPackageError("to_polars", "polars", "tables") from error


def table_names(log: RunLog) -> tuple[str, ...]:
    """Names of the tables of a run: samples, one per kind of record that it may have, contacts, grasps and checks.

    ``angular_momentum`` needs the models of the run: see :func:`momentum_table`.
    """
    grasps = ("grasps",) if GRASP in log.kinds else ()
    return "samples", *(kind.plural for kind in log.kinds), "contacts", *grasps, CHECKS_TABLE


def momentum_table(momentum: dict[str, Any] | None) -> Table:
    """The table of what :func:`ffsm_mj.angular_momentum` returns; without rows if that is None."""
    return _of_columns(MOMENTUM_TABLE, columns_of(MomentumRow), momentum_rows(momentum))


def checks_table(checks: Sequence[Check]) -> Table:
    """The table of the results of checks."""
    return _of_columns(CHECKS_TABLE, _CHECK_COLUMNS, checks)


def table(log: RunLog, name: str, digest: Callable[[], Digest]) -> Table:
    """One table of a log by name, except that of its checks.

    Args:
        log: The log.
        name: See :func:`table_names`.
        digest: Returns the digest of its rows, which only contacts and grasps need.

    Raises:
        KeyError: No such table.
    """
    if name == "samples":
        return samples(log.header.layout, np.asarray(log.rows[:]))
    if name == "contacts":
        return _of_columns(name, columns_of(ContactInterval), digest().contacts.intervals())
    if name == "grasps" and GRASP in log.kinds:
        return _of_columns(name, columns_of(GraspInterval), digest().grasps.intervals())
    for kind in log.kinds:
        if kind.plural == name:
            return _of_columns(name, kind.columns, log.records.get(name, ()))
    raise KeyError(unknown_name("table", name, table_names(log)))


def _cell(value: Any) -> Any:
    """A value of a column; names, of any number, are joined, and what has not ended ends at NaN."""
    return ", ".join(value) if isinstance(value, tuple) else nan if value is None else value


def samples(layout: Layout, rows: FloatArray) -> Table:
    """Some or all rows of a run, (n, number of signals), as a table."""
    return Table(
        "samples",
        {signal.key: rows[:, i] for i, signal in enumerate(layout.signals)},
        {signal.key: signal.unit for signal in layout.signals},
        {signal.key: signal.description for signal in layout.signals},
    )


def _of_columns(name: str, meaning: Mapping[str, tuple[str, str]], records: Sequence[Any]) -> Table:
    """Table with one row per record; a field of several values has one column for each."""
    columns: dict[str, npt.NDArray[Any]] = {}
    about: dict[str, tuple[str, str]] = {}
    for column, words in meaning.items():
        field, letters = field_of(column)
        values = [getattr(record, field) for record in records]
        if not letters:
            columns[column], about[column] = np.array([_cell(value) for value in values]), words
            continue
        for i, letter in enumerate(letters):
            column_name = column.replace(f"{{{letters}}}", letter)
            columns[column_name], about[column_name] = np.array([value[i] for value in values]), words
    return Table(
        name,
        columns,
        {column: unit for column, (unit, _) in about.items()},
        {column: text for column, (_, text) in about.items()},
    )


_NONE = (float("nan"),) * 3


@record
class MomentumRow:
    """A row of the table: vectors in world axes about the centre of mass of everything that moves."""

    kind: str = declared("Total, outside, subsystem, body, or actuator: wheel, external or joint.")
    name: str = declared("Name of the subsystem, body or actuator.")
    before_N_m_s: Values = declared("Angular momentum at the first sample; NaN for actuators.", components="xyz")
    after_N_m_s: Values = declared("Angular momentum at the last sample; NaN for actuators.", components="xyz")
    change_N_m_s: Values = declared(
        "Difference; of actuators what a wheel stores and what a thruster brings.", components="xyz"
    )


def momentum_rows(momentum: dict[str, Any] | None) -> list[MomentumRow]:
    """Rows of the table from ``angular_momentum`` of ``summary.json``; none without it."""
    if momentum is None:
        return []
    rows = [_changed("total", "total", momentum["initial_N_m_s"], momentum["final_N_m_s"])]
    rows.append(MomentumRow("outside", "outside", _NONE, _NONE, tuple(momentum["external_N_m_s"])))
    for kind, key in (("subsystem", "subsystems"), ("body", "bodies")):
        rows += [_changed(kind, name, part["before_N_m_s"], part["after_N_m_s"]) for name, part in momentum[key].items()]
    rows += [
        MomentumRow(part["kind"], name, _NONE, _NONE, tuple(part["taken_N_m_s"]))
        for name, part in momentum["actuators"].items()
    ]
    return rows


def _changed(kind: str, name: str, before: list[float], after: list[float]) -> MomentumRow:
    change = tuple(y - x for x, y in zip(before, after, strict=True))
    return MomentumRow(kind, name, tuple(before), tuple(after), change)
