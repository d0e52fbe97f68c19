"""Efforts of a run as a table: at every control tick, and where an event changed them between two ticks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import TIME, identifier

_GROUP, _APPLIED = "actuators.", "_applied"


def recorded_efforts(log: RunLog) -> str:
    """CSV of the time and the efforts that the actuators delivered; empty if there are no actuators.

    Numbers are written so that they are read again bit for bit. Where an event follows a row at once, the efforts after it
    stand for both.
    """
    keys = [key for key in log.header.layout.index if key.startswith(_GROUP) and _APPLIED in key]
    if not keys or not len(log.rows):
        return ""
    rows: list[tuple[float, list[float]]] = []
    for _, is_event, time_s, efforts in sorted([*_ticks(log, keys), *_events(log, keys)], key=lambda each: each[:3]):
        if rows and time_s <= rows[-1][0]:  # the same time, up to rounding
            rows[-1] = rows[-1][0], efforts
        elif not (is_event and rows and efforts == rows[-1][1]):  # most events leave the efforts as they are
            rows.append((time_s, efforts))
    lines = (",".join(map(repr, (time_s, *efforts))) for time_s, efforts in rows)
    return "\n".join([",".join([TIME, *keys]), *lines]) + "\n"


_Instant = tuple[int, bool, float, list[float]]
"""Integration step that begins there or in which it is, whether it is an event, time in s, and efforts: in their order."""


def _ticks(log: RunLog, keys: Sequence[str]) -> Iterator[_Instant]:
    """Efforts at the rows."""
    step_s = float(log.header.metadata["time_step_s"])
    for time_s, *efforts in zip(*(log.column(key).tolist() for key in (TIME, *keys)), strict=True):
        yield round(time_s / step_s), False, time_s, efforts


def _events(log: RunLog, keys: Sequence[str]) -> Iterator[_Instant]:
    """Efforts after events."""
    column = {key.removeprefix(_GROUP).rpartition(_APPLIED)[0]: i for i, key in enumerate(keys)}
    records: list[Any] = log.events()
    for record in records:
        if changed := getattr(record, "efforts_after", None):
            efforts = [0.0] * len(keys)
            for name, (effort,) in changed.items():
                efforts[column[identifier(name)]] = effort
            yield record.step, True, record.time_s, efforts
