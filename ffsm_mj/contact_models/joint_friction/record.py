"""Event record of dry friction: a joint or tendon comes to rest, begins to slide, or turns back; and its columns."""

from __future__ import annotations

from ffsm_mj.records.events import EFFORTS_KEPT, EVENT, QPOS, QVEL_BEFORE, QVEL_KEPT, STEP
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record
from ffsm_mj.records.signals import JOINT_FRICTION_HEAT, SUBSYSTEMS, Signal, identifier

_SENSES = {-1: "slides down", 0: "sticks", 1: "slides up"}


@record
class StickSlipRecord:
    """A joint or tendon with dry friction comes to rest, begins to slide, or turns back."""

    event: int = declared(EVENT)
    time_s: float = declared("Simulation time.")
    step: int = declared(STEP)
    joint: str = declared("Full name of the joint or tendon.")
    unit: str = declared("Unit of the coordinate or length: ``rad`` (friction in N m) or ``m`` (in N).")
    value: float = declared("Coordinate of the joint, or length of the tendon, at the event, rad or m.")
    sense_before: int = declared("Sense in which it slides before, -1 or 1; 0: it sticks.")
    sense_after: int = declared("Sense in which it slides after, likewise.")
    friction_after: float = declared("Friction on it just after, under the efforts up to the event, N m or N.")
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_KEPT)
    efforts_after: ByName = declared(EFFORTS_KEPT, default_factory=dict)


STICK_SLIP = RecordKind(
    record=StickSlipRecord,
    name="stick_slip",
    plural="stick_slips",
    when="when a joint or tendon with dry friction comes to rest, begins to slide or turns back",
    sentence=lambda record: f"{record.joint} {_SENSES[record.sense_after]} at {record.value:.5g} {record.unit}",
    summarised=False,
)


def friction_signals(joint: str, unit: str) -> tuple[Signal, Signal]:
    """Columns of one joint or tendon: its sense, and the friction on it."""
    name, size, units = identifier(joint), *(("torque", "N_m") if unit == "rad" else ("force", "N"))
    return (
        Signal(
            "contact",
            f"{name}_sliding",
            "",
            f"dry friction of {joint} from this row on: 0 sticks, 1 or -1 slides up or down, 2 sticks (idle_friction)",
            joint,
        ),
        Signal(
            "contact",
            f"{name}_friction_{size}_{units}",
            units.replace("_", " "),
            f"{size} of dry friction on {joint}, under the efforts of this row",
            joint,
        ),
    )


HEAT_SIGNALS = tuple(
    Signal(
        "balance",
        JOINT_FRICTION_HEAT.format(subsystem),
        "J",
        f"heat of dry friction of joints and tendons since t = 0, {subsystem}",
    )
    for subsystem in SUBSYSTEMS
)
