"""Validation of a campaign's SQLite file of unknown origin, and of its rows.

A database file can act: views and triggers run when a table is read or written, and a rollback journal may name a file that
is deleted when the journal is played back. Therefore only the tables of a campaign are accepted, and all pages are checked.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ffsm_mj.errors import InputError

_BESIDE = ("", "-journal", "-wal", "-shm")
"""Suffixes of the files that SQLite opens for a database."""
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
_LARGEST = 2**63


def refuse_foreign_file(path: Path) -> None:
    """Refuse files that SQLite must not open.

    Raises:
        InputError: A file is a symbolic link, or the journal names a file to delete.
    """
    for ending in _BESIDE:
        file = path.with_name(path.name + ending)
        if file.is_symlink():
            raise InputError(f"{file}: is a symbolic link; nothing is written through it")
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
    made, wanted = (_schema(each) for each in (db, expected))
    expected.close()
    if made != wanted:
        other = next((name for name in made if name not in wanted), next(iter(wanted)))
        return f"{' '.join(other[:2])} does not belong to a campaign"
    # Damaged pages may refer to each other in circles; the check visits each page once.
    damage = str(db.execute("PRAGMA quick_check(1)").fetchone()[0])
    return "" if damage == "ok" else f"damaged: {' '.join(damage.split())}"


def _schema(db: sqlite3.Connection) -> dict[tuple[str, str, str], None]:
    found = db.execute("SELECT type, name, coalesce(sql, '') FROM sqlite_master ORDER BY type, name")
    return {(str(kind), str(name), " ".join(str(sql).split())): None for kind, name, sql in found}


def fault_of_row(texts: tuple[Any, ...], numbers: tuple[Any, ...], mappings: tuple[Any, ...]) -> str:
    """What is wrong with a row; empty if it is valid.

    Args:
        texts: Values that must be texts.
        numbers: Values that must be finite and not negative.
        mappings: Values that must map names to numbers, flags, texts, None, or lists of these.
    """
    if not all(isinstance(text, str) for text in texts):
        return "a text column holds no text"
    if not all(isinstance(number, int | float) and 0.0 <= number < math.inf for number in numbers):
        return "a number column holds no valid number"
    if not all(isinstance(each, Mapping) and all(map(_is_plain, each.values())) for each in mappings):
        return "metrics or model values are no mapping of plain values"
    return ""


def _is_plain(value: Any) -> bool:
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, int):
        return abs(value) < _LARGEST  # 64-bit integers of SQLite and Arrow
    return value is None or isinstance(value, float | str)
