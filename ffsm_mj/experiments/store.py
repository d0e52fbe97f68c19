"""Table of a campaign: one SQLite file with one writer; a campaign has no other state.

The file may come from somebody else: what it can do to a reader, and what is refused, follows docs/threat-model.md.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, Json, TypeAdapter, ValidationError

from ffsm_mj.config import Cell, Integer, first_fault
from ffsm_mj.errors import InputError, LogWriteError
from ffsm_mj.report.output_place import refuse_link

ERROR, TIMEOUT, CRASHED = "error", "timeout", "crashed"
"""An exception was raised; the run exceeded its wall time; its process ended."""
RETRIED = (ERROR, CRASHED, TIMEOUT)
"""Outcomes that a repetition may change."""


_BESIDE = ("", "-journal", "-wal", "-shm")
"""Suffixes of the files that SQLite opens for a database."""
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")


def refuse_foreign_file(path: Path) -> None:
    """Refuse files that SQLite must not open.

    Raises:
        InputError: A file is a symbolic link, or the journal names a file to delete.
    """
    for ending in _BESIDE:
        refuse_link(path.with_name(path.name + ending))
    journal = path.with_name(f"{path.name}-journal")
    # SQLite file format, "The Rollback Journal": the magic number is at the end only after the name of a super-journal,
    # which belongs to a transaction over several databases. Playing the journal back deletes the file of that name.
    if journal.is_file() and journal.stat().st_size > len(_JOURNAL_MAGIC):
        with journal.open("rb") as stream:
            stream.seek(-len(_JOURNAL_MAGIC), 2)
            if stream.read() == _JOURNAL_MAGIC:
                raise InputError(f"{journal}: names another file; a journal of a campaign does not")


def fault_of_tables(db: sqlite3.Connection, tables: str) -> str:
    """What is wrong with a database; empty if it has exactly these tables and no damage.

    Args:
        db: The database.
        tables: SQL statements that create the expected tables.

    Raises:
        sqlite3.DatabaseError: It cannot be read.
    """
    db.execute("PRAGMA trusted_schema=OFF")
    expected = sqlite3.connect(":memory:")
    expected.executescript(tables)
    actual, wanted = (_schema(database) for database in (db, expected))
    expected.close()
    if actual != wanted:
        other = next((name for name in actual if name not in wanted), next(iter(wanted)))
        return f"{' '.join(other[:2])} does not belong to a campaign"
    # Damaged pages may refer to each other in circles; the check visits each page once.
    damage = str(db.execute("PRAGMA quick_check(1)").fetchone()[0])
    return "" if damage == "ok" else f"damaged: {' '.join(damage.split())}"


def _schema(db: sqlite3.Connection) -> dict[tuple[str, str, str], None]:
    statements = db.execute("SELECT type, name, coalesce(sql, '') FROM sqlite_master ORDER BY type, name")
    return {(str(kind), str(name), " ".join(str(sql).split())): None for kind, name, sql in statements}


_TABLES = """
CREATE TABLE settings (content TEXT NOT NULL);
CREATE TABLE rows (
    i INTEGER PRIMARY KEY, outcome TEXT NOT NULL, message TEXT NOT NULL, phase TEXT NOT NULL, failed INTEGER NOT NULL,
    metrics TEXT NOT NULL, model TEXT NOT NULL, cpu TEXT NOT NULL, wall_s REAL NOT NULL, cpu_s REAL NOT NULL
);
"""
_FORMAT = 2
"""Version of the tables, SQLite's ``user_version``: 1 kept a hash of the settings with every row."""


@dataclass(frozen=True)
class RunRow:
    """Result of a run.

    Attributes:
        index: Index of the run in the design.
        outcome: Outcome of the run, or ``error``, ``timeout`` or ``crashed``, see
            :mod:`ffsm_mj.experiments.store`.
        message: Explanation of the outcome; for an error it begins with the type.
        phase: Last phase that began; empty if none did.
        metrics: Metrics by name; None if the run has no value.
        model: Properties of the model that were set, read back from the compiled model.
        cpu: Name of the processor model; the last bits of results may depend on it.
        wall_s: Wall time, s.
        cpu_s: CPU time, s.
    """

    index: int
    outcome: str
    message: str = ""
    phase: str = ""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    model: Mapping[str, Any] = field(default_factory=dict)
    cpu: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0

    @property
    def failed(self) -> bool:
        """Whether the run did not complete, or does not pass its checks by the rule of the campaign."""
        return self.outcome != "completed" or self.metrics.get("passes", self.metrics.get("checks_pass")) is False


