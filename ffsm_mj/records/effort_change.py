"""Event record of efforts that change between control ticks: a delayed command arrives, or a control tick is late."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ffsm_mj.records.kinds import RecordKind


@dataclass(frozen=True)
class EffortChange:
    """Efforts change between control ticks; velocities do not.

    Attributes:
        time_s: Simulation time.
        step: Index of the integration step, from 0.
        cause: ``command arrives`` after its delay, or ``late tick``: the control law was called late.
        qpos: Configuration, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity, by joint.
        qvel_after: Equal to ``qvel_before``.
        efforts_after: Effort by actuator from now on.
    """

    time_s: float
    step: int
    cause: str
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


EFFORT_CHANGE = RecordKind(
    record=EffortChange,
    name="effort_change",
    plural="effort_changes",
    when="when efforts change between control ticks",
    time=lambda record: record.time_s,
    sentence=lambda record: record.cause,
    summarised=False,
    columns={
        "time_s": ("s", "simulation time"),
        "step": ("", "index of the integration step, from 0"),
        "cause": ("", "command arrives, or late tick"),
    },
    own_numbers=True,
)
