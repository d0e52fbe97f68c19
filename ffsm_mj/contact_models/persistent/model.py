"""Persistent contact model: unilateral constraints on closed contacts, integrated event by event with an active set.

Each stage of a step computes the contact forces that keep gap'' = 0 at the contact points of the active set, given the other
forces. The active set is chosen at the start of a step from the complementarity problem 0 <= gap'' _|_ force >= 0
(Brogliato, *Nonsmooth Mechanics*) and is frozen within it, so that every step integrates a smooth ODE at the full order of
RK4. A step ends early when the active set would change, a contact point leaves its feature, or a pair touches at another
point.

Constraints are enforced at the acceleration level, so rounding and truncation error make gaps drift; projection onto the
position and velocity constraints is the standard remedy (Hairer & Wanner, *Solving ODEs II*, sec. VII.2). The energy and
momentum that it changes are accounted for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj._core.steady import SteadyContacts
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint, by_kind
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat
from ffsm_mj.contact_models.impact.resolution import ClosedPairs, closed_pairs, recall_points
from ffsm_mj.contact_models.interface import (
    EventEffect,
    EventSource,
    EventTime,
    ForceOrder,
    ForceSource,
    LoggedEvent,
    Replayable,
    Scene,
    first_root,
    just_after,
)
from ffsm_mj.contact_models.persistent.changes import (
    PAIR_KINDS,
    ChangeRecords,
    ContactChanges,
    listed_pairs,
    name_of,
)
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.closing import by_pair as patches_by_pair
from ffsm_mj.contact_models.persistent.closing import (
    closed_after_change,
    closed_and_still,
    closed_at,
    closed_rate_tolerance,
    rate_tolerance,
    refusal_in,
)
from ffsm_mj.contact_models.persistent.columns import ContactReport, LimitReport, StepAccount
from ffsm_mj.contact_models.persistent.exchange import Shares
from ffsm_mj.contact_models.persistent.force_check import ForceCheck
from ffsm_mj.contact_models.persistent.record import FRICTION_KINDS, LIMIT_KINDS
from ffsm_mj.contact_models.persistent.rounding_of_forces import RecordAccuracy, varied_forces
from ffsm_mj.contact_models.state_projection import StateProjection
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.projection import ClosedRows, needs_projection
from ffsm_mj.dynamics.rigid_body import tangents
from ffsm_mj.records.contact_forces import ActiveContact, Wrench
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import Layout
from ffsm_mj.state import entries
from ffsm_mj.tolerances import CLEARLY_APART_M

_START_FRACTIONS = tuple(0.5**k for k in range(1, 20))
"""Fractions of a step at which a positive gap is looked for: a point that lands may start the step at a gap of rounding."""
_DRIFT_DIGITS = 256.0
"""Parts of a power of two in whose number the time of a drift is given: at least 99.2 % of it, and t^5 reaches 96 %."""


class DriftProjection:
    """Projects out the drift of the closed contacts of a scene.

    Attributes:
        projection: Projects the state.
    """

    def __init__(self, scene: Scene, closed: ClosedContacts) -> None:
        """Bind to the closed contacts."""
        self._system, self._closed, self.projection = scene.system, closed, StateProjection(scene, "contacts")

    def remove_drift(self) -> Exchange | None:
        """Project the state in ``data`` at the start of a step if needed; returns the energy and momentum this changed."""
        contact_points, motion = self._closed.contact_points, self._closed.motion
        # Below these tolerances a projection would change the energy at each step by its own rounding, and nothing else. But
        # a point that begins to slide has an acceleration of zero there: a drift of any size against it would stop it again.
        if not contact_points or not (self._closed.modes.beginning or needs_projection(*drift_of(self._closed))):
            return None
        # Fixed bodies may take momentum from the system; between free ones P and L must stay as they are.
        outside = Shares.of(self._system, contact_points, motion.grasped_bodies).outside != 0.0
        projected = unit_wrenches(self._closed, outside.any(axis=0))
        return self.projection.apply(motion, lambda: rows_to_project(self._closed), projected, outside.any(axis=1))


def drift_of(closed: ClosedContacts) -> tuple[float, float, float]:
    """Largest gap of the closed contact points, m, gap rate, m/s, and slip along a tangent that is drift, m/s."""
    rows = closed.decide().rows
    return rows.extremes.gap, rows.extremes.rate, rows.largest_slip(closed.modes.of(closed.contact_points).drifts)


def rows_to_project(closed: ClosedContacts) -> ClosedRows:
    """Rows of all closed contact points at the current state, as a projection needs them."""
    every = closed.decide().rows
    J = every.J.reshape(len(closed.contact_points), 3, -1)
    # Slip is not integrable: a ball that rolls is displaced without having slipped, so sticking points have no position row.
    sticking = J[closed.modes.of(closed.contact_points).drifts, 1:]
    return ClosedRows(every.gaps, every.rates, J[:, 0], sticking.reshape(-1, J.shape[2]))


def unit_wrenches(closed: ClosedContacts, which: BoolArray) -> FloatArray:
    """Wrenches about the world origin of unit forces on geom b, (m, 6), at some of the closed contact points, (k,).

    Along the normals, and at points whose slip is drift along two tangents.
    """
    points = [contact for contact, chosen in zip(closed.contact_points, which.tolist(), strict=True) if chosen]
    states = [contact.feature.at(closed.data) for contact in points]
    forces = [
        (state.point, along)
        for state, drifts in zip(states, closed.modes.of(tuple(points)).drifts.tolist(), strict=True)
        # Friction of sticking points on a fixed body takes momentum as well: what it may take is not kept.
        for along in (state.normal, *(tangents(state.normal) if drifts else ()))
    ]
    return np.array([np.concatenate((along, np.cross(point, along))) for point, along in forces]).reshape(-1, 6)


def first_change(closed: ClosedContacts, times_s: Sequence[float]) -> tuple[float, bool] | None:
    """First time in a step at which the active set or a feature is no longer valid.

    Args:
        closed: The closed contacts, with the active set chosen at the start of the step.
        times_s: Times since the start of the step at which it may be invalid, ascending.

    Returns:
        The time, located just after the zero crossing, and whether closed pairs touch there at a point that is not one of
        their contact points; None if all stays valid.
    """
    path = closed.motion.path

    def slack(time_s: float) -> float:
        if time_s <= 0.0:
            return 1.0  # the active set was chosen at this state, so it is valid there whatever the rounding
        path.move_to(time_s)
        # Points stick a little beyond the limit of friction. Those that leave it further behind are released at the limit.
        return closed.witness_value(exact=True)

    for invalid_s in times_s:
        path.move_to(invalid_s)
        # Here with the excess up to which points stick: a step that ends inside it has no event, although its root is at the
        # limit.
        if closed.witness_value() < 0.0:
            break
    else:
        return None
    changed = first_root(slack, invalid_s)
    path.move_to(changed)
    if closed.touches_elsewhere():
        return _landing_time(closed, changed), True
    return before_drift(closed, changed) if closed.pairs_with_drift() else changed, False


def before_drift(closed: ClosedContacts, reached_s: float) -> float:
    """Time in a step, s, at which it ends where a drift of the gap or its rate reaches its bound: a little before that.

    Drift is truncation: it grows as t^5, and its bound is no event of the motion. Where it is, rounding says to 1e-7 of the
    time only, and truncation of the step with it, which the motion amplifies. A time of so few digits is the same however
    the gap is rounded: in other poses of the pieces of a body, in other world axes, in a replay.
    """
    mantissa, exponent = math.frexp(reached_s)
    earlier_s = math.ldexp(math.floor(mantissa * _DRIFT_DIGITS) / _DRIFT_DIGITS, exponent)
    closed.motion.path.move_to(earlier_s)
    return earlier_s if closed.pairs_with_drift() else reached_s


def _landing_time(closed: ClosedContacts, seen_s: float) -> float:
    """Time at which the overlapping points of closed pairs touched.

    The detection threshold is a depth; an impact at that depth instead of at gap zero would change the energy.
    """
    overlapping, path = closed.overlapping_features(), closed.motion.path

    def gap(time_s: float) -> float:
        path.move_to(time_s)
        return min(feature.at(closed.data).gap for feature in overlapping)

    # A cap that falls flat has no other point below zero: its landing is where its rise was lost.
    if not overlapping:
        return seen_s
    # brentq needs a sign change. A point that rocks may have lifted off only after the start of the step.
    above = next((part * seen_s for part in (0.0, *_START_FRACTIONS) if gap(part * seen_s) > 0.0), seen_s)
    return just_after(gap, above, seen_s) if above < seen_s else seen_s


class ContactRows(NamedTuple):
    """Rows of closed contact points, in the coordinates of the motion.

    Attributes:
        J: Normals of all points, then tangents of those that stick, (n, nv).
        gamma: Rates at zero generalised acceleration, (n,).
        unilateral: Which rows are normals, along which forces push only, (n,).
        friction: Generalised forces of points that slide, (nv,).
    """

    J: FloatArray
    gamma: FloatArray
    unilateral: BoolArray
    friction: FloatArray


class PersistentContactModel(EventSource, ForceSource, Replayable):
    """Constrains the pairs that impacts leave closed; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    kind = "contact"
    records = (*PAIR_KINDS, *FRICTION_KINDS, *LIMIT_KINDS)
    # Contact forces answer all other loads, and are evaluated after these.
    order = ForceOrder.REACTIVE

    def __init__(
        self, scene: Scene, pairs: Sequence[UnilateralConstraint], overlap: DeepestOverlap, heat: FrictionHeat
    ) -> None:
        """Initialise with no closed contacts.

        Args:
            scene: The logged system and its data.
            pairs: Impact pairs, then joint limits; the impact model passes on those that an impact leaves closed, see
                :meth:`close`.
            overlap: Deepest overlap, shared with the impact model.
            heat: Heat of friction, shared with the impact model.
        """
        super().__init__(scene)
        self._pairs, self._closed = tuple(pairs), ClosedContacts(scene)
        self._broad_phase = BroadPhase(scene.system.mj, self._pairs)
        self._changes = ContactChanges(scene, self._closed)
        geoms, limits = by_kind(self._pairs)
        self._report = ContactReport(scene, geoms, self._closed)
        self._account = StepAccount(scene, self._closed, self._report.friction, heat, overlap)
        self._limits = LimitReport(scene, limits, self._closed)
        self._records = ChangeRecords(scene, self._closed, self._report, self._limits, self._changes)
        self._drift = DriftProjection(scene, self._closed)
        of_projections = self._drift.projection.columns if pairs else ()
        self.columns = (*self._report.columns, *self._limits.columns, *of_projections)
        self._previous: tuple[Motion, tuple[str, ...], frozenset[frozenset[int]]] | None = None
        self._landing, self._resumes = False, False
        self._located_s: float | None = None
        self._dip_s = 0.0

    @dataclass
    class State:
        """Closed contacts, which of them have a logged start, what their columns say, and projections."""

        closed: Any
        logged: list[str]
        contacts: Any
        limits: Any
        friction: Any
        projection: Any

    def get_state(self) -> State:
        """The closed contacts."""
        logged = [pair.name for pair in self._changes.logged]
        parts = self._report, self._limits, self._report.friction, self._drift.projection
        return self.State(self._closed.get_state(), logged, *(part.get_state() for part in parts))

    def set_state(self, state: Any) -> None:
        """Close contacts at the state in ``data``, with the motion of that state."""
        values = entries(state, self.State)
        by_name = {pair.name: pair for pair in self._pairs}
        self._changes.logged = [by_name[name] for name in values["logged"]]
        self._report.set_state(values["contacts"])
        self._limits.set_state(values["limits"])
        self._report.friction.set_state(values["friction"])
        self._drift.projection.set_state(values["projection"])
        self._closed.set_state(values["closed"], by_name)
        self._landing, self._located_s = False, None
        # A state that was saved at the end of a step keeps its forces: an event there has them as the forces before it.
        self._resumes = entries(values["closed"], ClosedContacts.State)["in_step"]
        self._set_activity()

    def forget(self) -> None:
        """No contact is closed."""
        for pair in tuple(self._closed.by_pair):
            self._closed.remove(pair)
        self._closed.set_pressing(())
        self._closed.modes.clear()
        self._changes.logged, self._previous = [], None
        self._set_activity()

    def bind(self, motion: Motion) -> None:
        """Use another motion, or other grasps: contacts stay closed, except pairs whose geoms are on one rigid body in it.

        A pair that was on one rigid body before, as when an object is released, becomes closed if its geoms touch at rest.
        """
        super().bind(motion)
        self._closed.bind(motion)
        by_pair = dict(self._closed.by_pair)
        for pair in by_pair:
            # Geoms of one rigid body cannot part: they are no contact while the grasp that joins them is closed.
            if pair.geom_ids in motion.disabled:
                self._closed.set_points(pair, ())
        before, self._previous = self._previous, (motion, motion.grasps, motion.disabled)
        if before is not None and before != self._previous:
            touching = closed_pairs(self._broad_phase, self.scene, motion, {})
            for pair, patches in patches_by_pair(closed_after_change(touching, by_pair)).items():
                self._update_pair(pair, patches)
                # Features are determined anew: where the old points stick the slip of the new ones is drift, not motion.
                self._closed.modes.replace(by_pair.get(pair, ()), self._closed.by_pair.get(pair, ()))
        self._update_activity()
        self._closed.update_pressing()  # a pair of the previous active set may be on one rigid body in this motion

    def restart(self) -> None:
        """Discard the forces of the last step: the state or the efforts changed discontinuously.

        Where a run goes on from the end of a step, those that have just been evaluated are the forces there.
        """
        if not self._resumes:
            self._closed.stages.clear()
        self._resumes = False

    def holds(self, pair: UnilateralConstraint) -> bool:
        """Whether a pair is closed; see ``PersistentContacts`` in ``contact_models/impact``."""
        return pair in self._closed.by_pair

    def close(self, touching: ClosedPairs, *, struck: bool) -> None:
        """Close the pairs in contact whose normal velocity is zero at the velocities in ``data``.

        Args:
            touching: The pairs in contact.
            struck: Whether an impact has just changed the velocities; without one, pairs that are closed drift as in a step.
        """
        # An impact leaves its contacts normal velocities of rounding, as a share of the speed at which they met.
        approach = max((-near.rate for _, near in touching), default=0.0)
        closed_before = set(self._closed.by_pair)
        now = [(pair, pair.at_velocities(self.scene.data, near)) for pair, near in touching]
        closing = (
            (pair, near, closed_rate_tolerance(near) if drifts else rate_tolerance(near, max(approach, 0.0)))
            for pair, near in now
            for drifts in (not struck and pair in closed_before,)
        )
        for pair, patches in patches_by_pair(closing).items():
            self._update_pair(pair, patches)
        self._closed.keep_slow_points([(pair, near) for pair, near in now if pair in closed_before])
        # The impact has changed the slips, on which sticking and sliding depend.
        self._closed.modes.struck = True
        self._update_activity()

    def _close_logged(self, records: Sequence[Any]) -> None:
        """Close the pairs named by logged records that are in contact but not yet closed: no impact did so."""
        self.scene.numbers.continue_from(records[0].event)
        if set(map(name_of, records)) - {pair.name for pair in self._closed.by_pair}:
            pushed = self.active
            self.close(closed_pairs(self._broad_phase, self.scene, self.motion, {}), struck=False)
            # A step without contact has not evaluated the load that contacts now have to answer.
            if not pushed:
                self._closed.see_other_forces()

    def replay(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce a logged event in the modes before it."""
        recall_points({pair.name: pair for pair in by_kind(self._pairs)[0]}, event.records, self.scene.data)
        self._changes.restore_before(event)
        # Before the event is applied: afterwards the modes, and the forces before it, are gone.
        accuracy = RecordAccuracy(self._closed)
        self._close_logged(event.records)
        effect = super().replay(event)
        self._closed.opens = False
        return effect._replace(accuracy=accuracy.fields(effect.records)) if effect is not None else None

    def refusal(self, _: UnilateralConstraint) -> str:
        """Why a pair cannot stay in contact; empty if it can."""
        return refusal_in(self.motion, self.scene)

    def _update_pair(self, pair: UnilateralConstraint, patches: Sequence[tuple[Proximity, float]]) -> None:
        at_rest = [(near, still) for near, still in patches if closed_and_still(near, still)]
        if at_rest and not self.refusal(pair):
            self._closed.add_closed(pair, at_rest)
        elif self.holds(pair):
            # It stays listed without points until its end is logged: columns and records would not agree otherwise.
            self._closed.set_points(pair, ())

    def _update_activity(self) -> None:
        """Be active while any pair is closed; a pair stays listed until its logged start has a logged end."""
        for pair in [
            pair
            for pair, contact_points in self._closed.by_pair.items()
            if not contact_points and pair not in self._changes.logged
        ]:
            self._closed.remove(pair)
        self._set_activity()

    def _set_activity(self) -> None:
        self.active = bool(self._closed.by_pair)
        # No bound on the motion excludes a change of the active set, which depends on forces: check every step.
        self.event_bound = -math.inf if self.active else math.inf
        if not self.active:
            self._closed.set_pressing(())

    def restore_state(self, events: Sequence[LoggedEvent] = ()) -> None:
        """Find the closed contacts at the state in ``data``; the last record lists those with a logged start."""
        for pair in tuple(self._closed.by_pair):
            self._closed.remove(pair)
        geoms, closed_rules = by_kind(self._pairs)[0], self._report.closed_rules()
        self._changes.logged = [*listed_pairs(events, geoms, closed_rules), *self._limits.logged_limits()]
        # Records may be lost with a damaged part of the log: columns then say of which rules pairs are closed.
        listed = {pair.rule for pair in self._changes.logged if isinstance(pair, ContactPair)}
        unlisted = closed_rules - listed
        near_pairs = [self._pairs[i] for i in self._broad_phase.within(self.scene.data, CLEARLY_APART_M)]
        closed_before = [pair for pair in near_pairs if pair in self._changes.logged or pair.rule in unlisted]
        for pair, patches in patches_by_pair(closed_at(self.scene, near_pairs, closed_before)).items():
            self._update_pair(pair, patches)
        self._changes.logged += [pair for pair in self._closed.by_pair if pair.rule in unlisted]
        self._update_activity()

    def due(self) -> bool:
        """Whether a contact begins, ends or changes at the state in ``data`` under the efforts of the next step."""
        if not self.active or ((self._closed.steady.holds() or self._closed.is_settled()) and not self._changes.unlogged()):
            return False
        return bool(self._changes.left_at_once() or self._changes.pending() or self._closed.touches_elsewhere())

    def begin_step(self, left_s: float, *, continues: bool = False) -> float:
        """Start a (sub-)step: project out the drift of closed contacts, and choose the active set.

        One that continues goes on with the active set and the modes of the step before, without projection.

        Raises:
            RunEnded: No friction modes are possible.
        """
        self._account.projected = None
        if continues:
            self._closed.stages.clear()
            return left_s
        self._located_s = None
        for pair in self._closed.by_pair:
            self._closed.join(pair)
        # In a steady state the active set and the modes of the step before hold on: nothing is decided anew.
        if not self._closed.steady.goes_on():
            # In this order: points that are released still count as sticking when drift is projected out, and slip from then
            # on. Taken as slip, their drift would give friction a direction of rounding.
            self._account.projected = self._drift.remove_drift()
            self._closed.settles = False
            self._closed.update_pressing()
            self._closed.modes.begin_slip()
            self._closed.stages.clear()
        return self._closed.plan_step(left_s)

    def begin_steady_steps(self) -> SteadyContacts | None:
        """Closed contacts, if they may be steady; see :class:`ForceSource`."""
        # A beginning is logged first, with the forces at this state.
        if self._changes.unlogged():
            return None
        self._located_s, self._account.projected = None, None
        return self._closed.steady

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores the friction modes, which the start of a step chooses."""
        return self._closed.modes.snapshot()

    def is_clear(self) -> bool:
        """Whether the active set and the features of the step's start are valid at its end, and its forces within it."""
        if not self.active:
            return True
        # Valid at both ends does not mean valid between: a force may leave its bounds and return (dip in _core/stages.pyx).
        self._dip_s = self._closed.dip_s()
        return not self._dip_s and (self._closed.steady.holds() or self._closed.witness_value() >= 0.0)

    def first_event(self, duration_s: float) -> float | None:
        """Time at which the active set or a feature ceased to be valid, located just after the zero crossing."""
        # An event of another source may have cut the step before the dip.
        dips = (self._dip_s,) if 0.0 < self._dip_s < duration_s else ()
        located = first_change(self._closed, (*dips, duration_s))
        if located is None:
            return None
        self._located_s, self._landing = located
        return self._located_s

    def on_event_located(self, time_s: float) -> None:
        """Note whether the event, if it is one of this model, is that sticking points reach the limit of friction."""
        reached = self._located_s is not None and time_s >= self._located_s
        # The event of another source may come first: the landing is then still ahead, and found again in the next step.
        self._landing = self._landing and reached
        if reached and not self._landing:
            self._closed.note_release()

    def names(self) -> str:
        """The closed pairs."""
        return "; ".join(str(pair) for pair in self._closed.by_pair)

    def push(self, data: Any) -> None:
        """Add the contact forces; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""
        self._closed.steady.push(data)

    def wrenches(self, data: Any) -> Sequence[Wrench]:  # noqa: ARG002
        """Contact forces on the bodies under the efforts in ``data``, from a new active set."""
        return self._report.wrenches()

    def add_forces(self, applied: FloatArray) -> None:
        """Add the generalised contact forces and those of joint limits; see :class:`ForceSource`."""
        super().add_forces(applied)
        # The wrenches of the base class leave out limits, which act along a joint.
        self._limits.add_forces(applied)

    def end_step(self, duration_s: float, *, trial: bool = False) -> Exchange | None:
        """Energy and momentum exchanged by the contact forces, and by the drift projection at the start of the step."""
        if trial:
            done, _ = self._account.exchanged(duration_s)
            return None if done is None else done._replace(friction_J=self._account.work_without_heat(duration_s))
        steady = self._account.of_steady_step(duration_s)
        if steady is not None:
            return steady
        done, impulses = self._account.exchanged(duration_s)
        self._report.add_impulses(impulses)
        self._limits.add_impulses(impulses)
        self._account.add_friction()
        self._account.add_overlap()
        return done

    def catch_up(self) -> str:
        """Drop limits that are left at once, and name the records of a change that is due; see :class:`Replayable`."""
        self._drop(self._changes.left_at_once())
        change = self._changes.pending() if self.active else None
        return change[0].name if change else ""

    def varied_forces(self) -> Iterator[None]:
        """Turn each slip and each tilt by its rounding; see :class:`Replayable`."""
        return varied_forces(self._closed)

    def force_check(self, layout: Layout) -> ForceCheck:
        """Check of the logged contact forces by other functions; see :mod:`.force_check`."""
        return ForceCheck(self.scene, self._pairs, self._closed, layout)

    def contact_rows(self) -> ContactRows | None:
        """Rows of the closed contact points at the state in ``data`` without any force along them; None: there are none.

        Friction of points that slide is that of the present decision.
        """
        if not self._closed.contact_points:
            return None
        rows, modes = (
            # Without closed loops: joint friction takes these out itself, but not the joints at rest, on which it decides.
            self._closed.solver.evaluator(self._closed.contact_points).rows(),
            self._closed.modes.of(self._closed.contact_points),
        )
        J, gamma = rows.J.reshape(len(self._closed.contact_points), 3, -1), rows.gamma.reshape(-1, 3)
        # Friction of sliding points has a size and a direction: it is a load on what dry friction holds, no row.
        friction = np.zeros(J.shape[2])
        if modes.any_sliding:
            along = np.einsum("kij,kj->ki", rows.axes[:, 1:], self._closed.decide().friction)
            friction += np.einsum("ki,kid->d", along[modes.sliding], J[modes.sliding, 1:])
        sticks = modes.drifts
        every = np.concatenate((J[:, 0], J[sticks, 1:].reshape(-1, J.shape[2])))
        rates = np.concatenate((gamma[:, 0], gamma[sticks, 1:].ravel()))
        return ContactRows(every, rates, np.arange(len(every)) < len(J), friction)

    def active_contacts(self) -> tuple[ActiveContact, ...]:
        """The closed pairs with their forces, for control laws."""
        return self._report.active()

    def act(self, instant: EventTime) -> EventEffect | None:
        """Log a contact that begins, ends or changes; a closed pair that touches at another point has an impact."""
        # Another point of a closed pair lands at a speed: impulses at that point act on those that are closed, too.
        if self._landing or self._closed.touches_elsewhere():
            self._landing = False
            return EventEffect((), leaves_to_impacts=True)
        left = self._changes.left_at_once()
        self._drop(left)
        # Limits that are left at once are found before a step: no step has changed the modes of the others.
        news = self._changes.pending() or (None if left else self._changes.during_step())
        if news is None:
            return None
        kind, pairs = news
        records = self._records.of(kind, pairs, instant, lambda: self._apply(kind, pairs))
        # The law is evaluated at ticks and impacts (docs/persistent-contact.md): here forces change, and no velocity.
        return EventEffect(records, triggers_control=False)

    def _apply(self, kind: RecordKind, pairs: Sequence[UnilateralConstraint]) -> None:
        self._changes.apply(kind, pairs)
        self._update_activity()

    def _drop(self, limits: Sequence[JointLimit]) -> None:
        """Remove limits without a record."""
        for limit in limits:
            self._closed.remove(limit)
        if limits:
            self._update_activity()
