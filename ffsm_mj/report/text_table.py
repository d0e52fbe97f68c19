"""Plain-text tables; columns that do not fit the terminal continue below."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence

from ffsm_mj.errors import one_line

_LEAST = 40
"""Narrower terminals are treated as if their width were unknown."""


def terminal_width() -> int | None:
    """Width of the terminal in characters; None if standard output is not a terminal, or a very narrow one."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    return width if width >= _LEAST else None


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, keys: int = 1) -> str:
    """Table with aligned columns: text to the left, numbers to the right.

    Args:
        head: Names of the columns.
        rows: Rows with as many cells.
        keys: Number of leading columns that identify a row; they are repeated in each part of a divided table.
    """
    cells = [list(head), *(list(map(one_line, row)) for row in rows)]  # a line break in a name must not start a row
    columns = [_padded(column) for column in zip(*cells, strict=True)]
    parts = _parts([2 + len(column[0]) for column in columns], terminal_width(), keys)
    return "\n\n".join(
        "\n".join("".join(f"  {columns[i][row]}" for i in part).rstrip() for row in range(len(cells))) for part in parts
    )


def _padded(column: Sequence[str]) -> list[str]:
    width = max(map(len, column))
    right = all(cell[:1] in "0123456789-+." or not cell for cell in column[1:])
    return [cell.rjust(width) if right else cell.ljust(width) for cell in column]


def _parts(widths: Sequence[int], room: int | None, keys: int) -> Iterator[list[int]]:
    """Columns of each part of a divided table; all of them if the width is unlimited."""
    part = first = list(range(min(keys, len(widths))))
    for i in range(len(first), len(widths)):
        if room is not None and len(part) > len(first) and sum(widths[k] for k in (*part, i)) > room:
            yield part
            part = first
        part = [*part, i]
    yield part


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with the first column left-aligned."""
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])
