"""Changes of persistent contact at one state under its efforts: which pairs and joint limits begin, end or change.

Their event records have the forces before, and the contact points before or after the change.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from typing import Any, TypeAlias

import numpy as np

from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint, by_kind
from ffsm_mj.contact_models.interface import EventTime, LoggedEvent, Scene, event_fields
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.closing import points_at_rest, switched_rate_tolerance
from ffsm_mj.contact_models.persistent.columns import ContactReport, LimitReport
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.modes import PointMode
from ffsm_mj.contact_models.persistent.record import (
    CONTACT_BEGINS,
    CONTACT_CHANGES,
    CONTACT_ENDS,
    CONTACT_SLIPS,
    CONTACT_STICKS,
    FRICTION_KINDS,
    LIMIT_BEGINS,
    LIMIT_CHANGES,
    LIMIT_ENDS,
    ContactEnds,
    ContactRecord,
    ContactSlips,
    ContactSticks,
    LimitEnds,
)
from ffsm_mj.records.kinds import RecordKind

Change: TypeAlias = tuple[RecordKind, list[UnilateralConstraint]]
"""Kind of record of a change, as for pairs, and the pairs and limits concerned."""
PAIR_KINDS = (CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES)
"""Kinds of records of pairs besides those of friction."""
_LIMIT_KIND_OF = {CONTACT_BEGINS.name: LIMIT_BEGINS, CONTACT_ENDS.name: LIMIT_ENDS, CONTACT_CHANGES.name: LIMIT_CHANGES}
"""The kind of record that joint limits have of a change, by that which pairs have."""


class ContactChanges:
    """Finds and applies the changes of the closed contacts of a scene.

    Attributes:
        logged: Pairs and limits whose start is logged, and not yet their end.
    """

    def __init__(self, scene: Scene, closed: ClosedContacts) -> None:
        """Initialise with nothing logged."""
        self._scene, self._closed = scene, closed
        self.logged: list[UnilateralConstraint] = []

    def restore_before(self, event: LoggedEvent) -> None:
        """Restore the modes before a logged event: a step that ends to rounding at a slip or stop may have changed them."""
        first, slips = event.records[0], isinstance(event.records[0], ContactSlips)
        if isinstance(first, (ContactSlips, ContactSticks)):
            names = {record.pair for record in event.records}
            points = [contact for contact in self._closed.contact_points if contact.pair.name in names]
            self._closed.modes.assume(points, sticks=slips)
        # Events before a step are due by efforts or other events: only within one do points reach the limit of friction.
        if event.in_step:
            self._closed.note_release(slips=slips)
            # A force that vanishes slowly is within rounding of its limit where the run found it beyond.
            self._closed.opens = isinstance(first, (ContactEnds, LimitEnds))

    def left_at_once(self) -> list[JointLimit]:
        """Limits at which joints are at rest, as at the start of a run, but which they leave under the present efforts.

        Neither a start nor an end is logged: the joint does not stay there.
        """
        new = [pair for pair in self._closed.by_pair if pair.is_limit and pair not in self.logged]
        leaving = self._closed.leaving() if new else ()
        return [limit for limit in new if set(self._closed.by_pair[limit]).issubset(leaving)]

    def unlogged(self) -> list[UnilateralConstraint]:
        """Closed pairs and limits whose start is not logged."""
        return [pair for pair in self._closed.by_pair if pair not in self.logged]

    def pending(self) -> Change | None:
        """The next change at the state in ``data`` under its efforts: one record kind at a time, and the pairs concerned."""
        # One kind at a time: a pair begins before anything else happens to it, and points open before others change their
        # modes.
        if begins := self.unlogged():
            return CONTACT_BEGINS, begins
        leaving, beyond = self._closed.leaving(), self._closed.pairs_outside_feature()
        if not leaving and not beyond and all(self._closed.by_pair.values()):
            return self._slips_or_sticks()
        # A corner that slides off a face may find an edge there; a pair without any other feature opens.
        lost = [pair for pair in beyond if not self._features_now(pair)]
        ends = [
            pair
            for pair, contact_points in self._closed.by_pair.items()
            # Of a pair without points, too: the empty set is a part of any.
            if set(contact_points).issubset(leaving) or pair in lost
        ]
        if ends:
            return CONTACT_ENDS, ends
        changes = [*beyond, *(contact.pair for contact in leaving)]
        return (CONTACT_CHANGES, list(dict.fromkeys(changes))) if changes else self._slips_or_sticks()

    def _slips_or_sticks(self) -> Change | None:
        """Pairs with friction that begin to slide, or else those that begin to stick."""
        if not self._closed.contact_points:
            return None
        decision = self._closed.decide()
        kinds = self._closed.modes.of(decision.contact_points).kinds.tolist()
        if kinds == decision.kinds.tolist():
            return None
        before = _sliding_pairs(decision.contact_points, kinds)
        after = _sliding_pairs(decision.contact_points, decision.kinds.tolist())
        # A pair without a mode before has just begun: the record of its beginning says whether it slides.
        changed = [pair for pair, is_sliding in after.items() if pair in before and before[pair] != is_sliding]
        slips, sticks = [pair for pair in changed if after[pair]], [pair for pair in changed if not after[pair]]
        return (CONTACT_SLIPS, slips) if slips else (CONTACT_STICKS, sticks) if sticks else None

    def during_step(self) -> Change | None:
        """Pairs that ended a step early without opening.

        They entered the active set, drifted or tilted to the limit, or a point with friction changed its mode or direction.
        """
        decision = self._closed.decide() if self._closed.contact_points else None
        if decision is None:
            return None
        presses = [
            decision.contact_points[i].pair
            for i in decision.pressing
            if decision.contact_points[i] not in self._closed.pressing
        ]
        # A log replay chooses modes anew at ticks and events only: it must know of each change between them.
        changed = (decision.evaluation.modes.kinds != decision.kinds) | decision.restarts
        presses += [decision.contact_points[i].pair for i in np.flatnonzero(changed).tolist()]
        pairs = list(dict.fromkeys([*presses, *self._closed.pairs_with_drift(), *self._closed.pairs_with_tilt()]))
        return (CONTACT_CHANGES, pairs) if pairs else None

    def apply(self, kind: RecordKind, pairs: Sequence[UnilateralConstraint]) -> None:
        """Apply a change of some pairs or limits to the closed contacts."""
        if kind is CONTACT_BEGINS:
            self.logged += pairs
        elif kind is CONTACT_ENDS:
            beyond = self._closed.pairs_outside_feature()
            for pair in pairs:
                self.logged.remove(pair)
                self._closed.remove(pair)
            self._pass_on([pair for pair in pairs if pair in beyond])
        elif kind in FRICTION_KINDS:
            # Here, not at the next step: the records have the forces in the modes from here on.
            self._closed.update_pressing()
        else:
            self._change_points(pairs)

    def _change_points(self, pairs: Sequence[UnilateralConstraint]) -> None:
        """Remove the contact points that open, and redetermine the features of pairs that left one."""
        closed, leaving, beyond = self._closed, self._closed.leaving(), self._closed.pairs_outside_feature()
        for pair in pairs:
            if pair in beyond:
                # A corner that slides off a face may find an edge: the points of the old feature say nothing of it.
                closed.set_points(pair, self._features_now(pair))
            else:
                closed.set_points(pair, [contact for contact in closed.by_pair[pair] if contact not in leaving])
        self._pass_on([pair for pair in pairs if pair in beyond])

    def _pass_on(self, pairs: Sequence[UnilateralConstraint]) -> None:
        """Let other rules of the same bodies take over what some pairs lost: contact goes on beyond a seam of two rules."""
        others = (other for pair in pairs if not pair.is_limit for other in pair.together if other not in pairs)
        for other in dict.fromkeys(others):
            points = self._features_now(other)
            if points or other in self._closed.by_pair:
                self._closed.set_points(other, points)

    def _features_now(self, pair: UnilateralConstraint) -> tuple[ContactPoint, ...]:
        """Contact points of a pair that left a feature: none if, for example, a corner slid off a face."""
        patches = pair.proximities(self._scene.system.mj, self._scene.data)
        # At the bound of its feature the normal of a round geom has turned, and the gap rate along the new one is not
        # rounding.
        return tuple(
            point for near in patches for point in points_at_rest(self._scene, pair, near, switched_rate_tolerance(near))
        )


def _sliding_pairs(contact_points: Sequence[ContactPoint], kinds: Sequence[int]) -> dict[UnilateralConstraint, bool]:
    """Pairs with friction that carry force, and whether any of their points slides."""
    sliding: dict[UnilateralConstraint, bool] = {}
    for contact, kind in zip(contact_points, kinds, strict=True):
        if contact.pair.mu > 0.0 and kind in (PointMode.SLIDE, PointMode.STICK):
            sliding[contact.pair] = sliding.get(contact.pair, False) or kind == PointMode.SLIDE
    return sliding


class ChangeRecords:
    """Writes the records of the changes of a scene's closed contacts."""

    def __init__(
        self,
        scene: Scene,
        closed: ClosedContacts,
        report: ContactReport,
        limits: LimitReport,
        changes: ContactChanges,
    ) -> None:
        """Bind to the closed contacts and their reports."""
        self._scene, self._closed = scene, closed
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
        geoms, limits = by_kind(pairs)
        # Before the change: a pair that opens has no contact points after it.
        before, places, at_limits = report.forces_before(geoms), report.places(geoms), self._limits.forces_before(limits)
        apply()
        places |= report.places([pair for pair in geoms if pair in self._closed.by_pair])
        shared = event_fields(scene, instant, scene.data.qvel)  # no change of contacts changes velocities
        closed = [pair for pair in self._changes.logged if isinstance(pair, ContactPair)]
        return (
            *report.records(kind, places, before, shared, closed),
            *(self._limits.records(_LIMIT_KIND_OF[kind.name], at_limits, shared) if limits else ()),
        )


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
    # Ends may be missing in a damaged log: the columns of the row know better than the last record.
    return [pair for pair in pairs if pair.name in names and pair.rule in rules]
