"""Event records of changes of closed contacts, with the forces before and the contact points before or after the change."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from typing import Any

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import EventTime, LoggedEvent, Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.changes import ContactChanges
from ffsm_mj.contact_models.persistent.limit_record import LIMIT_KINDS
from ffsm_mj.contact_models.persistent.limit_report import LimitReport
from ffsm_mj.contact_models.persistent.record import CONTACT_BEGINS, CONTACT_CHANGES, CONTACT_ENDS, ContactRecord
from ffsm_mj.contact_models.persistent.report import ContactReport
from ffsm_mj.records.kinds import RecordKind

PAIR_KINDS = (CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES)
"""Kinds of records of pairs, in the order of ``LIMIT_KINDS``."""


class ChangeRecords:
    """Writes the records of the changes of a scene's closed contacts."""

    def __init__(
        self,
        scene: Scene,
        closed: ActiveContactSet,
        report: ContactReport,
        limits: LimitReport,
        changes: ContactChanges,
    ) -> None:
        """Bind to the closed contacts and their reports."""
        self._scene, self._active_set = scene, closed
        self._report, self._limits, self._changes = report, limits, changes

    def of(
        self,
        kind: RecordKind,
        pairs: Sequence[UnilateralConstraint],
        instant: EventTime,
        apply: Callable[[], None],
    ) -> tuple[Any, ...]:
        """Apply a change and return its records.

        Args:
            kind: Kind of the records, as for pairs.
            pairs: Pairs and joint limits that change.
            instant: Time of the change.
            apply: Applies it to the closed contacts.
        """
        scene, report = self._scene, self._report
        qvel, (geoms, limits) = scene.system.by_joint(scene.data.qvel), by_kind(pairs)
        before, places, at_limits = report.forces_before(geoms), report.places(geoms), self._limits.forces_before(limits)
        apply()
        places |= report.places([pair for pair in geoms if pair in self._active_set.by_pair])
        number = scene.numbers.next_number()
        limit_kind = LIMIT_KINDS[PAIR_KINDS.index(kind)] if limits else LIMIT_KINDS[0]
        closed = [pair for pair in self._changes.logged if isinstance(pair, ContactPair)]
        return (
            *report.records(kind, places, before, instant, number, qvel, closed),
            *self._limits.records(limit_kind, at_limits, instant, number, qvel),
        )


def by_kind(pairs: Sequence[UnilateralConstraint]) -> tuple[list[ContactPair], list[JointLimit]]:
    """Pairs of geoms, and joint limits."""
    geoms = [pair for pair in pairs if isinstance(pair, ContactPair)]
    return geoms, [pair for pair in pairs if isinstance(pair, JointLimit)]


def name_of(record: Any) -> str:
    """Name of the pair or joint limit of a record."""
    return str(record.pair) if isinstance(record, ContactRecord) else f"{record.joint} {record.side} limit"


def listed_pairs(events: Sequence[LoggedEvent], pairs: Sequence[ContactPair], rules: Container[str]) -> list[ContactPair]:
    """Pairs that were closed after the last of some events, of the rules that are closed according to the columns.

    Args:
        events: Events, in order.
        pairs: All pairs.
        rules: Rules with a closed pair.
    """
    records = [record for event in reversed(events) for record in event.records if isinstance(record, ContactRecord)]
    names = set(records[0].closed_pairs) if records else set()
    return [pair for pair in pairs if pair.name in names and pair.rule in rules]
