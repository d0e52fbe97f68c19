"""Heat of friction: the sum of what the contact rules and the impacts state, and it never falls."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import FRICTION_HEAT, SLIDING_HEAT
from ffsm_mj.verification.independent.finding import Finding, Worst
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.tolerances import HEAT_OF_FRICTION


def friction_heat(log: RunLog, rows: LoggedRows) -> list[Finding]:
    """Worst residual of the heat of friction: of its sum, and where it falls."""
    layout, kept = rows.kept.layout, rows.kept
    column, worst = layout.index.get(f"balance.{FRICTION_HEAT}"), Worst(HEAT_OF_FRICTION)
    block = np.array([kept[number] for number in kept.spread.kept if number in kept])
    if column is None or not len(block) or not rows.is_whole:
        return []
    rules = [i for key, i in layout.index.items() if key.startswith("contact.") and key.endswith(SLIDING_HEAT)]
    impacts = [(float(event[0].time_s), _heat(event)) for event in _events(log)]
    instants, heats = np.array([time_s for time_s, _ in impacts]), np.array([heat for _, heat in impacts])
    times, heat = block[:, layout.time], block[:, column]
    # Whether the row at the time of an impact is of before or after it is open.
    earlier, later = (np.searchsorted(instants, times + shift) for shift in (-SAME_TIME_S, SAME_TIME_S))
    excess = heat - block[:, rules].sum(axis=1) - np.concatenate(([0.0], np.cumsum(heats)))[earlier]
    # A log may begin later than its run: relative to the first row.
    away = np.where(earlier == later, np.abs(excess - excess[0]), 0.0)
    # The split of the work of several contacts at one instant is a convention: their share of heat may be negative.
    level = heat - np.concatenate(([0.0], np.cumsum(np.minimum(heats, 0.0))))[later]
    fall = np.maximum.accumulate(level) - level
    for residual, what in ((away, "sum"), (fall, "fall")):
        at = int(np.argmax(np.where(np.isnan(residual), np.inf, residual)))
        worst.add(what, residual[at], heat, float(times[at]), "J")
    return worst.found


def _events(log: RunLog) -> list[list[Any]]:
    """Records of each impact in which a contact has friction, in order of time."""
    events = [list(records) for _, records in groupby(log.impact_records, key=lambda record: record.event)]
    rough = [event for event in events if any(getattr(record, "mu", 0.0) > 0.0 for record in event)]
    return sorted(rough, key=lambda event: float(event[0].time_s))


def _heat(event: list[Any]) -> float:
    """Heat of friction of an impact, J: energy lost, less what the normal impulses take."""
    normal = sum(getattr(record, "normal_work_J", 0.0) or getattr(record, "work_J", 0.0) for record in event)
    return float(normal - event[0].energy_change_J)
