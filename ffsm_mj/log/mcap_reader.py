"""Reads ``run.mcap`` and ``run.mcap.partial``, whole, broken off or damaged, in one pass from the front."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Attachment, Channel, Message, Metadata, Schema

from ffsm_mj.errors import LogError
from ffsm_mj.events import Event, ImpactRecord, OutcomeRecord
from ffsm_mj.log import mcap_format as form
from ffsm_mj.log.attachments import fault_of_names
from ffsm_mj.log.memory_sink import RunLog, run_log
from ffsm_mj.log.salvage import MAGIC, Salvage
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.log.sink import RunHeader
from ffsm_mj.model import FloatArray

_RECORD_TYPES = {topic: record_type for record_type, topic in form.RECORD_TOPICS.items()}


def read_log(path: Path) -> RunLog:
    """Read a run from its MCAP file.

    A file that breaks off gives what comes before, with ``outcome`` None; a damaged one everything that its checksums vouch
    for, and a sentence in ``damage``.

    Raises:
        LogError: No such file, not an MCAP file, not one of a run of ffsm-mj, or nothing of it can be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(path, f"cannot be read ({error.strerror})") from error
    if not data.startswith(MAGIC):
        raise LogError(path, "not an MCAP file")
    salvage, found = Salvage(data), _Contents()
    for record in salvage.records():
        found.take(record)
    return found.run_log(path, salvage, len(data))


@dataclass
class _Contents:
    """What has been read so far."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    messages: dict[int, list[bytes]] = field(default_factory=dict)

    def take(self, record: Any) -> None:
        """Sort a record of the file by what it is."""
        if isinstance(record, Message):
            self.messages.setdefault(record.channel_id, []).append(record.data)
        elif isinstance(record, Schema):
            self.schemas.setdefault(record.id, record.data)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record.data

    def run_log(self, path: Path, salvage: Salvage, size: int) -> RunLog:
        """Everything together.

        Raises:
            LogError: It does not make a run.
        """
        channels = {channel.topic: channel for channel in self.channels.values()}
        channel = channels.get(form.SAMPLE_TOPIC)
        if channel is None or channel.schema_id not in self.schemas:
            if form.FACTS_METADATA in self.metadata:
                raise LogError(path, "the log breaks off, or is damaged, before its first sample")
            raise LogError(path, "not a log of ffsm-mj, or it breaks off before it begins")
        try:
            layout = form.layout_of_schema(self.schemas[channel.schema_id], self.metadata.get(form.SIGNALS_METADATA, {}))
            samples = self.messages.get(channel.id, [])
            rows = form.SampleCodec(layout).decode(samples) if samples else np.empty((0, len(layout.signals)))
            records = [
                form.decode_record(_RECORD_TYPES[topic], data)
                for topic, event_channel in channels.items()
                if topic in _RECORD_TYPES
                for data in self.messages.get(event_channel.id, [])
            ]
        except (ValueError, LookupError, TypeError, DecodeError) as error:
            raise LogError(path, f"not of this version's format ({error})") from error
        outcome = next((record for record in records if isinstance(record, OutcomeRecord)), None)
        events: list[Event] = [record for record in records if not isinstance(record, OutcomeRecord)]
        if fault := fault_of_names(self.attachments):
            raise LogError(path, fault)
        files = dict(self.attachments)
        scenario = files.pop(form.SCENARIO_ATTACHMENT, b"").decode()
        header = RunHeader(channel.metadata.get("scenario", ""), scenario, layout, files, channel.metadata)
        impacts = (event.time_s for event in events if isinstance(event, ImpactRecord))
        gaps = _gaps(channel.metadata, rows, impacts, outcome.end_s if outcome is not None else None)
        damage = _damage(salvage, size, gaps, ended=outcome is not None)
        return run_log(header, rows, events, outcome, damage)


def _gaps(facts: Mapping[str, str], rows: FloatArray, impacts: Iterable[float], end_s: float | None) -> str:
    """Where samples do not follow each other by the control period; nothing where the log does not tell it."""
    try:
        sampling = Sampling(float(facts.get("control_period_s", "")), impacts)
    except ValueError:
        return ""
    sampling.ticks(rows[:, 0])
    sampling.end(end_s)
    return sampling.sentence()


def _damage(salvage: Salvage, size: int, gaps: str, *, ended: bool) -> str:
    """What is wrong with a file, beyond that it may break off; empty where nothing is."""
    lost = f"{salvage.lost_bytes} of {size} bytes cannot be read" if salvage.lost_bytes else ""
    if lost or gaps:
        return "; ".join(part for part in (lost, gaps) if part)
    if not salvage.data_match:
        return "a checksum does not hold: all samples were read, but descriptions and units may be wrong"
    if ended and not salvage.index_match:
        return "its index is missing or damaged; all data were read"
    return ""