class Store:
    """The SQLite file. Numbers are read as they were written, bit for bit: JSON has all digits of a double.

    Attributes:
        settings: The settings of its rows; None before :meth:`begin`.
    """

    def __init__(self, path: Path | str, *, write: bool = True, max_pages: int | None = None) -> None:
        """Open the file; with ``write``, create it if it does not exist.

        Args:
            path: The file, or ``:memory:``.
            write: Whether rows will be written.
            max_pages: Greatest number of database pages (for tests: a full disk).

        Raises:
            InputError: The file does not exist, or is not a table of a campaign.
            LogWriteError: The file cannot be created.
        """
        self.path = Path(path)
        in_memory = str(path) == ":memory:"
        if not write and not in_memory and not self.path.is_file():
            raise InputError(f"{self.path}: no such campaign")
        if not in_memory:
            refuse_foreign_file(self.path)
        # The rollback journal, SQLite's default, also works on network file systems; WAL requires a single host.
        with self._writing():
            self._db = sqlite3.connect(str(path), timeout=60.0, check_same_thread=False)
        try:
            with self._reading():
                if write:
                    with self._writing():
                        self._create(max_pages)
                self._refuse_foreign()
                stored = self._db.execute("SELECT content FROM settings").fetchone()
        except BaseException:
            self._db.close()
            raise
        self.settings: str | None = str(stored[0]) if stored else None

    def _refuse_foreign(self) -> None:
        stored = self._db.execute("PRAGMA user_version").fetchone()[0]
        if stored != _FORMAT:
            raise InputError(f"{self.path}: is not a table of a campaign of this version")
        if fault := fault_of_tables(self._db, _TABLES):
            raise InputError(f"{self.path}: is not a table of a campaign ({fault})")

    def _create(self, max_pages: int | None) -> None:
        self._db.execute("PRAGMA synchronous=NORMAL")
        if max_pages is not None:
            self._db.execute(f"PRAGMA max_page_count={max_pages:d}")
        if self._db.execute("PRAGMA schema_version").fetchone()[0] == 0:
            self._db.executescript(f"BEGIN;{_TABLES}PRAGMA user_version={_FORMAT};COMMIT;")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:
            raise LogWriteError(self.path, OSError(0, str(error))) from error

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Context for reading a file of unknown origin.

        Raises:
            InputError: The file cannot be read.
        """
        try:
            yield
        except (sqlite3.Error, ValueError, OverflowError, RecursionError) as error:
            raise InputError(f"{self.path}: is not a table of a campaign ({error})") from error

    def begin(self, settings: str) -> None:
        """Write the settings if the file has none yet.

        Raises:
            LogWriteError: The disk is full.
        """
        if self.settings is None:
            with self._writing(), self._db:
                self._db.execute("INSERT INTO settings VALUES (?)", (settings,))
            self.settings = settings

    def add(self, rows: Iterable[RunRow]) -> None:
        """Add rows; existing rows of the same runs are kept.

        Raises:
            LogWriteError: The disk is full.
        """
        with self._writing(), self._db:
            self._db.executemany("INSERT OR IGNORE INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", map(_values, rows))

    def drop(self, outcomes: Sequence[str]) -> None:
        """Delete rows with these outcomes, so that their runs are repeated."""
        with self._writing(), self._db:
            self._db.executemany("DELETE FROM rows WHERE outcome = ?", [(outcome,) for outcome in outcomes])

    def done(self) -> set[int]:
        """Indices of the runs that have a row."""
        return {int(i) for (i,) in self._fetched("SELECT i FROM rows")}

    def last(self) -> int:
        """Largest index of a run that has a row; -1 if there is none."""
        return int(self._fetched("SELECT coalesce(max(i), -1) FROM rows")[0][0])

    def failed(self, first: int) -> int:
        """Number of failed runs among the first runs of the design."""
        return int(self._fetched("SELECT count(*) FROM rows WHERE i < ? AND failed", first)[0][0])

    def outcomes(self) -> dict[str, int]:
        """Number of rows by outcome, the most frequent first."""
        counts = self._fetched("SELECT outcome, count(*) n FROM rows GROUP BY outcome ORDER BY n DESC, outcome")
        return {str(outcome): int(count) for outcome, count in counts}

    def failures(self) -> list[RunRow]:
        """Rows of the failed runs."""
        return self.rows("failed")

    def rows(self, which: str = "1") -> list[RunRow]:
        """Rows that meet an SQL condition, all without one, in the order of their indices."""
        columns = "i, outcome, message, phase, metrics, model, cpu, wall_s, cpu_s"
        return [self._row(row) for row in self._fetched(f"SELECT {columns} FROM rows WHERE {which} ORDER BY i")]

    def row(self, index: int) -> RunRow | None:
        """Row of a run; None if it has none."""
        return next(iter(self.rows(f"i = {index:d}")), None)

    def _fetched(self, query: str, *values: int) -> list[Any]:
        with self._reading():
            return self._db.execute(query, values).fetchall()

    def _row(self, columns: tuple[Any, ...]) -> RunRow:
        """A row of unknown origin.

        Raises:
            InputError: A value is of another type, or not finite.
        """
        try:
            return RunRow(*_COLUMNS.validate_python(columns, strict=True))
        except ValidationError as error:
            raise InputError(f"{self.path}: row {columns[0]} cannot be read ({first_fault(error)})") from error

    def close(self) -> None:
        """Close the file."""
        self._db.close()


_Mapping = Json[dict[str, Cell | list[Cell | None] | None]]
_Number = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
_COLUMNS = TypeAdapter(tuple[Integer, str, str, str, _Mapping, _Mapping, str, _Number, _Number])


def _values(row: RunRow) -> tuple[Any, ...]:
    result = row.index, row.outcome, row.message, row.phase, int(row.failed)
    return (*result, json.dumps(row.metrics), json.dumps(row.model), row.cpu, row.wall_s, row.cpu_s)
