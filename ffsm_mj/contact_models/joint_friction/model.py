"""Dry friction of joints and tendons: Coulomb's law in one coordinate, exact, integrated event by event.

A joint slides, with a friction of constant size against its rate, or sticks, with whatever friction within its limit keeps
its acceleration at zero. Which of the two is fixed within a step, so that each step integrates a smooth ODE at the full
order of RK4. A sliding joint exerts a constant force on a line, which no step size makes unstable; a sticking one is a row
that is held in the stages (:mod:`ffsm_mj.dynamics.loops.closed_loops`) after all other forces are known.

What is said of joints here is true of tendons, whose coordinate is the length: its row may depend on the configuration.

A step ends where a joint that slides comes to rest, or where the friction that holds one reaches its limit. There the
accelerations of those at rest follow from a problem with one solution (:mod:`.decision`), as where efforts change. Where
the limit is reached the acceleration is zero from both sides: a joint breaks away because the force that holds it is about
to exceed the limit, not because it accelerates, and slides against that force.

An impact does not see friction: a bounded force has no impulse. A joint that sticks is moved by it like any other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.stages import Smooth
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.interface import (
    EventEffect,
    EventSource,
    EventTime,
    ForceSource,
    LoggedEvent,
    Replayable,
    Scene,
    event_fields,
    first_root,
)
from ffsm_mj.contact_models.joint_friction.coordinates import CoordinatesOfMotion, FrictionCoordinates
from ffsm_mj.contact_models.joint_friction.decision import RestRows, Senses, decided, least_use
from ffsm_mj.contact_models.joint_friction.record import HEAT_SIGNALS, STICK_SLIP, StickSlipRecord, friction_signals
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.contact_models.state_projection import sum_exchanges
from ffsm_mj.dynamics.loops.closed_loops import MassWeightedRows
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.records.columns import Columns
from ffsm_mj.state import entries, fitting
from ffsm_mj.tolerances import CLOSED_RATE, EVENT_TIME, EVENT_TIME_S, INSTANT_S, MODE_STEP, RATE

_ROUNDING = 1e-15
"""Rates within this share of (1 + the largest rate) are zero to rounding: where a joint sticks, or has just stopped."""
_BEYOND = 1e-14
"""A friction that exceeds its limit by this share has reached it: some roundings."""
_IDLE = 2.0
"""State in the log of a joint that sticks and whose friction is idle, as contacts block it."""
_NEAR_LIMIT = MODE_STEP**2 / 8.0
"""Where less than this share of a limit is left at the end of a step, its middle is looked at too: a load that swings with a
frequency w exceeds that at both ends by the share (h w)^2 / 8 in between, of the fastest mode of a step by this."""
_BRIEF_S = 100.0 * INSTANT_S
"""A joint that its friction stops within this is at rest where a step begins: the energy that it has left becomes heat at
once. The stop of a joint with an absurd friction, at 1e10 m/s^2, cannot be resolved by times that are rounded to 1e-16 s."""
_REACHED = 1e-10
"""At an event, a friction this close to its limit, as a share, has reached it: joints that are alike break away together."""


class JointFriction(EventSource, ForceSource, Replayable):
    """Dry friction of all joints and tendons of a scene; see :class:`~ffsm_mj.contact_models.interface.EventSource`.

    It must stand before its ``loops`` among the sources, which then hold the joints that it has found to stick.

    Attributes:
        loops: Forces on the rows of the joints that stick, with those of closed loops.
        senses: Sense in which each joint slides, -1 or 1; 0: it sticks, (k,).
    """

    kind = "joint_friction"
    records = (STICK_SLIP,)
    event_bound = -math.inf  # no bound on the motion excludes that a force reaches its limit
    active = True

    @dataclass
    class State:
        """Senses of the joints, and heat of (total, robot, objects) since t = 0, J."""

        senses: FloatArray
        heat_J: FloatArray

    def __init__(
        self, scene: Scene, coordinates: FrictionCoordinates, contacts: PersistentContactModel, others: Sequence[ForceSource]
    ) -> None:
        """Start with all joints at rest: which of them slide is decided when the first step begins.

        Args:
            scene: The logged system and its data.
            coordinates: The joints and tendons with friction.
            contacts: Persistent contact.
            others: All other sources of forces.
        """
        super().__init__(scene)
        self._on, self._others, self._contacts = coordinates, tuple(others), contacts
        # Rows at rest are held under all other forces, so contacts, which answer these, and their friction must be known
        # first.
        self.loops = LoopForces(scene, (contacts, *others, self), rubs=True)
        count = len(coordinates.names)
        self.senses, self._friction, self._heat = np.zeros(count), np.zeros(count), np.zeros(3)
        self._rest_rows = np.eye(count)
        self._rest: BoolArray = np.ones(count, dtype=np.bool_)
        self._shown = np.zeros(count)
        self._at_start: Exchange | None = None
        self._verified: object = None
        self._suspects: list[float] = []
        self._any_sliding = False
        signals = [friction_signals(*coordinate) for coordinate in zip(coordinates.names, coordinates.units, strict=True)]
        self.columns = (
            Columns(tuple(one for one, _ in signals), live=self._shown, on_sample=self._sample, resume=self._resume),
            Columns(tuple(other for _, other in signals), live=self._friction),
            Columns(HEAT_SIGNALS, live=self._heat, resume=self._resume_heat),
        )

    # ---- State

    def get_state(self) -> State:
        """Senses and heat."""
        return self.State(self.senses.copy(), self._heat.copy())

    def set_state(self, state: Any) -> None:
        """Go on from a state; that of the motion is in its data."""
        values = entries(state, self.State)
        self._heat[:] = fitting(values["heat_J"], (3,), "JointFriction")
        self._set(Senses.without_contacts(fitting(values["senses"], self.senses.shape, "JointFriction")))

    def forget(self) -> None:
        """All joints are at rest, as before the first step."""
        self._heat.fill(0.0)
        self._resume(np.zeros_like(self.senses))

    def _resume(self, logged: FloatArray) -> None:
        # Whether contacts leave a friction idle is decided anew at the state: the column only says that the joint sticks.
        self._set(Senses.without_contacts(np.where(logged == _IDLE, 0.0, np.sign(logged))))

    def _resume_heat(self, logged: FloatArray) -> None:
        self._heat[:] = logged

    def _set(self, senses: Senses) -> None:
        """Let joints slide, stick, and be left to the contacts that block them."""
        self.senses[:], self._rest_rows, self._verified = senses.slides, senses.at_rest, None
        self._any_sliding, self._rest = bool(np.any(senses.slides)), np.asarray(senses.at_rest.any(axis=0))
        self._shown[:] = np.where(senses.idle, _IDLE, senses.slides)
        self.loops.keep_at_rest([self._on.at_rest(row) for row in senses.at_rest])

    def bind(self, motion: Motion) -> None:
        """Use another motion: joints slide or stick in it as before."""
        super().bind(motion)
        self._smooth, self._verified = Smooth(motion, self.scene.data), None
        self._moved = CoordinatesOfMotion(self._on, motion)

    def restart(self) -> None:
        """Decide anew: the state or the efforts changed discontinuously."""
        self._verified = None

    def on_records(self, records: Sequence[Any]) -> None:
        """Forget in which sense joints at rest begin to slide: what an impact or a contact stops is decided on anew."""
        if records and not isinstance(records[0], StickSlipRecord):
            self._set(Senses.without_contacts(np.where(self._slow(), 0.0, self.senses)))

    def names(self) -> str:
        """The joints that stick, or all of them."""
        stuck = [joint for joint, sense in zip(self._on.names, self.senses, strict=True) if not sense]
        return f"dry friction of {', '.join(stuck or self._on.names)}"

    # ---- Forces

    def push(self, data: Any) -> None:
        """Add the friction of the joints that slide; that of the others is held by ``loops``."""
        self.add_forces(data.qfrc_applied)
        self._moved.add_stage()

    def add_forces(self, applied: FloatArray) -> None:
        """Add the same to generalised forces, (nv,) of the motion."""
        if self._any_sliding:
            self._moved.add(applied, -self._on.limits * self.senses)

    def _other_forces(self) -> FloatArray:
        """Applied generalised forces of other sources at the state and efforts in ``data``, (nv,)."""
        applied = np.zeros(self.motion.model.nv)
        for other in self._others:
            if other.active:
                other.add_forces(applied)
        return applied

    def begin_step(self, left_s: float, *, continues: bool = False) -> float:
        """Decide which joints stick, and stop those exactly; steps that continue go on with them."""
        self._at_start = None
        if continues:
            self._moved.begin_step()
            return left_s
        self._decide()
        rates = self._moved.rates()[self.senses == 0.0]
        # A rate that is kept creeps; one of rounding comes back with every step, and a projection would not end it.
        if rates.any() and np.abs(rates).max() > _ROUNDING * (1.0 + np.abs(self.motion.data.qvel).max()):
            self._at_start = self._stop(self.senses == 0.0)
        self._moved.begin_step()
        return self._longest_step(left_s)

    def _longest_step(self, left_s: float) -> float:
        """Longest step in which forces of tendons that slide turn little: a huge friction makes a whole one wild."""
        if not (self._any_sliding and self._moved.moving.any()):
            return left_s
        # The turn of a row under its force acts as a stiffness: steps follow it as they do springs (MODE_STEP).
        rate = self._moved.turning_rate(self._on.limits * self.senses)
        return min(left_s, MODE_STEP / rate) if rate > 0.0 else left_s

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores which joints slide."""
        senses = Senses(self.senses.copy(), self._rest_rows)

        def restore() -> None:
            self._set(senses)

        return restore

    def end_step(self, duration_s: float, *, trial: bool = False) -> Exchange:
        """Heat of the step, which the system loses; unless it is a trial, it is added to the columns.

        It is friction times the way, which is exact, as the rate has one sign and the friction one size.
        """
        heat = (
            self._on.limits * self.senses * self._moved.ways(duration_s) if self._any_sliding else np.zeros(len(self.senses))
        )
        # A joint rubs within its tree, whose energy becomes the heat.
        done = sum_exchanges(self._at_start, self._by_subsystem(self._on.of_trees @ -heat))
        if not trial:
            self._heat -= done.energy_J
        return done

    def _by_subsystem(self, of_trees: FloatArray) -> Exchange:
        """Energy that trees gain, J, (number of trees,), as an exchange."""
        grasped, total, of_robot = self.motion.grasped_object, float(of_trees.sum()), float(of_trees[0])
        if grasped is not None:  # a grasped object counts with the robot, see ffsm_mj/balance/exchange.py
            of_robot += float(of_trees[1 + self.scene.system.objects.index(grasped)])
        return Exchange(np.array((total, of_robot, total - of_robot)), np.zeros(6))

    # ---- Decisions

    def _slow(self) -> BoolArray:
        """Joints whose rate is zero to rounding, or that their friction stops within an instant, (k,).

        The row of a spatial tendon that sticks changes within a step: its rate drifts by the truncation of the stages, until
        the next step begins.
        """
        scale = 1.0 + np.abs(self.motion.data.qvel).max()
        drifts = np.where(self._moved.moving & (self.senses == 0.0), CLOSED_RATE, RATE)
        brief = _BRIEF_S * self._on.limits * self._moved.mobilities()
        return np.asarray(np.abs(self._moved.rates()) <= drifts * scale + brief)

    def _sample(self, _: float) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        self._decide()
        self._write_friction()

    def _write_friction(self) -> None:
        self._friction[:] = -self._on.limits * self.senses
        if self._rest.any():
            self._friction[self._rest] = self._holds()

    def _holds(self) -> FloatArray:
        """Friction on the joints that stick, at the state in ``data`` under its efforts."""
        loops, applied = self.motion.loops, self._other_forces()
        assert loops is not None
        if self._contacts.active:
            self._contacts.add_forces(applied)
        self.add_forces(applied)
        # The friction of a joint at rest is what holds its row under all other forces, those of contacts included.
        loops.generalised(self._smooth.force(applied))
        return self._shared()

    def _decide(self) -> None:
        """Decide which joints slide at the state in ``data`` under its efforts, unless the last step has verified that."""
        others = self._other_forces()
        state = self._smooth.state(others)
        if state is self._verified:
            return
        before = self.senses.copy()
        self._set(self._decided(others, self.senses))
        if self._contacts.active and not np.array_equal(self.senses, before):
            self.motion.refresh_forces()  # contacts decide on what carries force under the friction of joints that slide now
        self._verified = state

    def _decided(self, others: FloatArray, before: FloatArray, stops: BoolArray | None = None) -> Senses:
        """Which joints slide from the state in ``data`` on.

        Args:
            others: Applied forces of other sources than contacts, (nv,).
            before: Senses in which joints that are at rest begin to slide; 0: it is to be found, (k,).
            stops: Joints whose rate has just been found to pass zero; None: there are none, (k,).
        """
        slow, motion = self._slow(), self.motion
        if stops is not None:
            # An event finds the rate just past its root, by more than rounding where the joint decelerates fast.
            slow = slow | stops
        # Friction opposes the rate of a joint that moves: only at rest is there anything to decide.
        senses = np.where(slow, before, np.sign(self._moved.rates()))
        if not slow.any():
            return Senses.without_contacts(senses)
        L = np.linalg.cholesky(mass_matrix(motion.model, motion.data))
        contacts = self._contacts.contact_rows()
        if contacts is not None:
            # Friction of sliding contacts is mu N of the present decision: a load, as its size is not free.
            others = others + contacts.friction
        free, limits = self._free_acceleration(others), self._on.limits

        def weighted(J: FloatArray, gamma: FloatArray, low: FloatArray, high: FloatArray) -> RestRows:
            W = np.linalg.solve(L, motion.constrained(J).T).T
            return RestRows(W, J @ free + gamma, low, high, np.sum(np.linalg.solve(L, J.T) ** 2, axis=0))

        of_joints = weighted(self._moved.rows(), self._moved.second_rates(), -limits, limits)
        of_contacts = None
        if contacts is not None:
            endless = np.full(len(contacts.gamma), np.inf)
            # Tangents of sticking points may push and pull here; whether they stay inside their cones the contacts decide,
            # under the friction that is chosen now.
            of_contacts = weighted(contacts.J, contacts.gamma, np.where(contacts.unilateral, 0.0, -endless), endless)
        return decided(of_joints, of_contacts, slow, senses)

    def _free_acceleration(self, others: FloatArray) -> FloatArray:
        """Acceleration without dry friction, with the rows of loops held, (nv,)."""
        motion, a = self.motion, np.empty(self.motion.model.nv)
        force = self._smooth.force(others)
        mujoco.mj_solveM(motion.model, motion.data, a[None], force[None])
        if motion.loops is not None and motion.loops.sources:
            rows = motion.loops.rows()
            a += motion.loops.weighted().change(rows.J @ a + rows.gamma)
        return a

    # ---- Events

    def is_clear(self) -> bool:
        """Whether no joint has come to rest, and no friction has exceeded its limit, in the last step."""
        self._suspects = []
        if min(self._margins()) >= 0.0:
            self._suspects = self._doubtful_times(float(self.motion.data.time) - float(self.motion.path.start[0]))
            if not self._suspects:
                self.after_replayed_step()
                return True
        return False

    def _margins(self) -> tuple[float, float]:
        """Margins at the state of the last evaluation: negative where a joint turns back, and where one breaks away.

        The least rate along the sense of a joint that slides, and the least share that is left of the limit of one that
        sticks.
        """
        turns, breaks, sliding = math.inf, math.inf, self.senses != 0.0
        if self._any_sliding:
            rounding = _ROUNDING * (1.0 + float(np.abs(self.motion.data.qvel).max()))
            turns = float((self.senses * self._moved.rates())[sliding].min()) + rounding
        if self._rest.any():
            # As a share of the limit: those of joints and tendons differ in unit and by orders of magnitude.
            breaks = 1.0 + _BEYOND - float((np.abs(self._shared()) / self._on.limits[self._rest]).max())
        return turns, breaks

    def _shared(self) -> FloatArray:
        """Friction on the joints that stick by it, at the state of the last evaluation.

        Where rows depend on each other, as of two coupled joints that both stick, its shares are not determined: they are
        those of least norm, or, where one of these exceeds its limit, those that use the limits least.
        """
        loops, limits = self.motion.loops, self._on.limits[self._rest]
        assert loops is not None
        rows = self._rest_rows[:, self._rest]
        holds = loops.holds @ rows
        # Shares of least norm are a convention: one beyond its limit lets nothing break away while other shares hold.
        if np.all(np.abs(holds) <= limits) or not (idle := loops.idle).any():
            return holds
        return least_use(holds, idle @ rows, limits)

    def _doubtful_times(self, duration_s: float) -> list[float]:
        """Times within the step at which a margin may be negative although it is positive at its end."""
        times = []
        if self._any_sliding:
            # The parabola through the rates at both ends with the way between them is as good as the step; where its vertex
            # is below zero inside, the joint may have stopped and gone on.
            u0, u1 = self.senses * self._moved.start_rates, self.senses * self._moved.rates()
            way = self.senses * self._moved.ways(duration_s) / duration_s
            bend, slope = 3.0 * (u0 + u1 - 2.0 * way), 6.0 * way - 4.0 * u0 - 2.0 * u1
            inside = (slope < 0.0) & (slope + 2.0 * bend > 0.0)
            vertex = -0.5 * slope / np.where(inside, bend, 1.0)
            low = inside & (u0 + 0.5 * slope * vertex < 0.0) & (u0 > _ROUNDING)
            times += (duration_s * vertex[low]).tolist()
        if self._margins()[1] < _NEAR_LIMIT:
            times.append(0.5 * duration_s)
        return times

    def first_event(self, duration_s: float) -> float | None:
        """Time at which the first joint comes to rest or breaks away, just after the root."""
        path = self.motion.path

        def margin(time_s: float) -> float:
            if time_s <= 0.0:
                return 1.0  # it was decided at this state
            path.move_to(time_s)
            return min(self._margins())

        # The earliest of them: from the start to it the margin changes its sign, though it may rise again before the end.
        ends = [time_s for time_s in (*sorted(self._suspects), duration_s) if time_s <= duration_s and margin(time_s) < 0.0]
        return first_root(margin, ends[0]) if ends else None

    def act(self, instant: EventTime) -> EventEffect | None:
        """Stop joints that come to rest, let those slide whose limit is reached, and decide on all that are at rest."""
        before, qvel_before = self.senses.copy(), self.scene.data.qvel.copy()
        slow, others = self._slow(), self._other_forces()
        stops = (before != 0.0) & (before * self._moved.rates() <= 0.0)
        if slow.any() and (before[slow] != 0.0).any():
            # Joints that are alike come to rest together, to rounding.
            a = self._moved.rows() @ self.motion.data.qacc + self._moved.second_rates()
            stops |= slow & (before * a < 0.0)
        holds = np.zeros(len(before))
        if self._rest.any():
            holds[self._rest] = self._holds()
        # Of coupled joints all that use as much of their limits as the first one break away with it.
        breaks = self._rest & (np.abs(holds) >= (1.0 - _REACHED) * self._on.limits)
        if not (stops.any() or breaks.any()):
            return None
        # At the limit the acceleration is zero and its sign rounding: a joint slides against the friction that held it.
        forced = np.where(breaks, -np.sign(holds), np.where(stops, 0.0, before))
        self._set(self._decided(others, forced, stops))
        # Where the length of a tendon is extreme its row vanishes, and its rate passes zero while its joints move on: these
        # must not be stopped.
        passes = self._moved.moving & (before != 0.0) & (self.senses != 0.0)
        exchange = self._stop((stops | (before == 0.0)) & ~passes)
        self._heat -= exchange.energy_J
        self._write_friction()
        changed = stops | breaks | (self.senses != before)
        shared, values = event_fields(self.scene, instant, qvel_before), self._moved.values()
        records = tuple(
            StickSlipRecord(
                joint=self._on.names[i],
                unit=self._on.units[i],
                value=float(values[i]),
                sense_before=int(before[i]),
                sense_after=int(self.senses[i]),
                friction_after=float(self._friction[i]),
                **shared,
            )
            for i in np.flatnonzero(changed).tolist()
        )
        # A rate is what an acceleration makes of the rounding of the time.
        rounding = float(np.abs(self.motion.data.qacc).max()) * (EVENT_TIME_S + EVENT_TIME * instant.time_s)
        accuracy = dict.fromkeys(("qvel_before", "qvel_after"), rounding)
        return EventEffect(records, exchange, triggers_control=False, accuracy=accuracy)

    def _stop(self, which: BoolArray) -> Exchange:
        """Set the rates of some joints to zero, by the least change of velocities, which conserves momentum.

        Returns:
            The energy that this takes, which is heat: the root of a rate is found to the rounding of the time alone.
        """
        motion, system = self.motion, self.scene.system
        before = self.scene.data.qvel.copy()
        rows = self._moved.rows()[which]
        if motion.loops is not None and motion.loops.sources:
            # With the rows of loops: to stop a joint alone would tear them.
            rows = np.concatenate((motion.loops.rows().J, rows))
        weighted = MassWeightedRows(mass_matrix(motion.model, motion.data), rows)
        motion.data.qvel[:] += weighted.change(rows @ motion.data.qvel)
        self._moved.stop(which)
        mujoco.mj_forward(motion.model, motion.data)
        motion.path.on_event_located()
        motion.stepper.account(0.0)
        now, momentum = self.scene.data.qvel, np.empty(system.mj.nv)
        mujoco.mj_mulM(system.mj, self.scene.data, momentum, now - before)
        # The difference of two kinetic energies as a product: it does not lose the digits in which they agree.
        gained = 0.5 * momentum * (now + before)
        return self._by_subsystem(np.array([gained[tree.dofs].sum() for tree in system.trees]))

    # ---- Replay

    def after_replayed_step(self) -> None:
        """Note that the senses are those at the state in ``data`` under its efforts.

        With closed contacts what these carry is found anew for every step: a contact that carried nothing may carry a load.
        """
        self._verified = None if self._contacts.active else self._smooth.state(self._other_forces())

    def restore_state(self, events: Sequence[LoggedEvent] = ()) -> None:  # noqa: ARG002
        """Decide at the state in ``data``, from where the columns know in which sense joints begin to slide."""
        self._verified = None
        self._decide()

    def replay(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce a logged event, with its number."""
        self.scene.numbers.continue_from(event.records[0].event)
        return super().replay(event)

    def record_fault(self, records: Sequence[Any]) -> str:
        """Whether a record names a joint or tendon without dry friction."""
        return "" if all(record.joint in self._on.names for record in records) else "joint"
