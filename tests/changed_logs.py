"""Logs whose records are not those of their run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.run_log import RunLog


def with_records(log: RunLog, records: Mapping[str, Iterable[Any]]) -> RunLog:
    """The log with other records of some kinds, by plural, in its order.

    As many as there are take their places one by one. Of more or fewer, those that were there keep their places, others go
    behind all that is not later than they.
    """
    events = list(log.events)
    for plural, of_kind in records.items():
        wanted, present = list(of_kind), log.records.get(plural, ())
        if len(wanted) == len(present):
            places = {id(old): new for old, new in zip(present, wanted, strict=True)}
            events = [places.get(id(event), event) for event in events]
            continue
        kept = {id(event) for event in wanted} & {id(event) for event in present}
        events = [event for event in events if id(event) in kept or kind_of(event).plural != plural]
        for new in (event for event in wanted if id(event) not in kept):
            time_s = kind_of(new).time(new)
            events.insert(sum(kind_of(event).time(event) <= time_s for event in events), new)
    return replace(log, events=tuple(events))
