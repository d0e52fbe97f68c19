"""Names and order of what scripts read of built-in records: columns of tables, lengths of vectors, keys of summaries.

``layout.json`` is written by ``python -m tests.records.test_layout``; fields in the log are in ``docs/log-reference.md``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, get_origin, get_type_hints

from ffsm_mj.analysis.intervals import ContactInterval, GraspInterval
from ffsm_mj.analysis.tables import MomentumRow
from ffsm_mj.contact_models import registry  # registers the kinds
from ffsm_mj.records.kinds import RecordKind, kinds
from ffsm_mj.records.record import columns_of, lengths_of

FILE = Path(__file__).with_name("layout.json")


def some_record(kind: RecordKind) -> Any:
    """A record with a value in every field: numbers are 1, texts x, mappings have one entry."""
    values = {float: 1.0, int: 1, str: "x", tuple: (1.0, 1.0, 1.0), Mapping: {"total": (1.0,)}}
    hints = get_type_hints(kind.record)
    return kind.record(
        **{each.name: values[get_origin(hints[each.name]) or hints[each.name]] for each in fields(kind.record)}
    )


def layout() -> str:
    """The layout of all kinds as text, a line for each part."""
    parts = {
        f"{kind.name} {part}": found
        for kind in kinds()
        for part, found in (
            ("columns", list(kind.columns) if kind.plural else []),
            ("lengths", [f"{field} {length}" for field, length in sorted(lengths_of(kind.record).items())]),
            ("summary", list(kind.summary(some_record(kind))) if kind.summarised else []),
        )
        if found
    }
    parts |= {f"table {row.__name__}": list(columns_of(row)) for row in (ContactInterval, GraspInterval, MomentumRow)}
    return "{\n" + ",\n".join(f'"{name}": {json.dumps(found)}' for name, found in parts.items()) + "\n}\n"


def test_layout_of_built_in_records():
    assert json.loads(layout()) == json.loads(FILE.read_text())
    assert list(json.loads(FILE.read_text())) == list(json.loads(layout()))
    assert {name.split()[0] for name in json.loads(layout())} == {
        "table",
        *(kind.name for kind in registry.BUILT_IN_RECORDS),
    }


if __name__ == "__main__":
    FILE.write_text(layout())
