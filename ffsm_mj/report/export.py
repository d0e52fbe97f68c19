"""Export of a run's tables as CSV or Parquet."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks, angular_momentum
from ffsm_mj.analysis.tables import (
    CHECKS_TABLE,
    MOMENTUM_TABLE,
    Table,
    checks_table,
    momentum_table,
    samples,
    table_names,
)
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, plural, unknown_name
from ffsm_mj.report.output_place import new_file, usable_file

_ROWS_AT_ONCE = 50_000


def to_arrow(table: Table, metadata: dict[str, str] | None = None) -> Any:
    """Arrow table with ``unit`` and ``description`` in the metadata of each field, and metadata of the run in the schema."""
    fields, arrays = [], []
    for name, values in table.columns.items():
        array = pa.array(np.ascontiguousarray(values)) if len(values) else pa.array([], type=pa.float64())
        meaning = {"unit": table.units[name], "description": table.descriptions[name]}
        fields.append(pa.field(name, array.type, metadata=meaning))
        arrays.append(array)
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata or {}))


def write_table(run: Run, name: str, path: Path, form: str) -> str:
    """Write one table of a run as ``csv`` or ``parquet``.

    CSV has one header line of names that end in the unit; numbers are the shortest decimals that round-trip.

    Returns:
        One line that describes the output.

    Raises:
        InputError: No such table, or the file cannot be written.
        OutputLostError: The file could not be written completely.
    """
    names = (*table_names(run.log), MOMENTUM_TABLE)
    if name not in names:
        raise InputError(f"--table: {unknown_name('table', name, names)}")
    return write_arrow(_parts(run, name), path, form)


def write_arrow(parts: Iterator[Any], path: Path, form: str) -> str:
    """Write an Arrow table, given in one or more parts, as ``csv`` or ``parquet``; see :func:`write_table`."""
    usable_file(path)
    first, rows = next(parts), 0
    with (
        new_file(path) as place,
        place.open("wb") as stream,  # pyarrow would remove the path if writing fails, even a device
        _writer(stream, first.schema, form) as writer,
    ):
        for part in chain([first], parts):
            writer.write_table(part)
            rows += part.num_rows
    return f"{plural(rows, 'row')} of {plural(first.num_columns, 'column')}"


def _writer(stream: BinaryIO, schema: Any, form: str) -> Any:
    if form == "parquet":
        return pyarrow.parquet.ParquetWriter(stream, schema)
    stream.write((",".join(schema.names) + "\n").encode())  # pyarrow would quote the names
    return pyarrow.csv.CSVWriter(stream, schema, write_options=pyarrow.csv.WriteOptions(include_header=False))


def _parts(run: Run, name: str) -> Iterator[Any]:
    """One table of a run in one or more parts; samples in blocks of some ten thousand."""
    metadata, blocks = {"scenario": run.name, **run.log.header.metadata}, list[FloatArray]()
    if name != "samples" or not len(run.log.rows):
        yield to_arrow(_table(run, name), metadata)
        return
    for block in run.log.blocks():
        blocks.append(block)
        if sum(map(len, blocks)) >= _ROWS_AT_ONCE:
            yield to_arrow(samples(run.log.header.layout, np.concatenate(blocks)), metadata)
            blocks = []
    if blocks:
        yield to_arrow(samples(run.log.header.layout, np.concatenate(blocks)), metadata)


def _table(run: Run, name: str) -> Table:
    """A table of a run, of its models too."""
    if name == MOMENTUM_TABLE:
        return momentum_table(angular_momentum(run))
    return checks_table(all_checks(run)) if name == CHECKS_TABLE else run.table(name)
