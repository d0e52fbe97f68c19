"""The table of a campaign: one SQLite file, one writer; what is in it is all that is remembered."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ffsm_mj.errors import InputError, LogWriteError

_TABLES = """
CREATE TABLE IF NOT EXISTS settings (hash TEXT PRIMARY KEY, content TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS design (i INTEGER PRIMARY KEY, parameters TEXT NOT NULL, overrides TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS rows (
    hash TEXT NOT NULL, i INTEGER NOT NULL, outcome TEXT NOT NULL, message TEXT NOT NULL, phase TEXT NOT NULL,
    metrics TEXT NOT NULL, model TEXT NOT NULL, cpu TEXT NOT NULL, wall_s REAL NOT NULL, cpu_s REAL NOT NULL,
    PRIMARY KEY (hash, i)
) WITHOUT ROWID;
"""
_FORMAT = 1


@dataclass(frozen=True)
class Row:
    """What a run came to.

    Attributes:
        index: Number of the run in the design.
        outcome: That of the run; ``error`` where it could not be made, ``timeout`` where it took too long, ``crashed`` where
            the process that made it ended.
        message: What there is to say of the outcome; of an error its type first.
        phase: The last phase that began; empty where none did.
        metrics: What was measured, by name; None for what the run does not have.
        model: Values of the model that were set, as they were read back once it was compiled.
        cpu: Model of the processor, which results may depend on bit by bit.
        wall_s: Wall time.
        cpu_s: Time of the processor.
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
        """Whether the run did not come to its end, or a law is violated."""
        return self.outcome != "completed" or self.metrics.get("laws_hold") is False


class Store:
    """The file. Numbers come back bit by bit: JSON keeps every digit that a double has."""

    def __init__(self, path: Path | str, *, write: bool = True, max_pages: int | None = None) -> None:
        """Open it; it is made where it is not there and may be written.

        Args:
            path: The file; ``:memory:`` keeps it in memory.
            write: Whether anything will be written.
            max_pages: Pages that it may have (for tests: a full disk).

        Raises:
            InputError: There is no such file, or it is no table of a campaign.
            LogWriteError: It cannot be made.
        """
        self.path = Path(path)
        in_memory = str(path) == ":memory:"
        if not write and not in_memory and not self.path.is_file():
            raise InputError(f"{self.path}: no such campaign")
        # The rollback journal, SQLite's own default, works on file systems of clusters too; WAL needs one host.
        with self._writing():
            self._db = sqlite3.connect(str(path), timeout=60.0, check_same_thread=False)
        try:
            if write:
                with self._writing():
                    self._make(max_pages)
            found = self._db.execute("PRAGMA user_version").fetchone()[0]
        except sqlite3.DatabaseError as error:
            raise InputError(f"{self.path}: is no table of a campaign ({error})") from error
        if found != _FORMAT:
            raise InputError(f"{self.path}: is no table of a campaign of this version")

    def _make(self, max_pages: int | None) -> None:
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

    def begin(self, digest: str, settings: str, design: Iterable[tuple[int, Mapping[str, Any], Mapping[str, Any]]]) -> None:
        """Write settings and design, all or nothing.

        Args:
            digest: Hash of the settings.
            settings: Their content.
            design: (number of the run, drawn values by parameter, overrides by key); those that are there stay.

        Raises:
            LogWriteError: The disk is full.
        """
        rows = [(i, json.dumps(parameters), json.dumps(overrides)) for i, parameters, overrides in design]
        with self._writing(), self._db:
            self._db.execute("INSERT OR IGNORE INTO settings VALUES (?, ?)", (digest, settings))
            self._db.executemany("INSERT OR IGNORE INTO design VALUES (?, ?, ?)", rows)

    def settings(self) -> tuple[str, str] | None:
        """Hash and content of the settings; None before :meth:`begin`."""
        found = self._db.execute("SELECT hash, content FROM settings").fetchone()
        return (str(found[0]), str(found[1])) if found else None

    def design(self, indices: Sequence[int] | None = None) -> list[tuple[int, dict[str, Any], dict[str, Any]]]:
        """The design, or some of its rows: number, drawn values by parameter, overrides by key."""
        found = self._db.execute("SELECT i, parameters, overrides FROM design ORDER BY i")
        wanted = None if indices is None else set(indices)
        return [(i, json.loads(p), json.loads(o)) for i, p, o in found if wanted is None or i in wanted]

    def size(self) -> int:
        """Number of runs in the design."""
        return int(self._db.execute("SELECT count(*) FROM design").fetchone()[0])

    def add(self, digest: str, rows: Iterable[Row]) -> None:
        """Add rows; one that is there stays.

        Raises:
            LogWriteError: The disk is full.
        """
        with self._writing(), self._db:
            self._db.executemany(
                "INSERT OR IGNORE INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", [_told(digest, row) for row in rows]
            )

    def drop(self, digest: str, outcomes: Sequence[str]) -> int:
        """Forget rows with these outcomes, so that they are run again; returns how many."""
        marks = ", ".join("?" * len(outcomes))
        with self._writing(), self._db:
            done = self._db.execute(f"DELETE FROM rows WHERE hash = ? AND outcome IN ({marks})", (digest, *outcomes))
        return done.rowcount

    def left(self, digest: str) -> list[int]:
        """Numbers of the runs that have no row."""
        found = self._db.execute(
            "SELECT i FROM design WHERE i NOT IN (SELECT i FROM rows WHERE hash = ?) ORDER BY i", (digest,)
        )
        return [int(i) for (i,) in found]

    def rows(self, digest: str) -> list[Row]:
        """All rows in order of their numbers."""
        found = self._db.execute(
            "SELECT i, outcome, message, phase, metrics, model, cpu, wall_s, cpu_s FROM rows WHERE hash = ? ORDER BY i",
            (digest,),
        )
        return [
            Row(i, o, m, p, json.loads(metrics), json.loads(model), *rest) for i, o, m, p, metrics, model, *rest in found
        ]

    def close(self) -> None:
        """Close the file."""
        self._db.close()


def _told(digest: str, row: Row) -> tuple[Any, ...]:
    texts = row.outcome, row.message, row.phase, json.dumps(row.metrics), json.dumps(row.model), row.cpu
    return (digest, row.index, *texts, row.wall_s, row.cpu_s)
