"""``run.mcap``, written while the run goes: ``run.mcap.partial`` until it is closed, readable after a kill."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from ffsm_mj.errors import LogWriteError
from ffsm_mj.events import Event, OutcomeRecord
from ffsm_mj.log import mcap_format as form
from ffsm_mj.log.sink import RunHeader
from ffsm_mj.model import FloatArray

_MEDIA_TYPES = {".yaml": "application/yaml", ".xml": "application/xml", ".urdf": "application/xml"}


class McapSink:
    """Writes one run to one file."""

    def __init__(self, path: Path) -> None:
        """Name the finished file; nothing is written yet."""
        self._path = path
        self._partial = path.with_name(path.name + ".partial")

    def open(self, header: RunHeader) -> None:
        """Write what must survive a kill at any later moment: facts, signals, scenario and models."""
        with _named(self._partial):
            self._stream = self._partial.open("wb")
            self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
            self._writer.start(profile="", library="ffsm-mj")
            self._writer.add_metadata(form.FACTS_METADATA, dict(header.facts))
            self._writer.add_metadata(
                form.SIGNALS_METADATA,
                {signal.key: f"{signal.unit} | {signal.description}" for signal in header.layout.signals},
            )
            self._attach(form.SCENARIO_ATTACHMENT, header.scenario_yaml.encode())
            for name, content in header.files.items():
                self._attach(name, content)
            self._register(header)
            self.flush()
        self._codec = form.SampleCodec(header.layout)
        self._time_column = header.layout.index["state.time_s"]

    def _attach(self, name: str, content: bytes) -> None:
        media_type = _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
        self._writer.add_attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=content)

    def _register(self, header: RunHeader) -> None:
        self._channels: dict[type, int] = {}
        schema = self._writer.register_schema(form.SAMPLE_SCHEMA, "protobuf", form.sample_schema(header.layout))
        self._sample_channel = self._writer.register_channel(form.SAMPLE_TOPIC, "protobuf", schema)
        for record_type, topic in form.RECORD_TOPICS.items():
            name = form.schema_name(record_type)
            schema = self._writer.register_schema(name, "protobuf", form.record_schema(record_type))
            self._channels[record_type] = self._writer.register_channel(topic, "protobuf", schema)

    def rows(self, block: FloatArray) -> None:
        """Write one sample per row."""
        times = [form.nanoseconds(t) for t in block[:, self._time_column]]
        with _named(self._partial):
            for time, message in zip(times, self._codec.encode(block), strict=True):
                self._writer.add_message(self._sample_channel, log_time=time, data=message, publish_time=time)

    def event(self, event: Event) -> None:
        """Write an event at its own time."""
        self._record(event, event.end_s if hasattr(event, "end_s") else _time_of(event))

    def _record(self, record: Any, time_s: float) -> None:
        time = form.nanoseconds(time_s)
        with _named(self._partial):
            data = form.encode_record(record)
            self._writer.add_message(self._channels[type(record)], log_time=time, data=data, publish_time=time)

    def flush(self) -> None:
        """Finish the chunk and hand everything to the operating system."""
        with _named(self._partial):
            self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Write the outcome, the index and the footer, and give the file its final name."""
        with _named(self._partial):
            if outcome is not None:
                self._record(outcome, outcome.end_s)
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.close()
            if outcome is not None:
                os.replace(self._partial, self._path)


def _time_of(event: Any) -> float:
    return float(event.start_s if hasattr(event, "start_s") else event.time_s)


class _named:  # noqa: N801 (reads as a statement)
    """Turn an OSError into one that names the log."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, OSError):
            raise LogWriteError(self._path, error) from error
