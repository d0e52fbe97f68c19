"""A campaign's SQLite file that may be somebody else's: what SQLite would do for it beyond reading rows, and what rows hold.

A database file is a program as well: views and triggers run when a table is read or written, and a rollback journal names a
file that is deleted when it is played back. So nothing but the tables of a campaign is accepted, page by page.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ffsm_mj.errors import InputError

_BESIDE = ("", "-journal", "-wal", "-shm")
"""Endings of the files that SQLite opens for a database."""
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
_LARGEST = 2**63


def refuse_foreign_file(path: Path) -> None:
    """Look at the files before SQLite does.

    Raises:
        InputError: One is a symbolic link, or the journal names a file to delete.
    """
    for ending in _BESIDE:
        file = path.with_name(path.name + ending)
        if file.is_symlink():
            raise InputError(f"{file}: is a symbolic link; nothing is written through it")
    journal = path.with_name(f"{path.name}-journal")
    # SQLite file format, "The Rollback Journal": the magic number stands at the end only after the name of a super-journal,
    # which a transaction over several databases has. Playing the journal back deletes the file of that name.
    if journal.is_file() and journal.stat().st_size > len(_JOURNAL_MAGIC):
        with journal.open("rb") as stream:
            stream.seek(-len(_JOURNAL_MAGIC), 2)
            if stream.read() == _JOURNAL_MAGIC:
                raise InputError(f"{journal}: names another file, which no journal of a campaign does")


def fault_of_tables(db: sqlite3.Connection, tables: str) -> str:
    """What is wrong with a database beside these tables, in a few words; empty where nothing is.

    Args:
        db: The database.
        tables: The statements that make its tables.

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
        return f"{' '.join(other[:2])} is not that of a campaign"
    # Pages may lead to each other in circles or a thousand times to one; the check visits each once.
    damage = str(db.execute("PRAGMA quick_check(1)").fetchone()[0])
    return "" if damage == "ok" else f"damaged: {' '.join(damage.split())}"


def _schema(db: sqlite3.Connection) -> dict[tuple[str, str, str], None]:
    found = db.execute("SELECT type, name, coalesce(sql, '') FROM sqlite_master ORDER BY type, name")
    return {(str(kind), str(name), " ".join(str(sql).split())): None for kind, name, sql in found}


def fault_of_row(texts: tuple[Any, ...], numbers: tuple[Any, ...], told: tuple[Any, ...]) -> str:
    """What is wrong with a row, in a few words; empty where nothing is.

    Args:
        texts: What must be texts.
        numbers: What must be finite numbers from 0.
        told: What must be mappings of names to numbers, flags, texts, nothing, or lists of these.
    """
    if not all(isinstance(text, str) for text in texts):
        return "a text is none"
    if not all(isinstance(number, int | float) and 0.0 <= number < math.inf for number in numbers):
        return "a number is none"
    if not all(isinstance(each, Mapping) and all(map(_is_plain, each.values())) for each in told):
        return "what was measured is no mapping of plain values"
    return ""


def _is_plain(value: Any) -> bool:
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, int):
        return abs(value) < _LARGEST  # SQLite's and Arrow's integers
    return value is None or isinstance(value, float | str)
