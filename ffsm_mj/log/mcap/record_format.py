"""Encoding of event records in ``run.mcap``, for writer and reader: a protobuf schema derived from the dataclass."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from itertools import takewhile
from typing import Any, get_args, get_origin, get_type_hints

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from ffsm_mj.records.events import ControllerReport
from ffsm_mj.records.kinds import RecordKind, kind_of

_Field = descriptor_pb2.FieldDescriptorProto
_MESSAGE_CLASSES: dict[tuple[type, str], Any] = {}
_SCALARS = {float: _Field.TYPE_DOUBLE, int: _Field.TYPE_INT64, str: _Field.TYPE_STRING}


def record_schema(kind: RecordKind, without: int = 0) -> bytes:
    """FileDescriptorSet of a kind of record, derived from its dataclass; the last ``without`` fields are left out."""
    name, hints = kind.record.__name__.lower(), get_type_hints(kind.record)
    file = descriptor_pb2.FileDescriptorProto(name=f"ffsm/{name}.proto", package="ffsm", syntax="proto3")
    message = file.message_type.add(name=kind.schema.removeprefix("ffsm."))
    for number, field in enumerate(fields(kind.record)[: len(fields(kind.record)) - without], start=1):
        _add_field(message, field.name, number, hints[field.name])
    return bytes(descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString())


def is_schema_of(kind: RecordKind, schema: bytes) -> bool:
    """Whether a schema in a file is that of a kind, possibly serialised by another program.

    A schema may lack the last fields that have zero or empty defaults: protobuf reads missing fields as such.

    Raises:
        DecodeError: The bytes are not a schema.
    """
    ours = record_schema(kind)
    if schema == ours:
        return True
    if len(schema) > 2 * len(ours):  # do not parse a large schema of unknown origin
        return False
    parse = descriptor_pb2.FileDescriptorSet.FromString
    later = sum(1 for _ in takewhile(lambda field: field.default in (0, ""), reversed(fields(kind.record))))
    return any(parse(schema) == parse(record_schema(kind, without)) for without in range(later + 1))


def _add_field(message: Any, name: str, number: int, hint: Any) -> None:
    """Add a field to a message: a scalar, a list of scalars, or a map from names to text, lists of doubles or reports."""
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
    if parts[1] in (str, ControllerReport):
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


def _message_class(kind: RecordKind) -> Any:
    key = kind.record, kind.schema
    if key not in _MESSAGE_CLASSES:
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(record_schema(kind)).file:
            pool.Add(file)
        _MESSAGE_CLASSES[key] = message_factory.GetMessageClass(pool.FindMessageTypeByName(kind.schema))
    return _MESSAGE_CLASSES[key]


def encode_record(record: Any) -> bytes:
    """Protobuf bytes of a record."""
    message = _message_class(kind_of(record))()
    for name, value in ((field.name, getattr(record, field.name)) for field in fields(record)):
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


def decode_record(kind: RecordKind, data: bytes) -> Any:
    """Record from protobuf bytes; inverse of :func:`encode_record`.

    Raises:
        ValueError: A field has a wrong number of values.
        DecodeError: The bytes are not a message of this kind.
    """
    message = _message_class(kind).FromString(data)
    hints = get_type_hints(kind.record)
    values = {}
    for field in fields(kind.record):
        value, hint = getattr(message, field.name), hints[field.name]
        origin = get_origin(hint)
        if origin is tuple:
            value = tuple(value)
        elif origin is not None:
            value = {key: _entry(get_args(hint)[1], entry) for key, entry in value.items()}
        values[field.name] = value
    _check_lengths(kind, values)
    return kind.record(**values)


def _entry(hint: Any, entry: Any) -> Any:
    """Value of an entry of a map."""
    if hint is str:
        return entry
    return _report(entry) if hint == ControllerReport else tuple(entry.values)


def _report(text: str) -> ControllerReport:
    """Report of a control law, from JSON.

    Raises:
        ValueError: The text is not such a report.
    """
    try:
        found = json.loads(text)
    except RecursionError as error:
        raise ValueError("a report is nested too deeply") from error
    if not isinstance(found, dict) or not all(map(_is_reportable, found.values())):
        raise ValueError("a report has other values than finite numbers and texts")
    return found


def _is_reportable(value: Any) -> bool:
    return isinstance(value, int | str) or (isinstance(value, float) and math.isfinite(value))


def _check_lengths(kind: RecordKind, values: Mapping[str, Any]) -> None:
    """Check the lengths of vectors, which a schema does not contain."""
    for place, length in kind.lengths.items():
        name, _, key = place.partition(".")
        found = values[name].get(key, ()) if key else values[name]
        if len(found) != length:
            raise ValueError(f"{place} of {kind.name} has {len(found)} values, not {length}")
