"""Reader of ``run.mcap`` and ``run.mcap.partial``, complete, incomplete or damaged, in one pass."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Attachment, Channel, Metadata, Schema

from ffsm_mj.contact_models.registry import contact_models
from ffsm_mj.errors import LogError, one_line
from ffsm_mj.log.mcap import format as form
from ffsm_mj.log.mcap.chunks import MESSAGE_HEAD, Batch, content_of
from ffsm_mj.log.mcap.file_bytes import FileBytes
from ffsm_mj.log.mcap.format import fault_of_names
from ffsm_mj.log.mcap.record_format import decode_record, is_schema_of
from ffsm_mj.log.mcap.salvage import MAGIC, Salvage
from ffsm_mj.log.mcap.stored_rows import StoredRows
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.kinds import RecordKind, kind_of, kinds
from ffsm_mj.records.metadata import fault_of_metadata, fault_of_version, logged_start_s
from ffsm_mj.records.run_log import RunLog, run_log
from ffsm_mj.records.signals import TIME, Layout

_MOST_PARTS = 1_000_000
_MOST_EVENTS = 200_000
_MOST_ATTACHED_BYTES = 1 << 30
_MOST_TOPICS, _LONGEST_TOPIC = 3, 60
_OWN = (form.SAMPLE_TOPIC, form.STATE_TOPIC)
"""Topics of every version that are no kinds of records."""


def read_log(path: Path) -> RunLog:
    """Read a run from its MCAP file; rows of a long run are read on demand.

    Of an incomplete file everything up to its end is read, and ``outcome`` is None. Of a damaged file everything with valid
    checksums is read, and ``damage`` describes the rest.

    Raises:
        LogError: There is no such file, it is not an MCAP file or not a log of ffsm-mj, or nothing in it is readable.
    """
    with _opened(path) as data:
        salvage = Salvage(data)
        found = _contents(path, salvage)
        return found.run_log(path, salvage, data)


def stored_rows(path: Path, layout: Layout) -> StoredRows:
    """Rows of a log that was just written; the file is searched for them on first use."""

    def find() -> Sequence[Batch]:
        with _opened(path) as data:
            return _contents(path, Salvage(data)).samples

    return StoredRows(path, layout, find)


def stored_states(path: Path) -> list[bytes]:
    """States of the simulation in a log, in order of time; see :func:`ffsm_mj.state.from_bytes`.

    Raises:
        LogError: See :func:`read_log`.
    """
    with _opened(path) as data:
        found = _contents(path, Salvage(data))
        channels = [each for each in found.channels.values() if each.topic == form.STATE_TOPIC]
        return [message for channel in channels for message in found.messages(channel, data)]


@contextmanager
def _opened(path: Path) -> Iterator[FileBytes]:
    try:
        with FileBytes(path) as data:
            if data.take(0, len(MAGIC)) != MAGIC:
                raise LogError(path, "not an MCAP file")
            yield data
    except OSError as error:
        raise LogError(path, f"cannot be read ({error.strerror})") from error


def _contents(path: Path, salvage: Salvage) -> _Contents:
    found = _Contents(path)
    for record in salvage.records():
        found.take(record)
    return found


@dataclass
class _Contents:
    """Content read so far, within limits far above those of any run."""

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    batches: dict[int, list[Batch]] = field(default_factory=dict)

    parts: int = 0
    attached: int = 0

    def take(self, record: Any) -> None:
        """Store a record of the file by its type.

        Raises:
            LogError: There are too many records.
        """
        self.parts += 1
        if self.parts > _MOST_PARTS:
            raise LogError(self.path, f"more than {_MOST_PARTS} different records, too many for a run")
        if isinstance(record, Batch):
            self.batches.setdefault(record.channel, []).append(record)
        elif isinstance(record, Schema):
            self.schemas.setdefault(record.id, record.data)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            self.attached += len(record.data)
            if self.attached > _MOST_ATTACHED_BYTES:
                raise LogError(self.path, f"more than {_MOST_ATTACHED_BYTES >> 30} GiB of attachments")
            self.attachments[record.name] = record.data

    @property
    def samples(self) -> list[Batch]:
        """Positions of the samples."""
        number = next((channel.id for channel in self.channels.values() if channel.topic == form.SAMPLE_TOPIC), 0)
        return self.batches.get(number, [])

    def messages(self, channel: Channel, data: FileBytes) -> Iterator[bytes]:
        """Messages of a channel, in order."""
        found = self.batches.get(channel.id, [])
        if sum(batch.count for batch in found) > _MOST_EVENTS:
            raise LogError(self.path, f"more than {_MOST_EVENTS} events on {channel.topic}, too many for a run")
        for chunk, batches in groupby(found, key=lambda batch: batch.chunk):
            content = content_of(data.take(*chunk))
            for batch in batches:
                for message in batch.messages(content):
                    yield message.tobytes()

    def _holds(self, kind: RecordKind, channel: Channel) -> bool:
        """Whether a channel has the schema of a kind of record.

        Raises:
            ValueError: It does not, but every run has records of this kind.
        """
        schema = self.schemas.get(channel.schema_id)
        same = schema is None or is_schema_of(kind, schema)
        if kind.in_every_run and not same:
            raise ValueError(f"{kind.topic} has another schema")
        return same

    def run_log(self, path: Path, salvage: Salvage, data: FileBytes) -> RunLog:
        """Assemble the log of a run.

        Raises:
            LogError: The content is not that of a run.
        """
        channels = {channel.topic: channel for channel in self.channels.values()}
        channel = channels.get(form.SAMPLE_TOPIC)
        if channel is None or channel.schema_id not in self.schemas:
            if form.RUN_METADATA in self.metadata:
                raise LogError(path, "the log ends, or is damaged, before its first sample")
            raise LogError(path, "not a log of ffsm-mj, or it ends before its header")
        if fault := fault_of_version(channel.metadata):
            raise LogError(path, fault)
        try:
            layout = form.layout_of_schema(self.schemas[channel.schema_id], self.metadata.get(form.SIGNALS_METADATA, {}))
            size = MESSAGE_HEAD + form.SampleCodec(layout).message_size
            if any(batch.size != size for batch in self.samples):
                raise ValueError("the size of a sample does not follow from its schema")
            # Sizes are verified for all samples now; a long log is decoded only when its rows are used.
            stored = StoredRows(path, layout, self.samples)
            rows = stored.copy() if stored.small else stored
            _load_plugins(channels)
            known = [kind for kind in kinds() if kind.topic in channels and self._holds(kind, channels[kind.topic])]
            records = [
                decode_record(kind, message) for kind in known for message in self.messages(channels[kind.topic], data)
            ]
            _refuse_odd_times(records)
        except (ValueError, LookupError, TypeError, DecodeError) as error:
            raise LogError(path, f"not of this version's format ({error})") from error
        outcome = next((record for record in records if isinstance(record, OutcomeRecord)), None)
        events: list[Event] = [record for record in records if not isinstance(record, OutcomeRecord)]
        if fault := fault_of_names(self.attachments) or fault_of_metadata(channel.metadata):
            raise LogError(path, fault)
        files = dict(self.attachments)
        scenario = _text(path, form.SCENARIO_ATTACHMENT, files.pop(form.SCENARIO_ATTACHMENT, b""))
        by_topic = {kind.topic: kind.name for kind in known if not kind.in_every_run}
        declared = tuple(by_topic[topic] for topic in channels if topic in by_topic)  # in the order of the run
        header = RunHeader(channel.metadata.get("scenario", ""), scenario, layout, files, channel.metadata, declared)
        log = run_log(header, rows, events, outcome)
        log = replace(log, lost=self._lost(salvage))
        log = replace(log, records=log.whole_events()) if log.lost else log
        damage = _damage(salvage, len(data), _gaps(log), ended=outcome is not None)
        return replace(log, damage=damage, note=_note(channels, known))

    def _lost(self, salvage: Salvage) -> tuple[tuple[float, float], ...]:
        """Times between which a part of the file is lost; see :class:`ffsm_mj.records.run_log.RunLog`."""
        ours = {channel.id for channel in self.channels.values() if channel.topic.startswith("/ffsm/")}
        batches = [batch for number in ours for batch in self.batches.get(number, [])]
        batches.sort(key=lambda batch: batch.chunk)
        times = np.array([batch.times_ns for batch in batches], dtype=np.float64).reshape(-1, 2)
        before = np.maximum.accumulate(np.append(-np.inf, times[:, 1]))
        after = np.minimum.accumulate(np.append(times[:, 0], np.inf)[::-1])[::-1]
        places = np.searchsorted([batch.chunk[0] for batch in batches], salvage.holes)
        # Half a nanosecond: times of messages are rounded to whole ones.
        found = zip((before[places] * 1e-9 - 5e-10).tolist(), (after[places] * 1e-9 + 5e-10).tolist(), strict=True)
        lost = tuple(dict.fromkeys(found)) if salvage.holes else ()
        return lost if lost or salvage.data_match else ((-math.inf, -math.inf),)


def _refuse_odd_times(records: Sequence[Event | OutcomeRecord]) -> None:
    """Refuse records with times that are not finite.

    Raises:
        ValueError: There is one.
    """
    for record in records:
        time_s = record.end_s if isinstance(record, OutcomeRecord) else kind_of(record).time(record)
        if not math.isfinite(time_s):
            raise ValueError(f"the time of a record of {type(record).__name__} is {time_s}")


def _load_plugins(topics: Iterable[str]) -> None:
    """Register the kinds of records of installed packages, if the log has unknown topics of ffsm-mj."""
    if any(topic.startswith("/ffsm/") for topic in set(topics) - {*_OWN, *(kind.topic for kind in kinds())}):
        contact_models()


def _note(topics: Iterable[str], known: Sequence[RecordKind]) -> str:
    """Text that lists the topics of ffsm-mj that are not read; empty if all are."""
    read = {*_OWN, *(kind.topic for kind in known)}
    skipped = [one_line(topic[:_LONGEST_TOPIC]) for topic in topics if topic.startswith("/ffsm/") and topic not in read]
    if not skipped:
        return ""
    more = f" and {len(skipped) - _MOST_TOPICS} more" if len(skipped) > _MOST_TOPICS else ""
    return f"{', '.join(skipped[:_MOST_TOPICS])}{more}: not read, no such kind of record is known here"


def _text(path: Path, name: str, content: bytes) -> str:
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise LogError(path, f"its attachment {name} is not UTF-8 (byte {error.start})") from error


def _gaps(log: RunLog) -> str:
    """Gaps and repetitions of the samples as text; empty if there are none or the control period is unknown."""
    try:
        metadata = log.header.metadata
        sampling = Sampling(float(metadata.get("control_period_s", "")), log.instants_s, logged_start_s(metadata))
    except ValueError:
        return ""
    sampling.ticks(log.column(TIME))
    sampling.end(log.outcome.end_s if log.outcome is not None else None)
    return sampling.sentence()


def _damage(salvage: Salvage, size: int, gaps: str, *, ended: bool) -> str:
    """Damage of a file as text, other than that it is incomplete; empty if there is none."""
    lost = f"{salvage.lost_bytes} of {size} bytes cannot be read" if salvage.lost_bytes else ""
    if lost or gaps:
        return "; ".join(part for part in (lost, gaps) if part)
    if not salvage.data_match:
        return "a checksum does not match: all samples were read, but descriptions and units may be wrong"
    if ended and not salvage.index_match:
        return "its index is missing or damaged; all data were read"
    return ""
