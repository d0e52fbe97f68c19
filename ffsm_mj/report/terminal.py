"""Text for a terminal: wrapped at its width, tables that fit it; elsewhere lines are as long as they are."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TextIO

from ffsm_mj.errors import one_line

_LEAST = 40
"""Narrower terminals are treated as if their width were unknown."""
_GAP = 2
_LEAST_TEXT = 10
"""Texts in tables are not folded to less than this."""
_UNIT = re.compile(r"(?<=\d) (?=[A-Za-z/^]{1,5}(?!\w))|(?<=\bN) (?=[ms]\b)|(?<=\bN m) (?=s\b)|(?<=\bkg) (?=m)")
"""Blanks between a number and its unit, and within a unit."""
_COMPONENTS = re.compile(r"(?:(?<=\.\d{3})|(?<=\.\d{4})) +(?=-?\d+\.\d)")
"""Blanks between the components of a vector or a quaternion, which have three or four decimals."""
_FIRM = "\N{NO-BREAK SPACE}"


def terminal_width(stream: TextIO | None = None) -> int | None:
    """Width of the terminal in characters; None if a stream (standard output) is no terminal, or a very narrow one."""
    width = shutil.get_terminal_size().columns if (stream or sys.stdout).isatty() else 0
    return width if width >= _LEAST else None


def wrapped(text: str, stream: TextIO | None = None) -> str:
    """Lines wrapped at the width of the terminal, not between a number and its unit or the next component."""
    room = terminal_width() if stream is None else terminal_width(stream)
    if room is None:
        return text
    lines = []
    for line in text.split("\n"):
        if len(line) > room:
            indent = " " * (len(line) - len(line.lstrip()) + 2)
            firm = _COMPONENTS.sub(lambda blanks: _FIRM * len(blanks[0]), _UNIT.sub(_FIRM, line))
            line = fill(firm, room, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)  # noqa: PLW2901
        lines.append(line.replace(_FIRM, " "))
    return "\n".join(lines)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, spare: Sequence[str] = ()) -> str:
    """Table with aligned columns: text to the left, numbers to the right.

    On a terminal that is too narrow, columns that can be spared are left out, then long texts are folded.

    Args:
        head: Names of the columns; a second line is their unit.
        rows: Rows with as many cells.
        spare: Columns that can be left out, by the first line of their heads; the first one first.
    """
    names = [name.split("\n") for name in head]
    height = max(map(len, names))
    body = zip(*(list(map(one_line, row)) for row in rows), strict=True)  # a line break in a name must not start a row
    columns = [[*name, *[""] * (height - len(name)), *cells] for name, cells in zip(names, body, strict=True)]
    room, left_out = terminal_width(), list[str]()
    for name in spare:
        at = next((i for i, column in enumerate(columns) if column[0] == name), None)
        if room is not None and at is not None and _width(columns) > room:
            left_out.insert(0, columns.pop(at)[0])
    numeric = [all(cell[:1] in "0123456789-+." or not cell for cell in column[height:]) for column in columns]
    lines = _lines(columns, numeric) if room is None or _width(columns) <= room else _folded(columns, numeric, room)
    return "\n".join([*lines, *([f"  left out on a narrow terminal: {', '.join(left_out)}"] if left_out else [])])


def _width(columns: Sequence[Sequence[str]]) -> int:
    return sum(_GAP + max(map(len, column)) for column in columns)


def _lines(columns: Sequence[Sequence[str]], numeric: Sequence[bool]) -> list[str]:
    sides = [str.rjust if right else str.ljust for right in numeric]
    widths = [max(map(len, column)) for column in columns]
    rows = zip(*columns, strict=True)
    return [
        "".join("  " + side(cell, width) for side, cell, width in zip(sides, row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _folded(columns: Sequence[Sequence[str]], numeric: Sequence[bool], room: int) -> list[str]:
    """Rows whose texts go on below in their columns; numbers stay whole, if necessary beyond the edge of the terminal."""
    from rich.console import Console
    from rich.table import Table

    grid = Table.grid(padding=(0, 0, 0, _GAP), pad_edge=True)
    needed = 0
    for column, right in zip(columns, numeric, strict=True):
        least = max(map(len, column)) if right else min(_LEAST_TEXT, max(map(len, column)))
        needed += _GAP + least
        grid.add_column(justify="right" if right else "left", no_wrap=right, min_width=least, overflow="fold")
    for row in zip(*columns, strict=True):
        grid.add_row(*row)
    console = Console(width=max(room, needed))  # rich would cut what does not fit
    with console.capture() as captured:
        console.print(grid)
    return [line.rstrip() for line in captured.get().splitlines()]


def listed(descriptions: Mapping[str, str]) -> str:
    """Names with their descriptions, one entry per line, wrapped at the width of the terminal."""
    width, room = max(map(len, descriptions), default=0), terminal_width()
    lines = [f"{name:{width}}  {text}" for name, text in descriptions.items()]
    if room is None:
        return "\n".join(lines)
    return "\n".join(fill(line, max(room, width + 22), subsequent_indent=(width + 2) * " ") for line in lines)
