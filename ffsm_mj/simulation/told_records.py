"""Of which events a control law is told."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ffsm_mj.contact_models.event import EventEffect
from ffsm_mj.contact_models.grasp.record_kinds import KINDS
from ffsm_mj.records.effort_change import EffortChange
from ffsm_mj.records.events import ImpactRecord

_OF_GRASPS = tuple(kind.record for kind in KINDS)


def told_records(records: Sequence[Any], above_N_s: float | None) -> tuple[Any, ...]:
    """Records of which the control law is told: of its own grasps always, of contacts as far as it is told of impacts.

    Args:
        records: Records of one event.
        above_N_s: Least impulse of an impact; -inf: all events are told; None: none of contacts.
    """
    records = [record for record in records if not isinstance(record, EffortChange)]
    if above_N_s == -math.inf:
        return tuple(records)
    hard = above_N_s is not None and any(
        isinstance(record, ImpactRecord) and record.impulse_N_s >= above_N_s for record in records
    )
    kinds = (*_OF_GRASPS, ImpactRecord) if hard else _OF_GRASPS
    return tuple(record for record in records if isinstance(record, kinds))


def calls_controller(effect: EventEffect, told: Sequence[Any]) -> bool:
    """Whether the controller is evaluated at an event of which it is told some records."""
    return effect.is_tick or (effect.triggers_control and (bool(told) or not effect.records))
