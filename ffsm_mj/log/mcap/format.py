"""Format of ``run.mcap`` for writer and reader: names, attachments, and the protobuf encoding of samples.

``/ffsm/sample`` nests one message per signal group. Every field is a double and always present, so a message is a constant
template with float64 values at fixed offsets, and numpy encodes a block of rows at once.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from google.protobuf import descriptor_pb2

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import GROUPS, TIME, Layout, Signal

SAMPLE_TOPIC = "/ffsm/sample"
SAMPLE_SCHEMA = "ffsm.Sample"
STATE_TOPIC, STATE_ENCODING = "/ffsm/state", "ffsm-state"
"""States of the simulation, without a schema: JSON after a line with the version; see :mod:`ffsm_mj.state`."""
SIGNALS_METADATA = "ffsm.signals"
RUN_METADATA = "ffsm.run"
SCENARIO_ATTACHMENT = "scenario.yaml"

_MOST_ATTACHMENTS, _MOST_NAME_CHARACTERS = 10_000, 512
_MOST_SCHEMA_BYTES = 1 << 22
"""Greatest size of the schema of a sample; a column takes about 60 bytes."""
_Field = descriptor_pb2.FieldDescriptorProto


def sample_schema(layout: Layout) -> bytes:
    """FileDescriptorSet of the sample message of one run."""
    file = descriptor_pb2.FileDescriptorProto(name="ffsm/sample.proto", package="ffsm", syntax="proto3")
    sample = descriptor_pb2.DescriptorProto(name="Sample")
    for number, group in enumerate(_groups(layout), start=1):
        message = file.message_type.add(name=group.capitalize())
        for i, signal in enumerate(_members(layout, group), start=1):
            # Protobuf's default JSON name is the same for j1 and j_1, and its readers refuse such a schema.
            message.field.add(
                name=signal.name,
                json_name=signal.name,
                number=i,
                type=_Field.TYPE_DOUBLE,
                label=_Field.LABEL_OPTIONAL,
            )
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
    if len(schema) > _MOST_SCHEMA_BYTES:
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
        self._positions = np.array(offsets, dtype=np.intp)[:, None] + np.arange(8)
        self._fixed = np.setdiff1d(np.arange(len(template)), self._positions)

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
        positions = self._positions if columns is None else self._positions[list(columns)]
        values: npt.NDArray[np.uint8] = np.ascontiguousarray(messages[:, positions.ravel()])
        return values.view("<f8").astype(np.float64)


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
    if len(known) > _MOST_ATTACHMENTS:
        return f"{len(known)} attachments; at most {_MOST_ATTACHMENTS} are read"
    bad = next((name for name in known if not is_plain(name)), None)
    if bad is None:
        return ""
    shown = bad if len(bad) <= 80 else f"{bad[:80]}..."
    allowed = f"forward slashes, no '..', at most {_MOST_NAME_CHARACTERS} characters"
    return f"the attachment {shown!r} is not a plain relative path ({allowed})"


def is_plain(name: str) -> bool:
    """Whether a name is a relative path that stays below its folder on any system."""
    return (
        0 < len(name) <= _MOST_NAME_CHARACTERS
        and name.isprintable()
        and not any(character in name for character in ":\\")
        and not name.startswith("/")
        and posixpath.normpath(name) == name
        and name.split("/", maxsplit=1)[0] not in (".", "..")
    )
