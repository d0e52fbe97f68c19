"""Plain-text tables that fit the terminal."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from textwrap import fill

from ffsm_mj.errors import one_line

_GAP = 2
_CUT = "..."
_LEAST_TEXT = 14
"""Texts are not shortened to less than this."""
_LEAST = 40
"""Narrower terminals are treated as if their width were unknown."""


def terminal_width() -> int | None:
    """Width of the terminal in characters; None if standard output is not a terminal, or a very narrow one."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    return width if width >= _LEAST else None


def wrapped(text: str, indent: int = 0) -> str:
    """A line of text, wrapped at the width of the terminal with its continuation indented; unchanged elsewhere."""
    room = terminal_width()
    if room is None or len(text) <= room:
        return text
    return fill(text, room, subsequent_indent=" " * indent, break_on_hyphens=False, break_long_words=False)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, keys: int = 1, spare: Sequence[str] = ()) -> str:
    """Table with aligned columns: text to the left, numbers to the right.

    On a terminal that is too narrow, columns that can be spared are left out, then long texts are shortened in their middle;
    columns that do not fit even so continue below.

    Args:
        head: Names of the columns; a second line is their unit.
        rows: Rows with as many cells.
        keys: Number of leading columns that identify a row; they are repeated in each part of a divided table.
        spare: Columns that can be left out, by the first line of their heads; the first one first.
    """
    names = [name.split("\n") for name in head]
    height = max(map(len, names))
    body = zip(*(list(map(one_line, row)) for row in rows), strict=True)  # a line break in a name must not start a row
    columns = [[*name, *[""] * (height - len(name)), *cells] for name, cells in zip(names, body, strict=True)]
    room = terminal_width()
    left_out = []
    for name in spare:
        at = next((i for i, column in enumerate(columns) if column[0] == name), None)
        if room is not None and at is not None and _width(columns) > room:
            left_out.append(columns.pop(at)[0])
    if room is not None:
        _shorten(columns, height, room)
    padded = [_padded(column, height) for column in columns]
    parts = _parts([_GAP + len(column[0]) for column in padded], room, keys)
    lines = "\n\n".join(
        "\n".join("".join(f"  {padded[i][row]}" for i in part).rstrip() for row in range(len(padded[0]))) for part in parts
    )
    return lines + (f"\n  left out on a narrow terminal: {', '.join(reversed(left_out))}" if left_out else "")


def _width(columns: Sequence[Sequence[str]]) -> int:
    return sum(_GAP + max(map(len, column)) for column in columns)


def _shorten(columns: Sequence[list[str]], height: int, room: int) -> None:
    """Shorten the texts of the widest columns, in place, until the table fits or none can be shorter."""
    while (excess := _width(columns) - room) > 0:
        texts = [column for column in columns if not _is_numeric(column[height:])]
        widest = max(texts, key=lambda column: max(map(len, column)), default=None)
        width = 0 if widest is None else max(map(len, widest))
        if widest is None or width <= _LEAST_TEXT:
            return
        most = max(_LEAST_TEXT, width - excess)
        widest[height:] = [_shortened(cell, most) for cell in widest[height:]]
        if max(map(len, widest)) == width:  # its head is the widest
            return


def _shortened(text: str, most: int) -> str:
    begin = (most - len(_CUT) + 1) // 2
    return text if len(text) <= most else text[:begin] + _CUT + text[len(text) - (most - len(_CUT) - begin) :]


def _is_numeric(cells: Sequence[str]) -> bool:
    return all(cell[:1] in "0123456789-+." or not cell for cell in cells)


def _padded(column: Sequence[str], height: int) -> list[str]:
    width = max(map(len, column))
    right = _is_numeric(column[height:])
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


def listed(descriptions: Mapping[str, str]) -> str:
    """Names with their descriptions, one entry per line, wrapped at the width of the terminal."""
    width, room = max(map(len, descriptions), default=0), terminal_width()
    lines = [f"{name:{width}}  {text}" for name, text in descriptions.items()]
    if room is None:
        return "\n".join(lines)
    return "\n".join(fill(line, max(room, width + 22), subsequent_indent=(width + 2) * " ") for line in lines)


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, texts: Sequence[str] = ()) -> str:
    """A table with the first column and columns of texts, by their heads, to the left, and numbers to the right."""
    marks = ["---" if i == 0 or name in texts else "---:" for i, name in enumerate(head)]
    lines = ["| " + " | ".join(head) + " |", "|" + "|".join(marks) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])
