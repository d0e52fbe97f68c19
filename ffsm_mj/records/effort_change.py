"""Event record of efforts that change between control ticks: a delayed command arrives, or a control tick is late."""

from __future__ import annotations

from ffsm_mj.records.events import QPOS, QVEL, QVEL_UNCHANGED
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record


@record
class EffortChange:
    """Efforts change between control ticks; velocities do not."""

    time_s: float = declared("Simulation time.")
    step: int = declared("Index of the integration step, from 0.")
    cause: str = declared(
        "``command arrives`` after its delay, or ``late tick``: the control law was called late.",
        column="command arrives, or late tick",
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
    own_numbers=True,
)
