"""Event records of persistent contact: contacts begin, end, change features; joints come to rest at limits, leave them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from ffsm_mj.contact_models.impact.records import force_unit
from ffsm_mj.records.events import ANCHOR, AXIS, EFFORTS_KEPT, EVENT, LIMIT, QPOS, QVEL_BEFORE, QVEL_KEPT, SIDE, STEP
from ffsm_mj.records.kinds import ArrowColumns, Mark, RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record
from ffsm_mj.records.signals import Layout


@record
class ContactRecord:
    """An event of a pair in persistent contact.

    A pair is wedged if forces inside the friction cones hold it without any load: the load at which it slips then depends on
    the past.
    """

    event: int = declared(EVENT)
    time_s: float = declared("Simulation time.")
    step: int = declared(STEP)
    pair: str = declared("Name of the pair of geoms.")
    rule: str = declared("Name of its contact rule.")
    geoms: tuple[str, ...] = declared(
        "Geoms a and b of the pair, of several that touch the first; the normal points from a to b.", components="ab"
    )
    mode: str = declared("Contact features after the event, such as ``sphere on face``; empty if the pair is open.")
    points: int = declared("Number of contact points after the event.")
    point_m: Values = declared(
        "Centre of pressure in world axes; mean of the contact points if none carries force.", components="xyz"
    )
    normal: Values = declared("Mean unit normal in world axes, from a to b.", components="xyz")
    force_before_N: float = declared("Resultant force just before; 0 if there was none.")
    force_after_N: float = declared("Resultant force just after, under the efforts up to the event.")
    impulse_N_s: float = declared("Time integral of the contact force of the rule since t = 0.")
    closed_pairs: tuple[str, ...] = declared(
        "Names of all pairs in persistent contact after the event, of all rules.", column=False
    )
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_KEPT)
    efforts_after: ByName = declared(EFFORTS_KEPT, default_factory=dict)
    friction: str = declared(
        "Friction mode after the event: ``sticking``, ``sticking, wedged`` or ``sliding``; empty without friction or force.",
        default="",
    )


@record
class ContactBegins(ContactRecord):
    """A pair enters persistent contact."""


@record
class ContactEnds(ContactRecord):
    """A pair opens."""


@record
class ContactChanges(ContactRecord):
    """A closed pair changes features or friction modes, or starts to carry force."""


@record
class FrictionRecord(ContactRecord):
    """A pair with friction slips or sticks."""

    friction_N: float = declared("Friction force just after.", default=0.0)
    friction_use: float = declared(
        "Share of the friction limit, mu times the normal force, that is used just after, in [0, 1].", default=0.0
    )
    slip_speed_m_s: float = declared("Largest slip speed just after.", default=0.0)
    slip_m: float = declared("Slip distance of the rule since t = 0: time integral of its largest slip speed.", default=0.0)


@record
class ContactSlips(FrictionRecord):
    """A pair with friction that sticks begins to slide."""


@record
class ContactSticks(FrictionRecord):
    """All points of a pair with friction that slides begin to stick."""


def _marks(record: Any) -> list[Mark]:
    if record.force_after_N == 0.0:
        return [Mark(record.point_m, text="touches" if record.mode else "opens", name=record.pair)]
    return [Mark(record.point_m, record.normal, record.force_after_N, f"{record.force_after_N:.4g} N", record.pair)]


def _friction_arrows(layout: Layout) -> Iterator[ArrowColumns]:
    """Friction force of each contact rule with mu > 0 on its second side, at the centre of pressure."""
    for force in _force_arrows(layout):
        vector = [f"contact.{force.name}_friction_{axis}_N" for axis in "xyz"]
        size = f"contact.{force.name}_friction_N"
        if {*vector, size} <= layout.index.keys():
            places = layout.places(vector), force.point, layout.index[size]
            yield ArrowColumns(f"{force.name}_friction", "friction force", *places, is_part=True)


def _force_arrows(layout: Layout) -> Iterator[ArrowColumns]:
    """Resultant force of each contact rule on its second side, at the centre of pressure."""
    for key in layout.keys:
        name = key.removeprefix("contact.").removesuffix("_mode")
        if key != f"contact.{name}_mode":
            continue
        vector = [f"contact.{name}_force_{axis}_N" for axis in "xyz"]
        point = [f"contact.{name}_centre_{axis}_m" for axis in "xyz"]
        size = f"contact.{name}_force_N"
        # Columns of another contact model may end alike, but it has not all of these.
        if {*vector, *point, size} <= layout.index.keys():
            yield ArrowColumns(name, "contact force", layout.places(vector), layout.places(point), layout.index[size])


def _kind(
    record: type,
    name: str,
    plural: str,
    when: str,
    says: str,
    arrows: Callable[[Layout], Iterable[ArrowColumns]] | None = None,
    *,
    in_every_run: bool = True,
) -> RecordKind:
    def sentence(record: Any) -> str:
        features = f", {record.mode}" if record.mode else ""
        force = f"force {record.force_before_N:.4g} N before, {record.force_after_N:.4g} N after"
        friction = f", {record.friction}" if record.friction else ""
        if isinstance(record, FrictionRecord):
            friction = f", friction {record.friction_N:.4g} N{friction}, slip distance {record.slip_m:.4g} m"
        return f"contact {record.pair} {says}: {force}{friction}, {' and '.join(record.geoms)}{features}"

    return RecordKind(
        record=record,
        name=name,
        plural=plural,
        when=when,
        sentence=sentence,
        summarised=False,  # the summary lists contact intervals instead
        marks=_marks,
        arrows=arrows,
        in_every_run=in_every_run,
    )


CONTACT_BEGINS = _kind(
    ContactBegins,
    "contact_begins",
    "contact_beginnings",
    "when a pair enters persistent contact",
    "begins",
    _force_arrows,  # of all closed pairs: declared once
)
CONTACT_ENDS = _kind(ContactEnds, "contact_ends", "contact_endings", "when it opens", "ends")
CONTACT_SLIPS = _kind(
    ContactSlips,
    "contact_slips",
    "contact_slips",
    "when a pair with friction begins to slide",
    "slips",
    _friction_arrows,  # of all rules with friction: declared once
    in_every_run=False,
)
CONTACT_STICKS = _kind(
    ContactSticks,
    "contact_sticks",
    "contact_sticks",
    "when a pair with friction that slides begins to stick",
    "sticks",
    in_every_run=False,
)
FRICTION_KINDS = (CONTACT_SLIPS, CONTACT_STICKS)
"""Kinds of runs with friction."""
CONTACT_CHANGES = _kind(
    ContactChanges,
    "contact_changes",
    "contact_changes",
    "when its features change, it starts to carry force, or some points slip, stick or turn their slip",
    "changes",
)


@record
class LimitRecord:
    """An event of a joint that rests at a limit."""

    event: int = declared(EVENT)
    time_s: float = declared("Simulation time.")
    step: int = declared(STEP)
    joint: str = declared("Full name of the joint.")
    side: str = declared(SIDE)
    unit: str = declared("Unit of the coordinate: ``rad`` (forces are torques in N m) or ``m`` (forces in N).")
    value: float = declared("Coordinate of the joint, rad or m.")
    limit: float = declared(LIMIT)
    state: str = declared("``pressed``, ``touching`` without force, or ``free``, after the event.")
    force_before: float = declared(
        "Force or torque of the limit on the joint just before, N or N m, >= 0 away from the limit; 0 if there was none."
    )
    force_after: float = declared("Force or torque of the limit just after, N or N m, under the efforts up to the event.")
    impulse: float = declared("Time integral of the force of this joint's limits since t = 0, N s or N m s.")
    point_m: Values = declared(ANCHOR)
    axis: Values = declared(AXIS)
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_KEPT)
    efforts_after: ByName = declared(EFFORTS_KEPT, default_factory=dict)


@record
class LimitBegins(LimitRecord):
    """A joint comes to rest at a limit."""


@record
class LimitEnds(LimitRecord):
    """A joint leaves its limit."""


@record
class LimitChanges(LimitRecord):
    """A joint at rest at a limit starts to press on it."""


def _force(record: Any) -> str:
    return f"{record.force_after:.4g} {force_unit(record.unit)}"


def _limit_marks(record: Any) -> list[Mark]:
    name = f"{record.joint} {record.side} limit"
    if record.force_after == 0.0:
        return [Mark(record.point_m, text="leaves its limit" if record.state == "free" else "at its limit", name=name)]
    return [Mark(record.point_m, record.axis, record.force_after, _force(record), name)]


def _limit_kind(record: type, name: str, plural: str, when: str, says: str) -> RecordKind:
    def sentence(record: Any) -> str:
        at = f"its {record.side} limit of {record.limit:g} {record.unit}"
        force = f"{record.force_before:.4g} {force_unit(record.unit)} before, {_force(record)} after"
        return f"joint {record.joint} {says} {at}: {force}"

    return RecordKind(
        record=record,
        name=name,
        plural=plural,
        when=when,
        sentence=sentence,
        marks=_limit_marks,
    )


LIMIT_BEGINS = _limit_kind(
    LimitBegins, "limit_begins", "limit_beginnings", "when a joint comes to rest at a limit", "comes to rest at"
)
LIMIT_ENDS = _limit_kind(LimitEnds, "limit_ends", "limit_endings", "when it leaves the limit", "leaves")
LIMIT_CHANGES = _limit_kind(
    LimitChanges, "limit_changes", "limit_changes", "when it starts to press on the limit", "starts to press on"
)
LIMIT_KINDS = (LIMIT_BEGINS, LIMIT_ENDS, LIMIT_CHANGES)
