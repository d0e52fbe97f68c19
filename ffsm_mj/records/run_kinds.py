"""The course of a run as kinds of records, whatever touches in it: its phases, and how it ended."""

from __future__ import annotations

from typing import Any

from ffsm_mj.records.events import Outcome, OutcomeRecord, PhaseRecord
from ffsm_mj.records.kinds import RecordKind


def _phase(record: PhaseRecord) -> dict[str, Any]:
    return {"name": record.name, "start_s": record.start_s, "controller": record.controller}


PHASE = RecordKind(
    record=PhaseRecord,
    name="phase",
    plural="phases",
    when="when a phase begins",
    time=lambda record: record.start_s,
    sentence=lambda record: f"phase {record.name} ({record.controller}) begins: {record.reason}",
    summary=_phase,
    columns={
        "index": ("", "position in the scenario, from 0"),
        "name": ("", "name of the phase"),
        "controller": ("", "kind of its controller"),
        "start_s": ("s", "when it begins"),
        "reason": ("", "why it begins"),
    },
    state=lambda record: record.name,
    in_every_run=True,
)

OUTCOME = RecordKind(
    record=OutcomeRecord,
    name="outcome",
    plural="",
    when="once, at the end; a log without it is incomplete",
    time=lambda record: record.end_s,
    sentence=lambda record: f"{record.outcome}: {record.message}" if record.message else record.outcome,
    warning=lambda record: record.outcome != Outcome.COMPLETED,
    in_every_run=True,
)
