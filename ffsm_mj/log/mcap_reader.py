"""Reads ``run.mcap`` and ``run.mcap.partial``, whole or broken off, in one pass from the front."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from ffsm_mj.errors import LogError
from ffsm_mj.events import Event, OutcomeRecord
from ffsm_mj.log import mcap_format as form
from ffsm_mj.log.memory_sink import RunLog, run_log
from ffsm_mj.log.sink import RunHeader

_RECORD_TYPES = {topic: record_type for record_type, topic in form.RECORD_TOPICS.items()}
_BROKEN = (McapError, ZstdError, EOFError, struct.error, zlib.error, ValueError, DecodeError, RuntimeError, OSError)


def read_log(path: Path) -> RunLog:
    """Read a run from its MCAP file.

    A file that breaks off gives what comes before; its ``outcome`` is None.

    Raises:
        LogError: No such file, not an MCAP file, or not one of a run of ffsm-mj.
    """
    if not path.is_file():
        raise LogError(path, "no such log")
    found = _Contents()
    for record in _records(path):
        found.take(record)
    return found.run_log(path)


@dataclass
class _Contents:
    """What has been read so far."""

    topics: dict[int, str] = field(default_factory=dict)
    schemas: dict[int, bytes] = field(default_factory=dict)
    sample_schema: bytes | None = None
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    samples: list[bytes] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outcome: OutcomeRecord | None = None

    def take(self, record: Any) -> None:
        """Sort a record of the file by what it is."""
        if isinstance(record, Message):
            self._message(self.topics.get(record.channel_id, ""), record.data)
        elif isinstance(record, Schema):
            self.schemas[record.id] = record.data
        elif isinstance(record, Channel):
            self.topics[record.id] = record.topic
            if record.topic == form.SAMPLE_TOPIC:
                self.sample_schema = self.schemas.get(record.schema_id)
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record.data

    def _message(self, topic: str, data: bytes) -> None:
        if topic == form.SAMPLE_TOPIC:
            self.samples.append(data)
        elif topic in _RECORD_TYPES:
            record = form.decode_record(_RECORD_TYPES[topic], data)
            if isinstance(record, OutcomeRecord):
                self.outcome = record
            else:
                self.events.append(record)

    def run_log(self, path: Path) -> RunLog:
        """Everything together.

        Raises:
            LogError: It does not make a run.
        """
        facts = self.metadata.get(form.FACTS_METADATA)
        if facts is None:
            raise LogError(path, "not a log of ffsm-mj, or it breaks off before it begins")
        if self.sample_schema is None:
            raise LogError(path, "the log breaks off, or is damaged, before its first sample")
        layout = form.layout_of_schema(self.sample_schema, self.metadata.get(form.SIGNALS_METADATA, {}))
        try:
            rows = form.SampleCodec(layout).decode(self.samples) if self.samples else np.empty((0, len(layout.signals)))
        except ValueError as error:
            raise LogError(path, str(error)) from error
        files = dict(self.attachments)
        scenario = files.pop(form.SCENARIO_ATTACHMENT, b"").decode()
        header = RunHeader(facts.get("scenario", ""), scenario, layout, files, facts)
        return run_log(header, rows, self.events, self.outcome)


def _records(path: Path) -> Iterator[Any]:
    """Records up to the first that cannot be read.

    Raises:
        LogError: Not an MCAP file at all.
    """
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89MCAP0\r\n":
            raise LogError(path, "not an MCAP file")
        stream.seek(0)
        reader = StreamReader(stream, validate_crcs=True, record_size_limit=path.stat().st_size)
        try:
            yield from reader.records
        except _BROKEN:
            return
