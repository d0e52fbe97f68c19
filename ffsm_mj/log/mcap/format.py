"""The bytes of ``run.mcap``, defined once for writer and reader: topics, protobuf schemas and the layout of a sample.

``/ffsm/sample`` nests one message per signal group; every field is a double and always present, so a message is a
constant template with float64 values at fixed offsets, and a block of rows is encoded by numpy in one go.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.wire import varint
from ffsm_mj.records.events import ImpactRecord, OutcomeRecord, PhaseRecord, Report, UnhandledContactRecord
from ffsm_mj.records.signals import GROUPS, Layout, Signal

SAMPLE_TOPIC = "/ffsm/sample"
SAMPLE_SCHEMA = "ffsm.Sample"
RECORD_TOPICS: dict[type, str] = {
    ImpactRecord: "/ffsm/impact",
    PhaseRecord: "/ffsm/phase",
    UnhandledContactRecord: "/ffsm/unhandled_contact",
    OutcomeRecord: "/ffsm/outcome",
}
SIGNALS_METADATA = "ffsm.signals"
FACTS_METADATA = "ffsm.run"
SCENARIO_ATTACHMENT = "scenario.yaml"

_MOST_SCHEMA_BYTES = 1 << 21
"""Of a sample: a column takes some 30 bytes."""
_Field = descriptor_pb2.FieldDescriptorProto
_MESSAGE_CLASSES: dict[type[Any], Any] = {}
_LENGTHS = {"geoms": 2, "point_m": 3, "normal": 3, "angular_impulse_N_m_s": 3}
_TOTALS = {"energy_before_J": 1, "energy_after_J": 1, "momentum_before": 6, "momentum_after": 6}
_SCALARS = {float: _Field.TYPE_DOUBLE, int: _Field.TYPE_INT64, str: _Field.TYPE_STRING}


def schema_name(record_type: type) -> str:
    """Protobuf name of an event: ``ffsm.Impact`` for ``ImpactRecord``."""
    return f"ffsm.{record_type.__name__.removesuffix('Record')}"


# --- /ffsm/sample -----------------------------------------------------------------------------------------------------


def sample_schema(layout: Layout) -> bytes:
    """FileDescriptorSet of the sample message of one run."""
    file = descriptor_pb2.FileDescriptorProto(name="ffsm/sample.proto", package="ffsm", syntax="proto3")
    sample = descriptor_pb2.DescriptorProto(name="Sample")
    for number, group in enumerate(_groups(layout), start=1):
        message = file.message_type.add(name=group.capitalize())
        for i, signal in enumerate(_members(layout, group), start=1):
            message.field.add(name=signal.name, number=i, type=_Field.TYPE_DOUBLE, label=_Field.LABEL_OPTIONAL)
        sample.field.add(
            name=group,
            number=number,
            type=_Field.TYPE_MESSAGE,
            label=_Field.LABEL_OPTIONAL,
            type_name=f".ffsm.{group.capitalize()}",
        )
    file.message_type.append(sample)
    return bytes(descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString())


def signals_metadata(layout: Layout) -> dict[str, str]:
    """``unit | description`` of every column by key."""
    return {signal.key: f"{signal.unit} | {signal.description}" for signal in layout.signals}


def layout_of_schema(schema: bytes, units: Mapping[str, str]) -> Layout:
    """Columns of a sample message as its schema in a file states them.

    Args:
        schema: FileDescriptorSet from the file.
        units: ``unit | description`` by key, from the file's metadata.

    Raises:
        ValueError: It states more than a run has columns.
    """
    if len(schema) > _MOST_SCHEMA_BYTES:
        raise ValueError(f"a schema of {len(schema)} bytes")
    file = descriptor_pb2.FileDescriptorSet.FromString(schema).file[0]
    messages = {message.name: message for message in file.message_type}
    signals = []
    for group in messages["Sample"].field:
        for field in messages[group.type_name.rsplit(".", 1)[-1]].field:
            unit, _, description = units.get(f"{group.name}.{field.name}", " | ").partition(" | ")
            signals.append(Signal(group.name, field.name, unit, description))
    return Layout(tuple(signals))


class SampleCodec:
    """Rows to messages and back, a block at a time."""

    def __init__(self, layout: Layout) -> None:
        """Build the template of a message and the offsets of its values."""
        template = bytearray()
        offsets: list[int] = []
        for number, group in enumerate(_groups(layout), start=1):
            body = bytearray()
            at: list[int] = []
            for i in range(1, len(_members(layout, group)) + 1):
                body += varint(i << 3 | 1)
                at.append(len(body))
                body += bytes(8)
            template += varint(number << 3 | 2) + varint(len(body))
            offsets += [len(template) + offset for offset in at]
            template += body
        self._template = np.frombuffer(bytes(template), dtype=np.uint8)
        names = [f"f{i}" for i in range(len(offsets))]
        formats = ["<f8"] * len(offsets)
        self._record = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": len(template)})
        self._positions = np.array(offsets, dtype=np.intp)[:, None] + np.arange(8)
        self._fixed = np.setdiff1d(np.arange(len(template)), self._positions)

    @property
    def message_size(self) -> int:
        """Bytes of one message."""
        return len(self._template)

    def encode(self, rows: FloatArray) -> npt.NDArray[np.uint8]:
        """One protobuf message per row, (n, bytes of one)."""
        out = np.tile(self._template, (len(rows), 1))
        record = out.view(self._record)[:, 0]
        for name, column in zip(self._record.names or (), rows.T, strict=True):
            record[name] = column
        return out

    def decode(self, messages: npt.NDArray[np.uint8], columns: Sequence[int] | None = None) -> FloatArray:
        """Rows of messages, (n, bytes of one): all columns, or some of them.

        Raises:
            ValueError: A message has not the layout of its schema.
        """
        if messages.shape[1] != self.message_size:
            raise ValueError("a sample has not the size that its schema implies")
        if (messages[:, self._fixed] != self._template[self._fixed]).any():
            raise ValueError("a sample has not the fields that its schema states")
        positions = self._positions if columns is None else self._positions[list(columns)]
        values: npt.NDArray[np.uint8] = np.ascontiguousarray(messages[:, positions.ravel()])
        return values.view("<f8").astype(np.float64)


def _groups(layout: Layout) -> list[str]:
    present = {signal.group for signal in layout.signals}
    return [group for group in GROUPS if group in present]


def _members(layout: Layout, group: str) -> list[Signal]:
    return [signal for signal in layout.signals if signal.group == group]


# --- events -----------------------------------------------------------------------------------------------------------


def record_schema(record_type: type) -> bytes:
    """FileDescriptorSet of an event, derived from its dataclass."""
    file = descriptor_pb2.FileDescriptorProto(
        name=f"ffsm/{record_type.__name__.lower()}.proto", package="ffsm", syntax="proto3"
    )
    message = file.message_type.add(name=schema_name(record_type).removeprefix("ffsm."))
    hints = get_type_hints(record_type)
    for number, field in enumerate(fields(record_type), start=1):
        _add_field(message, field.name, number, hints[field.name])
    return bytes(descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString())


def _add_field(message: Any, name: str, number: int, hint: Any) -> None:
    """Add a field: scalar, sequence of scalars, or map from names to text, to lists of doubles or to reports."""
    scalar = _SCALARS.get(hint)
    if scalar is not None:
        message.field.add(name=name, number=number, type=scalar, label=_Field.LABEL_OPTIONAL)
        return
    kind, parts = get_origin(hint), get_args(hint)
    if kind is tuple:
        message.field.add(name=name, number=number, type=_SCALARS[parts[0]], label=_Field.LABEL_REPEATED)
        return
    entry_name = "".join(part.capitalize() for part in name.split("_")) + "Entry"
    entry = message.nested_type.add(name=entry_name)
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=_Field.TYPE_STRING, label=_Field.LABEL_OPTIONAL)
    path = f".ffsm.{message.name}"
    if parts[1] in (str, Report):
        entry.field.add(name="value", number=2, type=_Field.TYPE_STRING, label=_Field.LABEL_OPTIONAL)
    else:
        if not any(nested.name == "Values" for nested in message.nested_type):
            values = message.nested_type.add(name="Values")
            values.field.add(name="values", number=1, type=_Field.TYPE_DOUBLE, label=_Field.LABEL_REPEATED)
        entry.field.add(
            name="value",
            number=2,
            type=_Field.TYPE_MESSAGE,
            label=_Field.LABEL_OPTIONAL,
            type_name=f"{path}.Values",
        )
    message.field.add(
        name=name,
        number=number,
        type=_Field.TYPE_MESSAGE,
        label=_Field.LABEL_REPEATED,
        type_name=f"{path}.{entry_name}",
    )


def _message_class(record_type: type[Any]) -> Any:
    if record_type in _MESSAGE_CLASSES:
        return _MESSAGE_CLASSES[record_type]
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(record_schema(record_type)).file:
        pool.Add(file)
    _MESSAGE_CLASSES[record_type] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema_name(record_type)))
    return _MESSAGE_CLASSES[record_type]


def encode_record(record: Any) -> bytes:
    """Protobuf bytes of an event."""
    message = _message_class(type(record))()
    for name, value in _items(record):
        if isinstance(value, Mapping):
            for key, entry in value.items():
                if isinstance(entry, str | Mapping):
                    getattr(message, name)[key] = entry if isinstance(entry, str) else json.dumps(entry)
                else:
                    getattr(message, name)[key].values.extend(entry)
        elif isinstance(value, tuple):
            getattr(message, name).extend(value)
        else:
            setattr(message, name, value)
    return bytes(message.SerializeToString(deterministic=True))


def decode_record(record_type: type, data: bytes) -> Any:
    """Event of protobuf bytes; inverse of :func:`encode_record`."""
    message = _message_class(record_type).FromString(data)
    hints = get_type_hints(record_type)
    values = {}
    for field in fields(record_type):
        value, hint = getattr(message, field.name), hints[field.name]
        kind = get_origin(hint)
        if kind is tuple:
            value = tuple(value)
        elif kind is not None:
            value = {key: _entry(get_args(hint)[1], entry) for key, entry in value.items()}
        values[field.name] = value
    _check_lengths(values)
    return record_type(**values)


def _entry(hint: Any, entry: Any) -> Any:
    """One entry of a map."""
    if hint is str:
        return entry
    return _report(entry) if hint == Report else tuple(entry.values)


def _report(text: str) -> Report:
    """A report of its JSON.

    Raises:
        ValueError: It is none.
    """
    try:
        found = json.loads(text)
    except RecursionError as error:
        raise ValueError("a report is nested too deeply") from error
    if not isinstance(found, dict) or not all(map(_is_told, found.values())):
        raise ValueError("a report has other values than finite numbers and texts")
    return found


def _is_told(value: Any) -> bool:
    return isinstance(value, int | str) or (isinstance(value, float) and math.isfinite(value))


def _check_lengths(values: Mapping[str, Any]) -> None:
    """Refuse an event whose vectors are no vectors: a length is nothing that a schema states.

    Raises:
        ValueError: A field has too many numbers or names, or too few.
    """
    for name, length in _LENGTHS.items():
        if name in values and len(values[name]) != length:
            raise ValueError(f"{name} of an event has {len(values[name])} values, not {length}")
    for name, length in _TOTALS.items():
        if name in values and len(values[name].get("total", ())) != length:
            raise ValueError(f"{name} of an event lacks its {length} of the total")


def _items(record: Any) -> Iterator[tuple[str, Any]]:
    for field in fields(record):
        yield field.name, getattr(record, field.name)
