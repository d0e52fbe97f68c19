"""Text for a terminal: wrapped at its width, tables that fit it; elsewhere lines are as long as they are."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from textwrap import fill, wrap
from typing import TextIO

from ffsm_mj.errors import one_line

_LEAST = 40
"""Narrower terminals are treated as if their width were unknown."""
_GAP = 2
_LONGEST_WORD = 16
"""Words of texts in tables are divided if they are longer than this."""
FOLD = "\N{LINE SEPARATOR}"
"""Between the lines of one row of a table whose texts are folded: they have one colour."""
_UNIT = re.compile(r"(?<=\d) (?=[A-Za-z/^]{1,5}(?!\w))|(?<=\bN) (?=[ms]\b)|(?<=\bN m) (?=s\b)|(?<=\bkg) (?=m)")
"""Blanks between a number and its unit, and within a unit."""
_COMPONENTS = re.compile(r"(?:(?<=\.\d{3})|(?<=\.\d{4})) +(?=-?\d+\.\d)")
"""Blanks between the components of a vector or a quaternion, which have three or four decimals."""
_FIRM = "\N{NO-BREAK SPACE}"
_WORDS = re.compile(r"(?:[^\s'\"]|'[^']*'|\"[^\"]*\")+")
"""Words of a command of a shell."""


def terminal_width(stream: TextIO | None = None) -> int | None:
    """Width of the terminal in characters; None if a stream (standard output) is no terminal, or a very narrow one."""
    width = shutil.get_terminal_size().columns if (stream or sys.stdout).isatty() else 0
    return width if width >= _LEAST else None


def wrapped(text: str, stream: TextIO | None = None) -> str:
    """Lines wrapped at the width of the terminal, not between a number and its unit or the next component."""
    room = terminal_width() if stream is None else terminal_width(stream)
    if room is None:
        return text.replace(FOLD, "\n")
    lines = []
    for line in text.replace(FOLD, "\n").split("\n"):
        if len(line) > room:
            indent = " " * (len(line) - len(line.lstrip()) + 2)
            firm = _COMPONENTS.sub(lambda blanks: _FIRM * len(blanks[0]), _UNIT.sub(_FIRM, line))
            if len(indent) + max(map(len, firm.split(" "))) > room:  # a vector that is longer than a line
                firm = _UNIT.sub(_FIRM, line)
            line = fill(firm, room, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)  # noqa: PLW2901
        lines.append(line.replace(_FIRM, " "))
    return "\n".join(lines)


def wrapped_command(label: str, command: str) -> str:
    """A command below or after a label; on a narrow terminal it goes on in further lines, which can be copied as a whole."""
    room = terminal_width()
    if room is None or len(label) + len(command) <= room or os.name == "nt":  # there, a backslash does not go on
        return label + command
    lines, indent = [label], " " * (len(label) - len(label.lstrip()) + 2)
    for word in _WORDS.findall(command):
        begun = lines[-1].strip() not in ("", label.strip())
        if begun and len(lines[-1]) + len(word) + 3 > room:
            lines[-1] += " \\"
            lines.append(indent)
            begun = False
        lines[-1] += f"{' ' * begun}{word}"
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
    widths = [max(map(len, column)) for column in columns]
    return [_line(row, widths, numeric) for row in zip(*columns, strict=True)]


def _line(cells: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> str:
    sides = [str.rjust if right else str.ljust for right in numeric]
    return "".join("  " + side(cell, width) for side, cell, width in zip(sides, cells, widths, strict=True)).rstrip()


def _folded(columns: Sequence[Sequence[str]], numeric: Sequence[bool], room: int) -> list[str]:
    """Rows whose texts go on below in their columns; numbers stay whole, if necessary beyond the edge of the terminal."""
    columns = [[_UNIT.sub(_FIRM, cell) for cell in column] for column in columns]
    widths = [max(map(len, column)) for column in columns]
    words = [max((len(word) for cell in column for word in cell.split(" ")), default=0) for column in columns]
    least = [width if right else min(word, _LONGEST_WORD) for width, word, right in zip(widths, words, numeric, strict=True)]
    while sum(widths) + _GAP * len(widths) > room and widths != least:
        widest = max((i for i, width in enumerate(widths) if width > least[i]), key=widths.__getitem__)
        widths[widest] -= 1
    return [FOLD.join(_folded_row(row, widths, numeric)).replace(_FIRM, " ") for row in zip(*columns, strict=True)]


def _folded_row(row: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> Iterator[str]:
    cells = [wrap(cell, max(width, 1), break_on_hyphens=False) or [""] for cell, width in zip(row, widths, strict=True)]
    for parts in zip_longest(*cells, fillvalue=""):
        yield _line(parts, widths, numeric)


def listed(descriptions: Mapping[str, str]) -> str:
    """Names with their descriptions, one entry per line, wrapped at the width of the terminal."""
    width, room = max(map(len, descriptions), default=0), terminal_width()
    lines = [f"{name:{width}}  {text}" for name, text in descriptions.items()]
    if room is None:
        return "\n".join(lines)
    return "\n".join(fill(line, max(room, width + 22), subsequent_indent=(width + 2) * " ") for line in lines)
