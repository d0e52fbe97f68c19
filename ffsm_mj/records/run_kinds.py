"""Kinds of records of every run (phases, internal errors, the outcome), and of efforts that change between control ticks."""

from __future__ import annotations

from typing import Any

from ffsm_mj.records.events import QPOS, QVEL, QVEL_UNCHANGED, InternalErrorRecord, Outcome, OutcomeRecord, PhaseRecord
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record


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
    state=lambda record: record.name,
    in_every_run=True,
)

INTERNAL_ERROR = RecordKind(
    record=InternalErrorRecord,
    name="internal_error",
    plural="internal_errors",
    when="when an exception in ffsm-mj or a plug-in ends the run",
    sentence=lambda record: f"internal error: {record.error} ({record.where})",
    summarised=False,  # outcome and message of the summary say the same
    warning=lambda _: True,
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


@record
class EffortChange:
    """Efforts change between control ticks; velocities do not."""

    time_s: float = declared("Simulation time.")
    step: int = declared("Index of the integration step, from 0.")
    cause: str = declared(
        "``command arrives`` after its delay, or ``late tick``: the control law was called late.",
    )
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL)
    qvel_after: ByName = declared(QVEL_UNCHANGED)
    efforts_after: ByName = declared("Effort by actuator from now on.", default_factory=dict)


EFFORT_CHANGE = RecordKind(
    record=EffortChange,
    name="effort_change",
    plural="effort_changes",
    when="when efforts change between control ticks",
    sentence=lambda record: record.cause,
    summarised=False,
    series="effort_change",
)
