"""Table of numbers that a control law reads from a file, with the place of each row for messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import one_line, unknown_name

_LONGEST_TEXT = 40


class TableError(Exception):
    """A cell or a column of a table cannot be used; the message names file and line."""


@dataclass(frozen=True)
class RecordedTable:
    """Columns of a file, as they are written; numbers are made of those that are used.

    Attributes:
        place: The file, in messages.
        columns: Texts or numbers of each column by its name, in the order of the file. Without a header the names are the
            positions from 1.
        lines: Line of each row in the file; None: rows have no lines, and are numbered from 1.
    """

    place: str
    columns: Mapping[str, Sequence[Any]]
    lines: Sequence[int] | None = None

    def __len__(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def row_place(self, row: int) -> str:
        """Place of a row in messages."""
        return f"{self.place}: row {row + 1}" if self.lines is None else f"{self.place}:{self.lines[row]}"

    def name_of(self, column: str | int) -> str:
        """Name of a column that is given by its name or its position from 1.

        Raises:
            TableError: There is no such column.
        """
        names = list(self.columns)
        if isinstance(column, int):
            if column > len(names):
                raise TableError(f"{self.place} has no column {column}; allowed: 1 to {len(names)}")
            return names[column - 1]
        if column not in self.columns:
            raise TableError(f"{self.place}: {unknown_name('column', column, names)}")
        return column

    def numbers(self, name: str) -> FloatArray:
        """A column as numbers, (number of rows,).

        Raises:
            TableError: A cell is empty, no number, or not finite.
        """
        cells = self.columns[name]
        try:
            values = np.array([float(cell) for cell in cells])
        except (TypeError, ValueError):
            values = np.array([_number(cell) for cell in cells])
        wrong = np.flatnonzero(~np.isfinite(values)).tolist()
        if wrong:
            shown = one_line(str(cells[wrong[0]]))[:_LONGEST_TEXT]
            others = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
            problem = f"is {shown!r}" if shown else "is empty"
            message = f"{self.row_place(wrong[0])}: column {name!r} {problem}{others}; finite numbers are allowed"
            raise TableError(message)
        return values

    def since_first(self, name: str) -> FloatArray:
        """A column less its first number, (number of rows,); the digits of stamps since an epoch are not rounded away.

        Raises:
            TableError: See :meth:`numbers`.
        """
        self.numbers(name)
        first, *others = (Decimal(str(cell).strip()) for cell in self.columns[name])
        return np.array([0.0, *(float(other - first) for other in others)])


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return math.nan
