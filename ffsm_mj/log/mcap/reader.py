"""Reader of ``run.mcap`` and ``run.mcap.partial``, complete, incomplete or damaged.

Its records are read in one pass; of a complete file a second one computes the checksum of all its bytes. Rows of a long run
are read on demand: it is never completely in memory.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Attachment, Channel, Metadata, Schema

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.registry import contact_models
from ffsm_mj.errors import LogError, one_line
from ffsm_mj.log import limits
from ffsm_mj.log.mcap import format as form
from ffsm_mj.log.mcap.salvage import UNREADABLE, Batch, LogFile, opened
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.records.events import OutcomeRecord
from ffsm_mj.records.kinds import RecordKind, kind_of, kinds
from ffsm_mj.records.metadata import fault_of_metadata, fault_of_version
from ffsm_mj.records.run_log import DOUBTFUL, READ_ROWS, RunHeader, RunLog
from ffsm_mj.records.signals import TIME, Layout

_MOST_TOPICS, _LONGEST_TOPIC = 3, 60
KEPT_BYTES = 1 << 26
"""Rows up to this size are kept in memory after the first access; of larger ones, the last few columns."""
_KEPT_COLUMNS = 6
_INTERNAL = (form.SAMPLE_TOPIC, form.STATE_TOPIC)
"""Topics of every version that are no kinds of records."""


def read_log(path: Path) -> RunLog:
    """Read a run from its MCAP file; rows of a long run are read on demand.

    Of an incomplete file everything up to its end is read, and ``outcome`` is None. Of a damaged file everything with valid
    checksums is read, and ``damage`` describes the rest.

    Raises:
        LogError: There is no such file, it is not an MCAP file or not a log of ffsm-mj, or nothing in it is readable.
    """
    with opened(path) as file:
        return _Contents(path, file).run_log()


def stored_rows(path: Path, layout: Layout) -> StoredRows:
    """Rows of a log that was just written; the file is searched for them on first use."""

    def find() -> Sequence[Batch]:
        with opened(path) as file:
            return _Contents(path, file).samples

    return StoredRows(path, layout, find)


def stored_states(path: Path) -> list[bytes]:
    """States of the simulation in a log, in order of time; see :func:`ffsm_mj.state.from_bytes`.

    Raises:
        LogError: See :func:`read_log`.
    """
    with opened(path) as file:
        contents = _Contents(path, file)
        return [state for _, state in contents.messages(form.STATE_TOPIC)] if form.STATE_TOPIC in contents.topics else []


class _Contents:
    """Content of a log, within limits far above those of any run.

    Attributes:
        topics: Channels by their topics, in the order of the file.
        samples: Positions of the samples.
    """

    def __init__(self, path: Path, file: LogFile) -> None:
        """Read all records but the messages, of which the positions are kept.

        Raises:
            LogError: There are too many records, they are too large, or two channels have one topic.
        """
        self._path, self._file = path, file
        channels: dict[int, Channel] = {}
        self._schemas: dict[int, bytes] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        self._attachments: dict[str, bytes] = {}
        self._batches: dict[int, list[Batch]] = {}
        attached = 0
        for parts, record in enumerate(file.records(), 1):
            if parts > limits.PARTS:
                raise LogError(path, f"more than {limits.PARTS} different records, too many for a run")
            if isinstance(record, Batch):
                self._batches.setdefault(record.channel, []).append(record)
            elif isinstance(record, Schema):
                self._schemas.setdefault(record.id, record.data)
            elif isinstance(record, Channel):
                channels.setdefault(record.id, record)
            elif isinstance(record, Metadata):
                self._metadata[record.name] = record.metadata
            elif isinstance(record, Attachment):
                attached += len(record.data)
                if attached > limits.ATTACHED_BYTES:
                    raise LogError(path, f"more than {limits.ATTACHED_BYTES >> 30} GiB of attachments")
                self._attachments[record.name] = record.data
        self.topics: dict[str, Channel] = {}
        for channel in channels.values():
            if self.topics.setdefault(channel.topic, channel) is not channel and channel.topic.startswith("/ffsm/"):
                raise LogError(
                    path, f"two channels of {one_line(channel.topic[:_LONGEST_TOPIC])}: a log has one of each topic"
                )
        samples = self.topics.get(form.SAMPLE_TOPIC)
        self.samples = self._batches.get(samples.id, []) if samples is not None else []

    def messages(self, *topics: str) -> Iterator[tuple[int, bytes]]:
        """Messages on some topics, each with the id of its channel, in the order of the file."""
        batches: list[Batch] = []
        for topic in topics:
            of_topic = self._batches.get(self.topics[topic].id, [])
            if sum(batch.count for batch in of_topic) > limits.EVENTS:
                raise LogError(self._path, f"more than {limits.EVENTS} events on {topic}, too many for a run")
            batches += of_topic
        batches.sort(key=lambda batch: (batch.chunk, batch.at))
        for chunk, of_chunk in groupby(batches, key=lambda batch: batch.chunk):
            content = self._file.content(chunk)
            yield from ((batch.channel, message.tobytes()) for batch in of_chunk for message in batch.messages(content))

    def _holds(self, kind: RecordKind, channel: Channel) -> bool:
        """Whether a channel has the schema of a kind of record.

        Raises:
            ValueError: It does not, but every run has records of this kind.
        """
        schema = self._schemas.get(channel.schema_id)
        same = schema is None or form.is_schema_of(kind, schema)
        if kind.in_every_run and not same:
            raise ValueError(f"{kind.topic} has another schema")
        return same

    def run_log(self) -> RunLog:
        """Assemble the log of a run.

        Raises:
            LogError: The content is not that of a run.
        """
        path, metadata, channels = self._path, self._metadata, self.topics
        channel = channels.get(form.SAMPLE_TOPIC)
        if channel is None or channel.schema_id not in self._schemas:
            if form.RUN_METADATA in metadata:
                raise LogError(path, "the log ends, or is damaged, before its first sample")
            raise LogError(path, "not a log of ffsm-mj, or it ends before its header")
        if fault := fault_of_version(channel.metadata):
            raise LogError(path, fault)
        try:
            layout = form.layout_of_schema(self._schemas[channel.schema_id], metadata.get(form.SIGNALS_METADATA, {}))
            size = form.MESSAGE_HEAD.itemsize + form.SampleCodec(layout).message_size
            if any(batch.size != size for batch in self.samples):
                raise ValueError("the size of a sample does not follow from its schema")
            # Sizes are verified for all samples now; a long log is decoded only when its rows are used.
            stored = StoredRows(path, layout, self.samples)
            rows = stored.copy() if stored.small else stored
            _load_plugins(channels)
            known = [kind for kind in kinds() if kind.topic in channels and self._holds(kind, channels[kind.topic])]
            by_channel = {channels[kind.topic].id: kind for kind in known}
            messages = self.messages(*(kind.topic for kind in known))
            records = [form.decode_record(by_channel[channel], message) for channel, message in messages]
            for record in records:
                if not math.isfinite(time_s := kind_of(record).time(record)):
                    raise ValueError(f"the time of a record of {type(record).__name__} is {time_s}")
        except (ValueError, LookupError, TypeError, DecodeError) as error:
            raise LogError(path, f"not of this version's format ({error})") from error
        outcome = next((record for record in records if isinstance(record, OutcomeRecord)), None)
        events = tuple(record for record in records if not isinstance(record, OutcomeRecord))
        if fault := form.fault_of_names(self._attachments) or fault_of_metadata(channel.metadata):
            raise LogError(path, fault)
        files = dict(self._attachments)
        scenario = _text(path, form.SCENARIO_ATTACHMENT, files.pop(form.SCENARIO_ATTACHMENT, b""))
        by_topic = {kind.topic: kind.name for kind in known if not kind.in_every_run}
        declared = tuple(by_topic[topic] for topic in channels if topic in by_topic)  # in the order of the run
        header = RunHeader(channel.metadata.get("scenario", ""), scenario, layout, files, channel.metadata, declared)
        log = RunLog(header, rows, events, outcome, lost=self._lost())
        log = replace(log, events=log.whole_events()) if log.lost else log
        return replace(log, damage=_damage(self._file, _gaps(log), ended=outcome is not None), note=_note(channels, known))

    def _lost(self) -> tuple[tuple[float, float], ...]:
        """Times between which a part of the file is lost; see :class:`ffsm_mj.records.run_log.RunLog`."""
        ours = [channel.id for topic, channel in self.topics.items() if topic.startswith("/ffsm/")]
        batches = [batch for number in ours for batch in self._batches.get(number, [])]
        batches.sort(key=lambda batch: batch.chunk)
        times = np.array([batch.times_ns for batch in batches], dtype=np.float64).reshape(-1, 2)
        before = np.maximum.accumulate(np.append(-np.inf, times[:, 1]))
        after = np.minimum.accumulate(np.append(times[:, 0], np.inf)[::-1])[::-1]
        places = np.searchsorted([batch.chunk[0] for batch in batches], self._file.holes)
        # Half a nanosecond: times of messages are rounded to whole ones.
        spans = zip((before[places] * 1e-9 - 5e-10).tolist(), (after[places] * 1e-9 + 5e-10).tolist(), strict=True)
        lost = tuple(dict.fromkeys(spans)) if self._file.holes else ()
        return lost if lost or self._file.data_match else DOUBTFUL


def _load_plugins(topics: Iterable[str]) -> None:
    """Register the kinds of records of installed packages, if the log has unknown topics of ffsm-mj."""
    if any(topic.startswith("/ffsm/") for topic in set(topics) - {*_INTERNAL, *(kind.topic for kind in kinds())}):
        contact_models()


def _note(topics: Iterable[str], known: Sequence[RecordKind]) -> str:
    """Text that lists the topics of ffsm-mj that are not read; empty if all are."""
    read = {*_INTERNAL, *(kind.topic for kind in known)}
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
        sampling = Sampling(log, float(log.header.metadata.get("control_period_s", "")))
    except ValueError:
        return ""
    sampling.ticks(log.column(TIME))
    sampling.end()
    return sampling.sentence()


def _damage(file: LogFile, gaps: str, *, ended: bool) -> str:
    """Damage of a file as text, other than that it is incomplete; empty if there is none."""
    lost = f"{file.lost_bytes} of {file.size} bytes cannot be read" if file.lost_bytes else ""
    if lost or gaps:
        return "; ".join(part for part in (lost, gaps) if part)
    if not file.data_match:
        return "a checksum does not match: all samples were read, but descriptions and units may be wrong"
    if ended and not file.index_match:
        return "its index is missing or damaged; all data were read"
    return ""


class StoredRows:
    """Rows of one log, indexed like an array; each access reads the file in one pass and verifies its checksums again."""

    def __init__(self, path: Path, layout: Layout, batches: Sequence[Batch] | Callable[[], Sequence[Batch]]) -> None:
        """Remember the file; nothing is read yet.

        Args:
            path: The log.
            layout: Its columns.
            batches: Positions of its samples, or a function that finds them and is called once, on first use.
        """
        self._path, self._codec, self._width = path, form.SampleCodec(layout), len(layout.signals)
        self._file = path.absolute()  # the process may change its folder before rows are read
        self._batches_or_reader, self._stamp = batches, _stamp(self._file)
        self._column = lru_cache(_KEPT_COLUMNS)(self._read_column)

    @cached_property
    def batches(self) -> Sequence[Batch]:
        """Positions of the samples in the file."""
        return self._batches_or_reader() if callable(self._batches_or_reader) else self._batches_or_reader

    @cached_property
    def _count(self) -> int:
        return sum(batch.count for batch in self.batches)

    @cached_property
    def _all(self) -> FloatArray:
        return self._read(slice(None), None)

    def __len__(self) -> int:
        """Number of rows."""
        return self._count

    @property
    def small(self) -> bool:
        """Whether all rows may be kept in memory."""
        return 8 * self._count * self._width <= KEPT_BYTES

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns."""
        return self._count, self._width

    def blocks(self, columns: Sequence[int] | None = None) -> Iterator[FloatArray]:
        """Rows in order, in blocks of a few thousand, (n, number of columns), with all or some columns.

        Raises:
            LogError: The file was removed or replaced.
        """
        return (block for _, block in self._blocks(columns))

    def _blocks(self, columns: Sequence[int] | None, wanted: IntArray | None = None) -> Iterator[tuple[int, FloatArray]]:
        """Blocks with the index of the first row of each; those of chunks without rows that are wanted are left out.

        Args:
            columns: Columns of the blocks; None: all.
            wanted: Indices of rows, ascending; None: all.
        """
        if _stamp(self._file) != self._stamp:
            raise LogError(self._path, "has changed since the run was read")
        try:
            with opened(self._file) as file:
                end = 0
                for chunk, group in groupby(self.batches, key=lambda batch: batch.chunk):
                    batches = list(group)
                    start, end = end, end + sum(batch.count for batch in batches)
                    if wanted is not None and np.diff(np.searchsorted(wanted, (start, end))) == 0:
                        continue
                    content = file.content(chunk)
                    for batch in batches:
                        messages = batch.messages(content)
                        for first in range(0, batch.count, READ_ROWS):
                            yield start + first, self._codec.decode(messages[first : first + READ_ROWS], columns)
                        start += batch.count
        except UNREADABLE as error:
            raise LogError(self._path, f"not of this version's format ({error})") from error

    def __getitem__(self, key: Any) -> Any:
        """Index like an array: ``rows[10:20]``, ``rows[-1, 3]``, ``rows[chosen, 3]``, ``rows[:, [1, 2]]``.

        Raises:
            IndexError: Out of range.
        """
        if self.small:
            return self._all[key]
        rows, columns = key if isinstance(key, tuple) else (key, slice(None))
        if isinstance(columns, int | np.integer):
            return self._column(range(self._width)[columns])[rows]
        chosen = np.arange(self._width)[columns]
        if isinstance(rows, int | np.integer):
            row = range(self._count)[rows]
            return self._read(slice(row, row + 1), chosen.tolist())[0]
        return self._read(rows, chosen.tolist())

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        """All rows, for numpy."""
        return np.asarray(self[:], dtype=dtype)

    def copy(self) -> FloatArray:
        """All rows as a new array."""
        return np.array(self[:])

    def _read_column(self, column: int) -> FloatArray:
        numbers = self._read(slice(None), [column])[:, 0]
        numbers.flags.writeable = False
        return numbers

    def _read(self, rows: Any, columns: Sequence[int] | None) -> FloatArray:
        """Read some rows and columns in one pass, from the chunks that contain them."""
        # One pass over the file serves any order of rows: they are sorted, read block by block, and stored in place.
        wanted = np.arange(self._count)[rows]
        order = np.argsort(wanted, kind="stable")
        ascending = wanted[order]
        values = np.empty((len(wanted), self._width if columns is None else len(columns)))
        for start, block in self._blocks(columns, ascending):
            first, last = np.searchsorted(ascending, (start, start + len(block)))
            values[order[first:last]] = block[ascending[first:last] - start]
        return values


def _stamp(path: Path) -> tuple[int, int, int] | None:
    """Identity of a complete log, which changes if the file is replaced; None for a partial or missing one."""
    try:
        known = os.stat(path)
    except OSError:
        return None
    return None if path.name.endswith(".partial") else (known.st_ino, known.st_size, known.st_mtime_ns)
