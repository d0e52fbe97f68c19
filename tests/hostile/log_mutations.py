"""Mutations of logs: records changed, dropped, doubled and swapped in a file whose checksums all hold, and damaged bytes."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from random import Random
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from zstandard import ZstdError

from tests.hostile.mjcf_mutations import mutate_model, xml
from tests.hostile.values import YAML_NUMBERS, words
from tests.hostile.yaml_mutations import mutate_bytes, value

_NAMES = (
    "",
    *words("scenario.yaml mjcf/robot/robot.xml ../../x /x mjcf/../../x mjcf mjcf/robot"),
    *("é", "a\nb", "n" * 300, "\0"),
)
_DOUBLES = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, -0.0, 0.0, 1e10, -1.0)
_GARBAGE = (
    *(b"", b"\xff\xfe", b"{", b"[]", b"3", b"null", b"robot: 3", b"robot: {mjcf: x}", b"!!bool maybe", b"&a [*a]"),
    b"[" * 3000,
)
_Records = list[Any]


def records(data: bytes) -> _Records:
    """Records of a log that carry what a reader uses, those that its summary repeats once."""
    found, seen = [], set()
    for record in StreamReader(BytesIO(data)).records:
        again = isinstance(record, Schema | Channel) and (type(record), record.id) in seen
        if isinstance(record, Schema | Channel | Message | Attachment | Metadata) and not again:
            found.append(record)
        if isinstance(record, Schema | Channel):
            seen.add((type(record), record.id))
    return found


def log(found: _Records) -> bytes:
    """A log of these records, with checksums that hold."""
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start()
    schemas, channels = {0: 0}, {}
    for record in found:
        if isinstance(record, Schema):
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            schema = schemas.get(record.schema_id, 0)
            channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
        elif isinstance(record, Message) and record.channel_id in channels:
            writer.add_message(channels[record.channel_id], record.log_time, record.data, record.publish_time)
        elif isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    writer.finish()
    return stream.getvalue()


def mutate_log(rng: Random, data: bytes) -> bytes:
    """A log with one to four mutations."""
    if rng.random() < 0.3:
        return mutate_bytes(rng, data)
    try:
        found = records(data)
    except (McapError, ValueError, ZstdError, struct.error):  # an earlier mutation has damaged its bytes
        return mutate_bytes(rng, data)
    for _ in range(rng.choice((1, 1, 2, 3, 4))):
        rng.choice(_MUTATIONS)(rng, found)
    return log(found)


def _of(rng: Random, found: _Records, kind: type) -> int | None:
    """Position of a record of a kind; rare kinds of messages as likely as samples."""
    places: dict[int, list[int]] = {}
    for i, record in enumerate(found):
        if isinstance(record, kind):
            places.setdefault(record.channel_id if isinstance(record, Message) else 0, []).append(i)
    return rng.choice(places[rng.choice(sorted(places))]) if places else None


def _drop(rng: Random, found: _Records) -> None:
    i = _of(rng, found, rng.choice((Schema, Channel, Message, Message, Attachment, Metadata)))
    if i is not None:
        del found[i : i + (rng.choice((1, 1, 30)) if isinstance(found[i], Message) else 1)]


def _drop_kind(rng: Random, found: _Records) -> None:
    kind = rng.choice((Schema, Message, Attachment, Metadata))
    found[:] = [record for record in found if not isinstance(record, kind)]


def _double(rng: Random, found: _Records) -> None:
    i = _of(rng, found, rng.choice((Channel, Message, Message, Attachment, Metadata)))
    if i is not None:
        found.insert(rng.randrange(i, len(found)), found[i])


def _message(rng: Random, found: _Records) -> None:
    i = _of(rng, found, Message)
    if i is None:
        return
    data = bytearray(found[i].data)
    kind = rng.randrange(4)
    if kind == 0 and len(data) > 10:
        at = rng.randrange(2, len(data) - 8)
        data[at : at + 8] = struct.pack("<d", rng.choice(_DOUBLES))
    elif kind == 1:
        data = data[: rng.randrange(len(data) + 1)]
    elif kind == 2 and data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    else:
        data += rng.choice((b"\0", b"\xff" * 20, bytes(data)))
    found[i] = replace(found[i], data=bytes(data))


def _values(rng: Random, found: _Records) -> None:
    """One value of a sample: a double behind its tag byte (protobuf's fixed64)."""
    samples = [i for i, r in enumerate(found) if isinstance(r, Message) and len(r.data) > 500]
    for i in rng.sample(samples, min(len(samples), rng.choice((1, 1, 5)))):
        data = bytearray(found[i].data)
        tags = [k for k in range(len(data) - 9) if data[k] == 0x09]
        if tags:
            at = rng.choice(tags) + 1
            data[at : at + 8] = struct.pack("<d", rng.choice(_DOUBLES))
            found[i] = replace(found[i], data=bytes(data))


def values_of(rng: Random, found: _Records, *topics: str) -> None:
    """A double, a byte or the end of a message of one of some topics, or the message itself is gone, or there twice."""
    channels = {record.id: record.topic for record in found if isinstance(record, Channel)}
    topic = rng.choice(topics)
    places = [i for i, r in enumerate(found) if isinstance(r, Message) and channels.get(r.channel_id) == topic]
    if not places:
        return
    i, kind = rng.choice(places), rng.randrange(6)
    data = bytearray(found[i].data)
    if kind < 3 and len(data) > 10:
        at = rng.randrange(1, len(data) - 8)
        data[at : at + 8] = struct.pack("<d", rng.choice(_DOUBLES))
        found[i] = replace(found[i], data=bytes(data))
    elif kind == 3:
        found[i] = replace(found[i], data=bytes(data[: rng.randrange(len(data) + 1)]))
    elif kind == 4:
        del found[i]
    else:
        found.insert(rng.choice(places), found[i])


def _swap(rng: Random, found: _Records) -> None:
    a, b = (_of(rng, found, Message) for _ in range(2))
    if a is not None and b is not None:
        found[a], found[b] = found[b], found[a]


def _facts(rng: Random, found: _Records) -> None:
    """Texts that the log keeps of the run: removed, or something else."""
    i = _of(rng, found, rng.choice((Channel, Metadata)))
    if i is None or not found[i].metadata:
        return
    facts = dict(found[i].metadata)
    name = rng.choice(sorted(facts))
    if rng.random() < 0.4:
        del facts[name]
    else:
        facts[name] = rng.choice(("", "x", "nan", "1e999", "x y z w", "-1", "\ufffd", "a | b | c", *YAML_NUMBERS[:12]))
    found[i] = replace(found[i], metadata=facts)


def _attachment(rng: Random, found: _Records) -> None:
    i = _of(rng, found, Attachment)
    if i is None:
        return
    old = found[i]
    kind = rng.randrange(4)
    if kind == 0:
        found[i] = replace(old, name=rng.choice(_NAMES))
    elif kind == 1:
        found[i] = replace(old, data=rng.choice((*_GARBAGE, value(rng).encode("utf-8", "surrogatepass"))))
    elif kind == 2:
        found[i] = replace(old, data=mutate_bytes(rng, old.data))
    elif old.name.endswith(".xml"):
        with suppress(ET.ParseError):  # one that was mutated before
            root = ET.fromstring(old.data)
            mutate_model(rng, root)
            found[i] = replace(old, data=xml(root))
    else:
        lines = old.data.split(b"\n")
        del lines[rng.randrange(len(lines))]
        found[i] = replace(old, data=b"\n".join(lines))


def _schema(rng: Random, found: _Records) -> None:
    i = _of(rng, found, Schema)
    if i is not None:
        found[i] = replace(found[i], data=mutate_bytes(rng, found[i].data))


def _channel(rng: Random, found: _Records) -> None:
    i = _of(rng, found, Channel)
    if i is not None:
        others = [r for r in found if isinstance(r, Channel)]
        change = rng.choice(
            ({"topic": rng.choice(others).topic}, {"schema_id": rng.choice(others).schema_id}, {"topic": "/x"})
        )
        found[i] = replace(found[i], **change)


_MUTATIONS: tuple[Callable[[Random, _Records], None], ...] = (
    *(_drop, _drop, _drop_kind, _double, _message, _values, _values, _swap, _facts, _facts, _attachment),
    *(_attachment, _schema, _channel),
)
