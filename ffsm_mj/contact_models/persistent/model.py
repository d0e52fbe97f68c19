"""Persistent contact as a contact model: closed contacts stay closed while they press, and open where they would pull.

While pairs are closed, each stage of a step answers all other forces with those of the contacts, gap'' = 0 for the features
that press. Which press is decided where a step begins; a step ends early where that would change, where a contact leaves its
feature, or where a pair touches at another point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.pairs import ContactPair, Proximity
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.contact_models.impact.time_of_impact import GAP_TOLERANCE
from ffsm_mj.contact_models.impact.touching import Touching
from ffsm_mj.contact_models.interface import ContactModel, EventEffect, EventTime, Scene
from ffsm_mj.contact_models.persistent.active_set import (
    ActiveContactSet,
    closed_and_still,
    held_rate_tolerance,
    rate_tolerance,
    switched_rate_tolerance,
)
from ffsm_mj.contact_models.persistent.drift import Drift, added
from ffsm_mj.contact_models.persistent.exchange import Shares, exchanged, robot_dofs
from ffsm_mj.contact_models.persistent.record import CONTACT_BEGINS, CONTACT_CHANGES, CONTACT_ENDS
from ffsm_mj.contact_models.persistent.refusals import pressing_pairs, refusal, rubbing
from ffsm_mj.contact_models.persistent.report import ContactReport
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.contact_models.persistent.sharing import pieces
from ffsm_mj.dynamics.forced_stepper import WEIGHTS
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.wrench import Wrench

_INSTANT_S = 1e-13
"""An event is known this well within its step."""
_OTHER_MODEL = "another model than that of the scenario moves, and no grasp of the scenario holds in it"
_NEAR = 1e-6
_PARTS = tuple(0.5**k for k in range(1, 20))
"""Of a step, where a point that begins it at a gap of rounding may have left for a while."""


class PersistentContactModel(ContactModel):
    """Holds the pairs that impacts leave closed; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    kind = "contact"
    records = (CONTACT_BEGINS, CONTACT_ENDS, CONTACT_CHANGES)
    is_reactive = True

    def __init__(self, scene: Scene, impacts: ImpactModel) -> None:
        """Take over what impacts leave closed."""
        super().__init__(None, scene)
        self._impacts, self._closed = impacts, ActiveContactSet(scene)
        impacts.closing = self
        self._begun: list[ContactPair] = []
        self._report = ContactReport(scene, impacts.pairs, self._closed)
        self._drift = Drift(scene, self._closed)
        self.columns = self._report.columns
        self._moved: Motion | None = None
        self._landing = False
        self._righted: Exchange | None = None
        self._shared: tuple[tuple[tuple[ContactPoint, ...], Motion], Shares, slice] | None = None

    def bind(self, motion: Motion) -> None:
        """This moves from here on: what is closed and still stays so, but for pairs that are on one rigid body in it.

        A pair that has just become one again, as where an object is let go, is held from here on where it is closed.
        """
        super().bind(motion)
        self._closed.bind(motion)
        held = tuple(self._closed.by_pair)
        for pair in held:
            if pair.geom_ids in motion.rigid:
                self._closed.hold(pair, ())
        moved, self._moved = self._moved, motion
        if moved is not None and moved is not motion:
            self._look_anew(held)
        self._settle()
        self._closed.press()  # what pressed on the motion before may be on one rigid body in this one

    def _look_anew(self, held: Sequence[ContactPair]) -> None:
        """Hold what is closed and still of the pairs that there are while this moves, of which some were held before."""
        for pair, near in self._impacts.contacts():
            if abs(near.gap) <= GAP_TOLERANCE:  # what was let go where it overlaps is for the impact
                self._take(pair, near, held_rate_tolerance(near) if pair in held else near.still)

    def restart(self) -> None:
        """Something changed at one instant: nothing that was decided holds any more."""
        self._closed.forget()

    def holds(self, pair: ContactPair) -> bool:
        """Whether a pair is closed; see :class:`~ffsm_mj.contact_models.impact.closing.PersistentContacts`."""
        return pair in self._closed.by_pair

    def close(self, touching: Touching) -> None:
        """Hold what is closed and still of the pairs in contact, at the velocities in ``data``."""
        approach = max((-near.rate for _, near in touching), default=0.0)
        held = set(self._closed.by_pair)
        now = [(pair, pair.at_velocities(self.scene.data, near)) for pair, near in touching]
        for pair, near in now:
            self._take(pair, near, rate_tolerance(near, max(approach, 0.0)))
        self._closed.keep_down([(pair, near) for pair, near in now if pair in held])
        self._settle()

    def prepare_replay(self, records: Sequence[Any]) -> None:
        """Take up pairs of which a log tells something, where they are in contact and not held: no impact closed them."""
        self.scene.numbers.believe(records[0].event)
        if {record.pair for record in records} - {pair.name for pair in self._closed.by_pair}:
            self.close(self._impacts.contacts())

    def refusal(self, pair: ContactPair) -> str:
        """Why a pair cannot be held; empty where it can."""
        if self.motion.data is not self.scene.data and not self.motion.grasp:
            return _OTHER_MODEL
        return refusal(self.scene.system.mj, pair)

    def _take(self, pair: ContactPair, near: Proximity, still: float) -> None:
        if closed_and_still(near, still) and not self.refusal(pair):
            self._closed.take(pair, near, still)
        elif self.holds(pair):
            self._closed.hold(pair, ())

    def _settle(self) -> None:
        """Be active while anything is closed; a pair that has been told of is kept until its end is told."""
        for pair in [pair for pair, touches in self._closed.by_pair.items() if not touches and pair not in self._begun]:
            self._closed.let_go(pair)
        self.active = bool(self._closed.by_pair)
        self.horizon = -math.inf if self.active else math.inf
        if not self.active:
            self._closed.pressing = ()

    def restore_state(self) -> None:
        """Find what is closed and still at the state in ``data``; it has been told of where the columns say so."""
        data, model = self.scene.data, self.scene.system.mj
        for pair in tuple(self._closed.by_pair):
            self._closed.let_go(pair)
        self._begun = self._report.told()
        for pair in self._impacts.pairs:
            if pair.gap(model, data, 1.0) <= _NEAR:
                near = pair.proximity(model, data)
                self._take(pair, near, held_rate_tolerance(near) if pair in self._begun else near.still)
        self._settle()

    def due(self) -> bool:
        """Whether something begins, ends or changes at the state in ``data``, under the efforts that act from here on."""
        return self.active and bool(self._news() or self._closed.deeper())

    def begin_step(self) -> None:
        """A (sub-)step begins: take drift out of what is closed, and hold what presses.

        Raises:
            RunEnded: A pair with friction is pressed.
        """
        self._righted = self._drift.taken_out()
        self._closed.press()
        self._refuse_friction()
        self._closed.stages.clear()

    def _refuse_friction(self) -> None:
        """End the run where a pair with friction is pressed: whatever could take it over at this instant has had its turn.

        Raises:
            RunEnded: There is such a pair.
        """
        if not any(pair.mu > 0.0 for pair in self._closed.by_pair) or not self._closed.touches:
            return
        decision, data = self._closed.decide(), self.scene.data
        for pair, force in pressing_pairs(decision).items():
            if pair.mu > 0.0:
                held = [at for touch, at in zip(decision.touches, decision.rows.held, strict=True) if touch.pair is pair]
                why = rubbing(pair, force, [pair.slip(data, at.normal, at.point) for at in held])
                raise RunEnded(
                    Outcome.UNSUPPORTED_CONTACT, f"{pair} would stay in contact from t = {data.time:.6g} s, {why}"
                )

    def is_clear(self) -> bool:
        """Whether what is held is what presses at the end of the step too, and nothing else has happened."""
        return not self.active or self._closed.slack() >= 0.0

    def first_event(self, duration_s: float) -> float | None:
        """When that first ceased, a little late: so that the state there tells what has changed."""
        path = self.motion.path

        def slack(time_s: float) -> float:
            if time_s <= 0.0:
                return 1.0  # what is held was decided there
            path.move_to(time_s)
            return self._closed.slack()

        if slack(duration_s) >= 0.0:
            return None
        changed = self._just_after(slack, 0.0, duration_s)
        path.move_to(changed)
        self._landing = self._closed.deeper()
        return self._landing_time(changed) if self._landing else changed

    def _landing_time(self, seen_s: float) -> float:
        """When the points of closed pairs that overlap by now touched, not a depth later: depth is height, and energy."""
        landed, data, path = self._closed.landed(), self.scene.data, self.motion.path

        def gap(time_s: float) -> float:
            path.move_to(time_s)
            return min(feature.at(data).gap for feature in landed)

        if not landed:
            return seen_s
        above = next((part * seen_s for part in (0.0, *_PARTS) if gap(part * seen_s) > 0.0), seen_s)
        return self._just_after(gap, above, seen_s) if above < seen_s else seen_s

    @staticmethod
    def _just_after(f: Callable[[float], float], start_s: float, end_s: float) -> float:
        """Where a function first falls below zero between two times, from the side where it has, an instant after it has.

        Whoever looks at that state again, a recount too, finds the same there, whatever its own rounding.
        """
        from scipy.optimize import brentq  # a second to import, for runs in which a contact lasts

        root, late = float(brentq(f, start_s, end_s, xtol=_INSTANT_S, rtol=8.9e-16)), _INSTANT_S
        while True:
            root, late = min(root + late, end_s), 2.0 * late
            if root >= end_s or f(root) < 0.0:
                return root

    def names(self) -> str:
        """The pairs that are closed."""
        return "; ".join(str(pair) for pair in self._closed.by_pair)

    def push(self, data: Any) -> None:
        """The forces of the contacts; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""
        self._closed.push(data)

    def wrenches(self, data: Any) -> Sequence[Wrench]:  # noqa: ARG002
        """What the contacts put on their bodies under the efforts in ``data``, decided anew."""
        return self._report.wrenches()

    def end_step(self, duration_s: float) -> Exchange | None:
        """What the contacts exchanged, and what taking the drift out of them did as the step began."""
        done, impulses = self._exchanged(duration_s)
        self._report.book(impulses)
        self._impacts.deepen(-min([at.gap for at in self._closed.decide().rows.held], default=0.0))
        return done

    def exchanged(self, duration_s: float) -> Exchange | None:
        """The same where the step may yet be taken back."""
        return self._exchanged(duration_s)[0]

    def _exchanged(self, duration_s: float) -> tuple[Exchange | None, Mapping[ContactPair, float]]:
        """What was exchanged in a step that has just been made, and the impulse of each pair in N s."""
        closed, system = self._closed, self.scene.system
        if not closed.pressing:
            return self._righted, {}
        anew = pieces(closed, self.motion, duration_s)
        if anew is not None:
            shares = Shares.of(system, anew.touches, self.motion.carried_bodies)
            parts = np.array(anew.weights_s)
            booking, impulses = exchanged(anew.stages, parts, shares, robot_dofs(system, self.motion))
            return added(self._righted, booking), impulses
        stages = closed.stages[-5:-1]  # the last one is that of the end, where the next step begins
        key = closed.pressing, self.motion
        if self._shared is None or self._shared[0] != key:
            self._shared = (
                key,
                Shares.of(system, closed.pressing, self.motion.carried_bodies),
                robot_dofs(system, self.motion),
            )
        booking, impulses = exchanged(stages, duration_s * WEIGHTS, *self._shared[1:])
        return added(self._righted, booking), impulses

    def held_points(self) -> dict[ContactPair, list[FloatArray]]:
        """Where the closed pairs are held at the state in ``data``, m, world axes."""
        data = self.scene.data
        return {pair: [touch.feature.at(data).point for touch in touches] for pair, touches in self._closed.by_pair.items()}

    def active_contacts(self) -> tuple[ActiveContact, ...]:
        """The closed pairs, as control laws see them."""
        return self._report.active()

    def act(self, instant: EventTime) -> EventEffect | None:
        """Tell of what begins, ends or changes; a touch at another point is an impact."""
        if self._landing or self._closed.deeper():
            self._landing = False
            return self._impacts.act(instant)
        news = self._news() or self._cut_inside_a_step()
        if news is None:
            return None
        (kind, pairs), qvel = news, self.scene.system.by_joint(self.scene.data.qvel)
        before, places = self._report.before(pairs), self._report.places(pairs)
        if kind is CONTACT_BEGINS:
            self._begun += pairs
        elif kind is CONTACT_ENDS:
            for pair in pairs:
                self._begun.remove(pair)
                self._closed.let_go(pair)
        else:
            self._change(pairs)
        self._settle()
        places |= self._report.places([pair for pair in pairs if self.holds(pair)])
        records = self._report.records(kind, places, before, instant, self.scene.numbers.take(), qvel)
        return EventEffect(records, triggers_control=False)

    def _news(self) -> tuple[RecordKind, list[ContactPair]] | None:
        """What there is to tell of at the state in ``data`` under the efforts in it, one kind at a time."""
        closed = self._closed
        begins = [pair for pair in closed.by_pair if pair not in self._begun]
        if begins:
            return CONTACT_BEGINS, begins
        leaving, beyond = closed.leaving(), closed.beyond_an_edge()
        lost = [pair for pair in beyond if not self._found_anew(pair)]
        ends = [pair for pair, touches in closed.by_pair.items() if set(touches).issubset(leaving) or pair in lost]
        if ends:
            return CONTACT_ENDS, ends
        changes = [*beyond, *(touch.pair for touch in leaving)]
        return (CONTACT_CHANGES, list(dict.fromkeys(changes))) if changes else None

    def _cut_inside_a_step(self) -> tuple[RecordKind, list[ContactPair]] | None:
        """Pairs for which a step ended: closed without force as it began, they press by now, or they have drifted off."""
        closed = self._closed
        decision = closed.decide() if closed.touches else None
        if decision is None:
            return None
        presses = [decision.touches[i].pair for i in decision.pressing if decision.touches[i] not in closed.pressing]
        pairs = list(dict.fromkeys([*presses, *closed.adrift()]))
        return (CONTACT_CHANGES, pairs) if pairs else None

    def _change(self, pairs: Sequence[ContactPair]) -> None:
        """Let go of the points that open, and find anew by which features a pair touches that has left one."""
        closed, leaving, beyond = self._closed, self._closed.leaving(), self._closed.beyond_an_edge()
        for pair in pairs:
            if pair in beyond:
                closed.hold(pair, self._found_anew(pair))
            else:
                closed.hold(pair, [touch for touch in closed.by_pair[pair] if touch not in leaving])

    def _found_anew(self, pair: ContactPair) -> tuple[ContactPoint, ...]:
        """By what a pair touches that has left a feature: by nothing where a corner has slid off a face."""
        near = pair.proximity(self.scene.system.mj, self.scene.data)
        return self._closed.found(pair, near, switched_rate_tolerance(near))
