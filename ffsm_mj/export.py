"""Tables of a run as files for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from ffsm_mj.analysis import Run
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.output_place import usable_file, writing
from ffsm_mj.tables import TABLES, Table


def to_arrow(table: Table, facts: dict[str, str] | None = None) -> Any:
    """A ``pyarrow.Table``; each field's metadata holds ``unit`` and ``description``, the schema's the facts of the run."""
    fields, arrays = [], []
    for name, values in table.columns.items():
        array = pa.array(np.ascontiguousarray(values)) if len(values) else pa.array([], type=pa.float64())
        meaning = {"unit": table.units[name], "description": table.descriptions[name]}
        fields.append(pa.field(name, array.type, metadata=meaning))
        arrays.append(array)
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=facts or {}))


def write_table(run: Run, name: str, path: Path, form: str) -> str:
    """Write one table of a run as ``csv`` or ``parquet``.

    CSV: one header line of names that end in the unit, then shortest decimals that give the same doubles again.

    Returns:
        What was written, for a person.

    Raises:
        InputError: No such table, or the file cannot be written to.
        OutputLostError: It could not be written to its end.
    """
    if name not in TABLES:
        raise InputError(f"--table: {unknown_name('table', name, TABLES)}")
    usable_file(path)
    table = to_arrow(run.table(name), {"scenario": run.name, **run.log.header.facts})
    with writing(path), path.open("wb") as stream:  # a path would be removed by pyarrow where writing fails, be it a device
        if form == "parquet":
            pyarrow.parquet.write_table(table, stream)
        else:
            stream.write((",".join(table.column_names) + "\n").encode())
            pyarrow.csv.write_csv(table, stream, pyarrow.csv.WriteOptions(include_header=False))
    return f"{table.num_rows} rows of {table.num_columns} columns"
