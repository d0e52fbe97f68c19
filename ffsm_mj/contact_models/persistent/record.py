"""What begins, ends and changes at contacts that last, as kinds of records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.records.kinds import Mark, RecordKind


@dataclass(frozen=True)
class ContactRecord:
    """What happened to a pair that lasts.

    Attributes:
        event: Number of what happened to lasting contacts and to grasps, from 0; pairs that share an instant share it.
        time_s: When.
        step: Integration step in which it happened, from 0.
        pair: Name of the pair of geoms.
        geoms: The two, a and b.
        mode: By which features they touch from here on, as ``sphere on face``; empty where they do not.
        points: By how many.
        point_m: Centre of pressure, or of the points where nothing presses, in world axes.
        normal: Mean unit normal in world axes, from a to b.
        force_before_N: Resultant force just before, N; 0 where there was none.
        force_after_N: Resultant force just after, under the efforts that acted until here, N.
        impulse_N_s: Integral of the resultant force of this pair since t = 0, N s.
        qpos: Configuration.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint: the same but for what rounding had left of the gaps' rates.
        efforts_after: Effort by actuator that acts here; no controller is asked.
    """

    event: int
    time_s: float
    step: int
    pair: str
    geoms: tuple[str, ...]
    mode: str
    points: int
    point_m: tuple[float, ...]
    normal: tuple[float, ...]
    force_before_N: float
    force_after_N: float
    impulse_N_s: float
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ContactBegins(ContactRecord):
    """A pair stays closed from here on; fields as those of :class:`ContactRecord`."""


@dataclass(frozen=True)
class ContactEnds(ContactRecord):
    """A pair opens; fields as those of :class:`ContactRecord`."""


@dataclass(frozen=True)
class ContactChanges(ContactRecord):
    """A pair stays closed and touches by other features, or begins to press; fields as those of :class:`ContactRecord`."""


def _marks(record: Any) -> list[Mark]:
    if record.force_after_N == 0.0:
        return [Mark(record.point_m, text="touches" if record.mode else "opens", name=record.pair)]
    return [Mark(record.point_m, record.normal, record.force_after_N, f"{record.force_after_N:.4g} N", record.pair)]


_COLUMNS = {
    "time_s": ("s", "simulation time"),
    "event": ("", "number of what happened to lasting contacts, from 0"),
    "pair": ("", "name of the pair of geoms"),
    "geoms_{ab}": ("", "geom of the pair; the normal points from a to b"),
    "mode": ("", "features by which they touch from here on"),
    "points": ("", "by how many"),
    "point_{xyz}_m": ("m", "centre of pressure, world frame"),
    "normal_{xyz}": ("", "mean normal from a to b, world frame"),
    "force_before_N": ("N", "resultant force just before"),
    "force_after_N": ("N", "resultant force just after"),
    "impulse_N_s": ("N s", "integral of the resultant force of the pair since t = 0"),
}
_LENGTHS = {"geoms": 2, "point_m": 3, "normal": 3}


def _kind(record: type, name: str, plural: str, when: str, says: str) -> RecordKind:
    def sentence(record: Any) -> str:
        touching = f", {record.mode}" if record.mode else ""
        force = f"{record.force_after_N:.4g} N after {record.force_before_N:.4g} N"
        return f"{force}, {' on '.join(record.geoms)}{touching}: contact of {record.pair} {says}"

    return RecordKind(
        record=record,
        name=name,
        plural=plural,
        when=when,
        time=lambda record: record.time_s,
        sentence=sentence,
        summarised=False,  # a contact is summed up from its beginning to its end
        columns=_COLUMNS,
        lengths=_LENGTHS,
        marks=_marks,
        in_every_run=True,
    )


CONTACT_BEGINS = _kind(ContactBegins, "contact_begins", "contact_beginnings", "when a pair begins to stay closed", "begins")
CONTACT_ENDS = _kind(ContactEnds, "contact_ends", "contact_endings", "when it opens", "ends")
CONTACT_CHANGES = _kind(
    ContactChanges, "contact_changes", "contact_changes", "when it touches by other features or begins to press", "changes"
)
