"""Event record of efforts that change between control ticks: a delayed command arrives, or a control tick is late."""

from __future__ import annotations

from ffsm_mj.records.events import QPOS, QVEL, QVEL_UNCHANGED
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.record import ByName, Values, logged, record


@record
class EffortChange:
    """Efforts change between control ticks; velocities do not."""

    time_s: float = logged("Simulation time.")
    step: int = logged("Index of the integration step, from 0.")
    cause: str = logged(
        "``command arrives`` after its delay, or ``late tick``: the control law was called late.",
        column="command arrives, or late tick",
    )
    qpos: Values = logged(QPOS)
    qvel_before: ByName = logged(QVEL)
    qvel_after: ByName = logged(QVEL_UNCHANGED)
    efforts_after: ByName = logged("Effort by actuator from now on.", default_factory=dict)


EFFORT_CHANGE = RecordKind(
    record=EffortChange,
    name="effort_change",
    plural="effort_changes",
    when="when efforts change between control ticks",
    time=lambda record: record.time_s,
    sentence=lambda record: record.cause,
    summarised=False,
    own_numbers=True,
)
