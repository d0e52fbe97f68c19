"""Reads recorded numbers from CSV, Parquet, or a log of ffsm-mj, for control laws that play them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ffsm_mj.errors import InputError, LogError, described, working_on
from ffsm_mj.log import limits
from ffsm_mj.log.mcap.reader import read_log
from ffsm_mj.log.mcap.salvage import MAGIC
from ffsm_mj.log.run_folder import find_log
from ffsm_mj.records.recorded_table import RecordedTable
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import TIME, identifier

_PARQUET = b"PAR1"
_COMMENT = "#"


@dataclass(frozen=True)
class RecordedFile:
    """A file with recorded numbers.

    Attributes:
        name: Its name in the run folder and the log of the run that plays it.
        content: Its content there: of a log only the efforts, as CSV.
        table: Its columns.
    """

    name: str
    content: bytes
    table: RecordedTable


def read_recorded(path: Path) -> RecordedFile:
    """Read a CSV or Parquet file, or the efforts of a run from its log or folder.

    Raises:
        InputError: There is no such file, or it holds no table.
    """
    try:
        if is_log(path):
            return _of_log(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    return read_table(path)


def is_log(path: Path) -> bool:
    """Whether a path is a folder, as of a run, or a log."""
    return path.is_dir() or (path.is_file() and _begins_with(path, MAGIC))


def read_table(path: Path) -> RecordedFile:
    """Read a CSV or Parquet file.

    Raises:
        InputError: There is no such file, or it holds no table.
    """
    try:
        if not path.is_file():
            raise InputError(f"{path}: is not a file")
        if path.stat().st_size > limits.TABLE_BYTES:
            raise InputError(f"{path}: is larger than {limits.TABLE_BYTES >> 20} MiB; leave out columns or samples")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    table = _parquet(path, content) if content.startswith(_PARQUET) else _text(str(path), content)
    return RecordedFile(path.name, content, table)


def _begins_with(path: Path, magic: bytes) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(magic)) == magic


def _of_log(path: Path) -> RecordedFile:
    """Efforts of a run.

    Raises:
        InputError: There is no log, or it has no efforts.
    """
    try:
        place = find_log(path)
        log = read_log(place)
        if log.damage:
            raise InputError(f"{place}: is damaged, so some of its efforts may be missing ({log.damage})")
        with working_on(place):
            content = recorded_efforts(log).encode()
    except LogError as error:
        raise InputError(str(error)) from error
    if not content:
        raise InputError(f"{place}: contains no efforts of actuators")
    if len(content) > limits.TABLE_BYTES:
        raise InputError(
            f"{place}: has more than {limits.TABLE_BYTES >> 20} MiB of efforts; play a part of it from a CSV file"
        )
    name = (path.name if path.is_dir() else path.name.partition(".")[0]) or "run"
    return RecordedFile(f"{name}.csv", content, RecordedTable(str(place), _text(str(place), content).columns))


def _parquet(path: Path, content: bytes) -> RecordedTable:
    """Columns of a Parquet file.

    Raises:
        InputError: It cannot be read, or has no rows.
    """
    import pyarrow.parquet  # takes a tenth of a second

    try:
        table = pyarrow.parquet.read_table(io.BytesIO(content))
        columns = {name: table.column(name).to_numpy() for name in _distinct(str(path), table.column_names)}
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{path}: cannot be read as Parquet ({described(error)})") from error
    if not table.num_rows:
        raise InputError(f"{path}: has no rows")
    return RecordedTable(str(path), columns)


def _text(place: str, content: bytes) -> RecordedTable:
    """Columns of a text, separated by commas, semicolons, tabs or spaces.

    The first line is a header unless all of it are numbers. Empty lines and those that begin with ``#`` are skipped.

    Raises:
        InputError: It is no text, it has no rows, or rows of different lengths.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{place}: is neither text in UTF-8, nor Parquet, nor a log of ffsm-mj") from error
    try:
        table_rows = list(_rows(text))
    except csv.Error as error:
        raise InputError(f"{place}: cannot be read as CSV ({error})") from error
    if not table_rows:
        raise InputError(f"{place}: is empty; a table with a row for each sample is needed")
    first_line, first = table_rows[0]
    has_header = not all(map(_is_number, first))
    names = _distinct(place, first) if has_header else [str(i + 1) for i in range(len(first))]
    rows = table_rows[1:] if has_header else table_rows
    if not rows:
        raise InputError(f"{place}:{first_line}: has a header and no rows; a row for each sample is needed")
    for line, cells in rows:
        if len(cells) != len(names):
            raise InputError(f"{place}:{line}: has {len(cells)} columns, and line {first_line} has {len(names)}")
    columns = dict(zip(names, zip(*(cells for _, cells in rows), strict=True), strict=True))
    return RecordedTable(place, columns, [line for line, _ in rows])


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    first = next((line for line in lines if _has_cells(line)), "")
    separator = next((mark for mark in (",", ";", "\t") if mark in first), None)
    for number, line in enumerate(lines, start=1):
        if _has_cells(line):
            is_quoted = separator is not None and '"' in line
            cells = next(csv.reader([line], delimiter=str(separator))) if is_quoted else line.split(separator)
            yield number, [cell.strip() for cell in cells]


def _has_cells(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(_COMMENT)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _distinct(place: str, names: Sequence[str]) -> Sequence[str]:
    """The names of columns.

    Raises:
        InputError: Two are the same.
    """
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise InputError(f"{place}: has two columns {twice!r}")
    return names


_GROUP, _APPLIED = "actuators.", "_applied"


def recorded_efforts(log: RunLog) -> str:
    """CSV of the time and the efforts that the actuators delivered; empty if there are no actuators.

    Numbers are written so that they are read again bit for bit. Where an event follows a row at once, the efforts after it
    stand for both.
    """
    keys = [key for key in log.header.layout.index if key.startswith(_GROUP) and _APPLIED in key]
    if not keys or not len(log.rows):
        return ""
    rows: list[tuple[float, list[float]]] = []
    for _, is_event, time_s, efforts in sorted([*_ticks(log, keys), *_events(log, keys)], key=lambda entry: entry[:3]):
        if rows and time_s <= rows[-1][0]:  # the same time, up to rounding
            rows[-1] = rows[-1][0], efforts
        elif not (is_event and rows and efforts == rows[-1][1]):  # most events leave the efforts as they are
            rows.append((time_s, efforts))
    lines = (",".join(map(repr, (time_s, *efforts))) for time_s, efforts in rows)
    return "\n".join([",".join([TIME, *keys]), *lines]) + "\n"


_Instant = tuple[int, bool, float, list[float]]
"""Integration step that begins there or in which it is, whether it is an event, time in s, and efforts: in their order."""


def _ticks(log: RunLog, keys: Sequence[str]) -> Iterator[_Instant]:
    """Efforts at the rows."""
    step_s = float(log.header.metadata["time_step_s"])
    for time_s, *efforts in zip(*(log.column(key).tolist() for key in (TIME, *keys)), strict=True):
        yield round(time_s / step_s), False, time_s, efforts


def _events(log: RunLog, keys: Sequence[str]) -> Iterator[_Instant]:
    """Efforts after events."""
    column = {key.removeprefix(_GROUP).rpartition(_APPLIED)[0]: i for i, key in enumerate(keys)}
    for record in log.events:
        if changed := getattr(record, "efforts_after", None):
            efforts = [0.0] * len(keys)
            for name, (effort,) in changed.items():
                efforts[column[identifier(name)]] = effort
            yield record.step, True, record.time_s, efforts
