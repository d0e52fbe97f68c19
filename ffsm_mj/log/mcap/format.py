"""Format of ``run.mcap`` for writer and reader: names, attachments, and the protobuf encoding of samples and event records.

``/ffsm/sample`` nests one message per signal group. Every field is a double and always present, so a message is a constant
template with float64 values at fixed offsets, and numpy encodes a block of rows at once. The schema of a kind of event
records is derived from its dataclass.
"""

from __future__ import annotations

import json
import math
import posixpath
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from itertools import takewhile
from typing import Any, get_args, get_origin

import numpy as np
import numpy.typing as npt
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log import limits
from ffsm_mj.records.kinds import RecordKind, kind_of
from ffsm_mj.records.record import ControllerReport, hints_of, lengths_of
from ffsm_mj.records.signals import GROUPS, TIME, Layout, Signal

SAMPLE_TOPIC = "/ffsm/sample"
SAMPLE_SCHEMA = "ffsm.Sample"
STATE_TOPIC, STATE_ENCODING = "/ffsm/state", "ffsm-state"
"""States of the simulation, without a schema: JSON after a line with the version; see :mod:`ffsm_mj.state`."""
SIGNALS_METADATA = "ffsm.signals"
RUN_METADATA = "ffsm.run"
SCENARIO_ATTACHMENT = "scenario.yaml"
RECORD_HEAD = struct.Struct("<BQ")
"""Head of a record of MCAP: opcode, and length of what follows."""
MESSAGE_HEAD = np.dtype(
    {
        "names": ["opcode", "length", "channel", "sequence", "log_time", "publish_time"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8", "<u8"],
    }
)
"""Head of a record with a message."""

_Field = descriptor_pb2.FieldDescriptorProto


def sample_schema(layout: Layout) -> bytes:
    """FileDescriptorSet of the sample message of one run."""
    file = descriptor_pb2.FileDescriptorProto(name="ffsm/sample.proto", package="ffsm", syntax="proto3")
    sample = descriptor_pb2.DescriptorProto(name="Sample")
    for number, group in enumerate(_groups(layout), start=1):
        message = file.message_type.add(name=group.capitalize())
        for i, signal in enumerate(_members(layout, group), start=1):
            # Protobuf's default JSON name is the same for j1 and j_1, and its readers refuse such a schema.
            _add(message, signal.name, i, _Field.TYPE_DOUBLE, json_name=signal.name)
        _add(sample, group, number, _Field.TYPE_MESSAGE, type_name=f".ffsm.{group.capitalize()}")
    file.message_type.append(sample)
    return bytes(descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString())


def _add(message: Any, name: str, number: int, kind: Any, *, repeated: bool = False, **more: str) -> None:
    """Add a field to a message."""
    label = _Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL
    message.field.add(name=name, number=number, type=kind, label=label, **more)


def signals_metadata(layout: Layout) -> dict[str, str]:
    """Text ``unit | description`` of each column, by key."""
    return {signal.key: f"{signal.unit} | {signal.description}" for signal in layout.signals}


def layout_of_schema(schema: bytes, units: Mapping[str, str]) -> Layout:
    """Columns of the sample messages in a file, from their schema.

    Args:
        schema: FileDescriptorSet in the file.
        units: Text ``unit | description`` by key, from the metadata of the file.

    Raises:
        ValueError: The schema is too large, has two fields of one name, or has no time.
    """
    if len(schema) > limits.SCHEMA_BYTES:
        raise ValueError(f"a schema of {len(schema)} bytes")
    file = descriptor_pb2.FileDescriptorSet.FromString(schema).file[0]
    messages = {message.name: message for message in file.message_type}
    signals = []
    for group in messages["Sample"].field:
        for field in messages[group.type_name.rsplit(".", 1)[-1]].field:
            unit, _, description = units.get(f"{group.name}.{field.name}", " | ").partition(" | ")
            signals.append(Signal(group.name, field.name, unit, description))
    layout = Layout(tuple(signals))
    if TIME not in layout.index or len(layout.index) < len(signals):
        raise ValueError("its samples have no time, or two fields of the same name")
    return layout


class SampleCodec:
    """Encodes and decodes rows block by block."""

    def __init__(self, layout: Layout) -> None:
        """Compute the template of a message and the offsets of its values."""
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
        values = np.array(offsets, dtype=np.intp)[:, None] + np.arange(8)
        self._fixed = np.setdiff1d(np.arange(len(template)), values)

    @property
    def message_size(self) -> int:
        """Size of one message in bytes."""
        return len(self._template)

    def encode(self, rows: FloatArray) -> npt.NDArray[np.uint8]:
        """One protobuf message per row, (n, bytes of one)."""
        out = np.tile(self._template, (len(rows), 1))
        record = out.view(self._record)[:, 0]
        for name, column in zip(self._record.names or (), rows.T, strict=True):
            record[name] = column
        return out

    def decode(self, messages: npt.NDArray[np.uint8], columns: Sequence[int] | None = None) -> FloatArray:
        """Decode messages, (n, bytes of one), to rows with all or some columns.

        Raises:
            ValueError: A message does not have the layout of its schema.
        """
        if messages.shape[1] != self.message_size:
            raise ValueError("the size of a sample does not follow from its schema")
        if (messages[:, self._fixed] != self._template[self._fixed]).any():
            raise ValueError("the fields of a sample are not those of its schema")
        record, names = messages.view(self._record)[:, 0], self._record.names or ()
        chosen = names if columns is None else [names[column] for column in columns]
        values = np.empty((len(messages), len(chosen)))
        for i, name in enumerate(chosen):
            values[:, i] = record[name]
        return values


def _groups(layout: Layout) -> list[str]:
    present = {signal.group for signal in layout.signals}
    return [group for group in GROUPS if group in present]


def _members(layout: Layout, group: str) -> list[Signal]:
    return [signal for signal in layout.signals if signal.group == group]


def nanoseconds(time_s: float) -> int:
    """Simulation time in integer ns, as ``log_time`` of MCAP."""
    return round(time_s * 1e9)


def varint(value: int) -> bytes:
    """A non-negative integer as a protobuf varint."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def fault_of_names(names: Iterable[str]) -> str:
    """Fault of the names of attachments as text; empty if there is none.

    A log may be of unknown origin. Only plain relative paths are accepted, whatever they are used for.
    """
    known = list(names)
    if len(known) > limits.ATTACHMENTS:
        return f"{len(known)} attachments; at most {limits.ATTACHMENTS} are read"
    bad = next((name for name in known if not is_plain(name)), None)
    if bad is None:
        return ""
    shown = bad if len(bad) <= 80 else f"{bad[:80]}..."
    allowed = f"forward slashes, no '..', at most {limits.NAME_CHARACTERS} characters"
    return f"the attachment {shown!r} is not a plain relative path ({allowed})"


def is_plain(name: str) -> bool:
    """Whether a name is a relative path that stays below its folder on any system."""
    return (
        0 < len(name) <= limits.NAME_CHARACTERS
        and name.isprintable()
        and not any(character in name for character in ":\\")
        and not name.startswith("/")
        and posixpath.normpath(name) == name
        and name.split("/", maxsplit=1)[0] not in (".", "..")
    )


_SCALARS = {float: _Field.TYPE_DOUBLE, int: _Field.TYPE_INT64, str: _Field.TYPE_STRING}


def record_schema(kind: RecordKind, without: int = 0) -> bytes:
    """FileDescriptorSet of a kind of record, derived from its dataclass; the last ``without`` fields are left out."""
    name, hints = kind.record.__name__.lower(), hints_of(kind.record)
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
        _add(message, name, number, scalar)
        return
    kind, parts = get_origin(hint), get_args(hint)
    if kind is tuple:
        _add(message, name, number, _SCALARS[parts[0]], repeated=True)
        return
    entry_name = "".join(part.capitalize() for part in name.split("_")) + "Entry"
    entry = message.nested_type.add(name=entry_name)
    entry.options.map_entry = True
    _add(entry, "key", 1, _Field.TYPE_STRING)
    path = f".ffsm.{message.name}"
    if parts[1] in (str, ControllerReport):
        _add(entry, "value", 2, _Field.TYPE_STRING)
    else:
        if not any(nested.name == "Values" for nested in message.nested_type):
            _add(message.nested_type.add(name="Values"), "values", 1, _Field.TYPE_DOUBLE, repeated=True)
        _add(entry, "value", 2, _Field.TYPE_MESSAGE, type_name=f"{path}.Values")
    _add(message, name, number, _Field.TYPE_MESSAGE, repeated=True, type_name=f"{path}.{entry_name}")


@cache
def _message_class(kind: RecordKind) -> Any:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(record_schema(kind)).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(kind.schema))


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
    hints = hints_of(kind.record)
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
        content = json.loads(text)
    except RecursionError as error:
        raise ValueError("a report is nested too deeply") from error
    if not isinstance(content, dict) or not all(map(_is_reportable, content.values())):
        raise ValueError("a report has other values than finite numbers and texts")
    return content


def _is_reportable(value: Any) -> bool:
    return isinstance(value, int | str) or (isinstance(value, float) and math.isfinite(value))


def _check_lengths(kind: RecordKind, values: Mapping[str, Any]) -> None:
    """Check the lengths of vectors, which a schema does not contain."""
    for place, length in lengths_of(kind.record).items():
        name, _, key = place.partition(".")
        value = values[name].get(key, ()) if key else values[name]
        if len(value) != length:
            raise ValueError(f"{place} of {kind.name} has {len(value)} values, not {length}")
