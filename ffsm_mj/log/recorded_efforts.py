"""Efforts of a run as a table: at every control tick, and where an event changed them between two ticks."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import TIME, identifier

_GROUP, _APPLIED = "actuators.", "_applied_"


def recorded_efforts(log: RunLog) -> str:
    """CSV of the time and the efforts that the actuators delivered; empty if there are no actuators.

    Numbers are written so that they are read again bit for bit.
    """
    keys = [key for key in log.header.layout.index if key.startswith(_GROUP) and _APPLIED in key]
    if not keys or not len(log.rows):
        return ""
    found = {time_s: efforts for time_s, *efforts in zip(*(log.column(key).tolist() for key in (TIME, *keys)), strict=True)}
    changes = _changes(log, keys, found)
    rows: list[list[float]] = []
    for time_s in sorted({*found, *changes}):
        efforts = changes.get(time_s) or found[time_s]
        if time_s in found or efforts != rows[-1][1:]:  # most events leave the efforts as they are
            rows.append([time_s, *efforts])
    return "\n".join([",".join([TIME, *keys]), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def _changes(log: RunLog, keys: Sequence[str], ticks: Collection[float]) -> dict[float, list[float]]:
    """Efforts after events by time, in the order of the columns.

    At the time of a row, an event of the step that ends there precedes the row and is left out; one of the next step counts.
    """
    step_s = float(log.header.metadata.get("time_step_s", "0"))
    column = {key.removeprefix(_GROUP).partition(_APPLIED)[0]: i for i, key in enumerate(keys)}
    found: dict[float, list[float]] = {}
    events: list[Any] = log.events()
    for event in events:
        changed = getattr(event, "efforts_after", None)
        if changed and (event.time_s not in ticks or event.time_s < (event.step + 0.5) * step_s):
            efforts = found[event.time_s] = [0.0] * len(keys)
            for name, (effort,) in changed.items():
                efforts[column[identifier(name)]] = effort
    return found
