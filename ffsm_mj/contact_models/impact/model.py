"""Impacts of pairs and at joint limits as a contact model: detect, resolve, change the velocities, record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact.patch import manifold_name
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat, RuleGaps
from ffsm_mj.contact_models.impact.records import IMPACT, LIMIT_IMPACT, LimitImpactRecord
from ffsm_mj.contact_models.impact.replayed_impact import (
    APART,
    apart,
    impact_fault,
    logged_impact,
    moved_points,
    rounded_rates,
)
from ffsm_mj.contact_models.impact.resolution import (
    ClosedPairs,
    Impact,
    LimitContact,
    PersistentContacts,
    as_contact,
    contact_points,
    recall_points,
    resolve,
)
from ffsm_mj.contact_models.impact.rest_rule import RestingResult, RestRule, resolve_resting
from ffsm_mj.contact_models.impact.time_of_impact import Detector
from ffsm_mj.contact_models.interface import EventEffect, EventTime, LoggedEvent, Scene
from ffsm_mj.contact_models.state_projection import exchange_signs
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord, Outcome, RunEnded
from ffsm_mj.state import Stateful


def impact_energies(system: System, data: Any, impact: Impact) -> FloatArray:
    """Kinetic energies of (total, robot, objects) before and after an impact, (2, 3), J."""
    robot, momentum = system.robot.dofs, np.empty(system.mj.nv)
    out = np.empty((2, 3))
    for k, state in enumerate((impact.before, impact.after)):
        mujoco.mj_mulM(system.mj, data, momentum, state.qvel)
        # Robot and objects are separate trees: no entry of M couples them, so the energies of both add up to the total.
        share = float(0.5 * momentum[robot] @ state.qvel[robot])
        out[k] = state.kinetic_energy_J, share, state.kinetic_energy_J - share
    return out


def impulses_between(system: System, impact: Impact) -> FloatArray:
    """Impulses of the robot on the objects, of fixed bodies on the robot, and of fixed bodies on the objects, (3, 6).

    Each row is an impulse in N s and its moment about the world origin in N m s. A contact of two objects, or of the robot
    with itself, is within one subsystem and contributes nothing; nor does a joint at its limit.
    """
    impulses = np.zeros((3, 6))
    for contact, force in zip(impact.contacts, impact.vectors, strict=True):
        if not isinstance(contact, LimitContact):
            signs = exchange_signs(system, contact.body_a, contact.body_b)
            # The moment is about the world origin, as the angular momenta of the balance are: about a moving point it would
            # not be conserved.
            impulses += np.outer(signs, np.concatenate((force, cross(contact.point, force))))
    return impulses


def _centre(system: System, data: Any, body: int) -> FloatArray:
    """Centre of mass of the robot or object of a body; for a fixed body the origin of its model's frame, (3,), m."""
    tree = system.tree_of_body(body)
    return np.asarray(data.xpos[system.mj.body_rootid[body]] if tree is None else data.subtree_com[tree.root])


def impact_records(
    system: System,
    data: Any,
    touching: ClosedPairs,
    met: RestingResult,
    energies: FloatArray,
    event: int,
    instant: EventTime,
) -> tuple[ImpactRecord | LimitImpactRecord, ...]:
    """Records of an impact, one per contact point and joint limit."""
    impact, used, vectors = met.impact, met.used.tolist(), met.impact.vectors
    shared = _shared_fields(system, data, impact, energies)
    points = contact_points(touching)
    stated = [pair.restitution for pair, _, _ in points]
    omitted = [_omitted_flights(*values) for values in zip(met.speeds.tolist(), met.pressing.tolist(), stated, strict=True)]
    records: list[ImpactRecord | LimitImpactRecord] = []
    for i, (pair, near, point) in enumerate(points):
        common = {
            "event": event,
            "time_s": instant.time_s,
            "step": instant.step,
            "restitution": pair.restitution,
            "restitution_used": used[i],
            "dropped_flights_s": omitted[i][1],
            **shared,
        }
        if pair.is_limit:
            records.append(_at_limit(pair, near, pair.value(data), impact, i, dropped_gap=omitted[i][0], **common))
        else:
            moment = cross(point - _centre(system, data, pair.body_b), vectors[i])
            records.append(_at_point(pair, near, point, moment, impact, i, dropped_gap_m=omitted[i][0], **common))
    return tuple(records)


def _at_point(
    pair: ContactPair, near: Proximity, point: FloatArray, moment: FloatArray, impact: Impact, i: int, **common: Any
) -> ImpactRecord:
    """Record of a contact point with the moment of its impulse, N m s, (3,)."""
    geoms = pair.geoms_at(near, point)
    return ImpactRecord(
        pair=pair.name,
        geoms=geoms,
        robot_geom=geoms[0] if pair.robot_on_object else "",
        object_geom=geoms[1] if pair.robot_on_object else "",
        point_m=tuple(point.tolist()),
        normal=tuple(near.normal.tolist()),
        manifold=manifold_name(near.extreme_points),
        approach_speed_m_s=float(impact.approach_speeds[i]),
        separation_speed_m_s=float(impact.separation_speeds[i]),
        impulse_N_s=float(impact.impulses[i]),
        angular_impulse_N_m_s=tuple(moment.tolist()),
        mu=pair.mu,
        compliance_ratio=pair.compliance_ratio,
        rule=pair.rule,
        gap_m=near.gap,
        **_friction(impact, i),
        **common,
    )


def _at_limit(limit: JointLimit, near: Proximity, value: float, impact: Impact, i: int, **common: Any) -> LimitImpactRecord:
    """Record of a joint at its limit, at a coordinate ``value``."""
    friction = _friction(impact, i)
    return LimitImpactRecord(
        joint=limit.joint,
        side=limit.side,
        unit=limit.unit,
        value=value,
        limit=limit.limit,
        theta=friction.get("theta", 1.0),
        approach_rate=float(impact.approach_speeds[i]),
        separation_rate=float(impact.separation_speeds[i]),
        impulse=float(impact.impulses[i]),
        work_J=friction["normal_work_J"],
        gap=near.gap,
        point_m=tuple(near.points[0].tolist()),
        axis=tuple(near.normal.tolist()),
        **common,
    )


def _shared_fields(system: System, data: Any, impact: Impact, energies: FloatArray) -> dict[str, Any]:
    """Fields that are equal in the records of all contacts of an impact."""
    change = impact.momentum_change
    before, after = (
        {subsystem: (float(value),) for subsystem, value in zip(("total", "robot", "objects"), values, strict=True)}
        for values in energies
    )
    return {
        "law": impact.law,
        "status": impact.status,
        "qpos": tuple(data.qpos.tolist()),
        "qvel_before": system.by_joint(impact.before.qvel),
        "qvel_after": system.by_joint(impact.after.qvel),
        "energy_before_J": before,
        "energy_after_J": after,
        "momentum_before": {"total": tuple(impact.before.momentum.tolist())},
        "momentum_after": {"total": tuple(impact.after.momentum.tolist())},
        "energy_change_J": impact.energy_change_J,
        "linear_momentum_change_N_s": float(np.linalg.norm(change[:3])),
        "angular_momentum_change_N_m_s": float(np.linalg.norm(change[3:])),
    }


def _friction(impact: Impact, i: int) -> dict[str, Any]:
    """Fields of a record about friction at one contact, or about its absence."""
    friction = impact.friction
    if friction is None:
        # Velocities are linear in the impulse, so its work is exactly the impulse times the mean of the velocities before
        # and after.
        mean = 0.5 * float(impact.separation_speeds[i] - impact.approach_speeds[i])
        return {"normal_work_J": float(impact.impulses[i]) * mean}
    return {
        "theta": friction.theta,
        "tangential_impulse_N_s": tuple(friction.impulses[i].tolist()),
        "slip_before_m_s": tuple(friction.slip_before[i].tolist()),
        "slip_after_m_s": tuple(friction.slip_after[i].tolist()),
        "path": friction.paths[i],
        "normal_work_J": float(friction.normal_work[i]),
        "friction_work_J": float(friction.friction_work[i]),
        "compression_work_J": float(friction.compression_work[i]),
    }


def _omitted_flights(speed: float, pressing: float, restitution: float) -> tuple[float, float]:
    """Flights omitted by the rest rule at one contact: highest gap in m, and total duration in s."""
    # Without a force that presses, the omitted flight would not end: the rest rule does not apply, and nothing was omitted.
    if speed <= 0.0 or pressing <= 0.0:
        return 0.0, 0.0
    # Bounces at restitution e last 2 speed / b * (1 + e + e^2 + ...).
    left = 2.0 * speed / (pressing * (1.0 - restitution)) if restitution < 1.0 else 0.0
    return 0.5 * speed**2 / pressing, left


@dataclass(frozen=True)
class ImpactRules:
    """Settings of the impacts in a scenario; see its keys of the same names."""

    law: str
    rest: RestRule
    max_impacts: int
    stop_on_impact: bool


class ImpactModel(Stateful, Detector):
    """Resolves impacts of pairs and at joint limits; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    @dataclass
    class State:
        """Number of impacts, what the pairs remember of their geometry, deepest overlap, heat, and gaps by rule."""

        impacts: int
        geoms: dict[str, Any]
        overlap: Any
        heat: Any
        rule_gaps: Any

    records = (IMPACT, LIMIT_IMPACT)
    resolves_impacts = True

    def __init__(
        self,
        scene: Scene,
        pairs: Sequence[UnilateralConstraint],
        rules: ImpactRules,
        persistent: PersistentContacts,
        overlap: DeepestOverlap,
        heat: FrictionHeat,
    ) -> None:
        """Start at the state in ``scene.data``; see :class:`~ffsm_mj.contact_models.impact.time_of_impact.Detector`.

        Its columns include those of ``heat`` if a pair has friction.
        """
        super().__init__(scene, pairs, persistent, overlap)
        self._rules, self._persistent = rules, persistent
        self._impacts = 0
        self._heat = heat
        self._by_name = {pair.name: pair for pair in pairs}
        self._geoms = {pair.name: pair for pair in pairs if isinstance(pair, ContactPair)}
        self._rule_gaps = RuleGaps(scene, [*self._geoms.values()])
        self.columns = (*self.columns, *self._rule_gaps.columns)
        if any(pair.mu > 0.0 for pair in pairs):
            self.columns = (*self.columns, *heat.columns)

    def names(self) -> str:
        """The pairs in contact."""
        return "; ".join(str(pair) for pair, _ in self.closed_pairs())

    def act(self, instant: EventTime) -> EventEffect | None:
        """Resolve all contacts at this instant together.

        Raises:
            RunEnded: A contact is not supported, has no solution, or would have to persist and cannot.
        """
        system, data, time_s = self.scene.system, self.scene.data, instant.time_s
        touching = self.closed_pairs(located=True)
        try:
            met = self.resolve(touching)
        except (UnsupportedContactError, ValueError) as error:
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"at t = {time_s:.6g} s: {error} ({self.names()})") from error
        # Before any velocity is set: those of a result without solution may create energy, and persist in every later row.
        self._refuse_unsolved(met.impact, time_s)
        self._refuse_rest(touching, met, time_s)
        if not any(near.approaches for _, near in touching):
            # Nothing approaches: the root of the gap was found to rounding, or a pair at rest is pressed. There is no
            # impulse; persistent contact takes over the pairs at rest.
            self._persistent.close(touching, struck=False)
            self._refuse_corners(touching, met, time_s)
            return None
        impact = self.apply(touching, met.impact)
        energies = impact_energies(system, data, impact)
        met = replace(met, impact=impact)
        records = impact_records(system, data, touching, met, energies, self._impacts, instant)
        # Pairs that neither approach nor separate are taken over now. Left to impacts, they would touch anew at every step.
        self._persistent.close(touching, struck=True)
        self._refuse_unmoved(touching, impact, time_s)
        self._impacts += 1
        of_geoms = _is_of_geoms(records)
        return EventEffect(records, self.exchange(energies, impact), end=self._end(of_geoms), triggers_control=of_geoms)

    def record_fault(self, records: Sequence[ImpactRecord | LimitImpactRecord]) -> str:
        """Why logged impacts do not fit the pairs, in one word; empty if they do."""
        return impact_fault(records, self._by_name)

    def replay(self, event: LoggedEvent) -> EventEffect:
        """Resolve an impact again at its logged state, for comparison; the exchange is that of the logged impact."""
        recall_points(self._geoms, event.records, self.scene.data)
        logged = logged_impact(self.scene, event, self._by_name)
        exchange = self.exchange(impact_energies(self.scene.system, self.scene.data, logged), logged)
        records, *varied = self._resolved_again(event)
        return EventEffect(records, exchange, triggers_control=_is_of_geoms(records), varied=varied)

    def _resolved_again(self, event: LoggedEvent) -> list[tuple[ImpactRecord | LimitImpactRecord, ...]]:
        """Records of the impact at the state in ``data``, then as rounding of it may change them; empty if there is none."""
        system, data, motion, touching = self.scene.system, self.scene.data, self.motion, self.closed_pairs()
        qpos, qvel, varied = np.array(motion.data.qpos), np.array(motion.data.qvel), []
        for moved in moved_points(touching, self.scene, motion):
            # A point that rounding moves far changes the arm of the impulse, and with it all impulses: the spread is what
            # the comparison allows for.
            varied.append(self._records_of(moved, event))
            motion.go_to(qpos, qvel)
        records = self._records_of(touching, event)
        # Slip paths of several contacts are discontinuous in the velocities: rounding of the logged state may lead to
        # another branch.
        if records and not varied and apart(records, event.records) > APART:
            for near in rounded_rates(qvel):
                motion.go_to(qpos, near)
                varied.append(self._records_of(self.closed_pairs(), event))
            # The branch that the run took is among these, unless the log is wrong; then the nearest one is still far from
            # it.
            records = min([records, *varied], key=lambda candidate: apart(candidate, event.records))
            # Which points stay closed is decided at the logged velocities then.
            data.qvel[:] = event.state_after[system.mj.nq :]
            mujoco.mj_forward(system.mj, data)
            motion.sync_from_system()
        if records:
            self._persistent.close(touching, struck=True)
        return [records, *filter(None, varied)]

    def _records_of(self, touching: ClosedPairs, event: LoggedEvent) -> tuple[ImpactRecord | LimitImpactRecord, ...]:
        """Records of an impact at the state in ``data``, whose velocities change, in the order of those of a logged event.

        Empty if it cannot be resolved.
        """
        system, data = self.scene.system, self.scene.data
        try:
            met = self.resolve(touching)
            met = replace(met, impact=self.apply(touching, met.impact))
        # The log may state an impact where nothing touches. That is a difference to report, not an error of the replay.
        except (UnsupportedContactError, ValueError, ArithmeticError):
            return ()
        energies = impact_energies(system, data, met.impact)
        instant = EventTime(event.time_s, event.step)
        return _in_order_of(event.records, impact_records(system, data, touching, met, energies, event.number, instant))

    def after_replayed_step(self) -> None:
        """Update the deepest overlap."""
        self.update_overlap()

    def resolve(self, touching: ClosedPairs) -> RestingResult:
        """Resolve an impact in the coordinates of the motion, plastic for contacts that come to rest."""
        motion, points = self.motion, contact_points(touching)

        def with_restitution(e: FloatArray) -> Impact:
            contacts = [
                as_contact(pair, near, point, motion, float(restitution_i))
                for (pair, near, point), restitution_i in zip(points, e, strict=True)
            ]
            return resolve(motion.model, motion.data, contacts, self._rules.law, motion.constrained)

        return resolve_resting(self.scene.system.mj, self.scene.data, touching, self._rules.rest, with_restitution, motion)

    def apply(self, touching: ClosedPairs, impact: Impact) -> Impact:
        """Set the post-impact velocities of the motion; returns the impact in the coordinates of the logged system."""
        motion, data = self.motion, self.scene.data
        before = np.array(data.qvel)
        # Positions stay: an impact lasts no time, and its impulses change velocities alone.
        motion.data.qvel[:] = impact.after.qvel
        mujoco.mj_forward(motion.model, motion.data)
        motion.path.on_event_located()
        # With a grasped object another model moves. Its ids of bodies mean nothing to the log, which has those of the scene.
        if motion.data is data:
            return impact
        pairs = [pair for pair, _, _ in contact_points(touching)]
        return replace(
            impact,
            contacts=tuple(
                contact if isinstance(contact, LimitContact) else replace(contact, body_a=pair.body_a, body_b=pair.body_b)
                for contact, pair in zip(impact.contacts, pairs, strict=True)
            ),
            before=replace(impact.before, qvel=before),
            after=replace(impact.after, qvel=np.array(data.qvel)),
        )

    def exchange(self, energies: FloatArray, impact: Impact) -> Exchange:
        """Energy and momentum that an impact exchanged between the subsystems; accumulates the heat of friction.

        Args:
            energies: Kinetic energies from :func:`~ffsm_mj.contact_models.impact.model.impact_energies`.
            impact: Impact in the coordinates of the logged system.
        """
        system, data = self.scene.system, self.scene.data
        on_objects, *outside = impulses_between(system, impact)
        if self.motion.data is not data or self.motion.loops is not None:
            # A closed grasp passes impulses on between robot and object; no contact shows them, the momenta of objects do.
            change = impact.after.qvel - impact.before.qvel
            momenta = (momentum_matrix(system.mj, data, tree.root) @ change for tree in system.objects)
            on_objects = sum(momenta, -outside[1])
        if impact.friction is not None:
            # The change of energy is the sum of the works of normal and tangential impulses: what the former do not explain
            # became heat.
            self._heat.add(impact.friction.normal_work.sum() - (energies[1, 0] - energies[0, 0]))
        return Exchange(energies[1] - energies[0], on_objects, np.array(outside))

    def _end(self, of_geoms: bool) -> RunEnded | None:
        if self._rules.stop_on_impact and of_geoms:
            return RunEnded(Outcome.COMPLETED)
        if self._impacts >= self._rules.max_impacts:
            return RunEnded(Outcome.EVENT_LIMIT, f"{self._impacts} impacts; raise impact.max_impacts to continue")
        return None

    def _refuse_unsolved(self, impact: Impact, time_s: float) -> None:
        """End the run if no solution with friction was found."""
        if impact.status == "unconverged" and impact.friction is not None:
            count = len(impact.contacts)
            what = f"an impact of {count} contacts with friction" if count > 1 else "an impact with friction"
            message = f"no solution for {what} at t = {time_s:.6g} s, residual {impact.friction.residual:.1e}"
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message} ({self.names()})")

    def _refuse_unmoved(self, touching: ClosedPairs, impact: Impact, time_s: float) -> None:
        """End the run if a pair still approaches and no impulse stops it: the same event would repeat for ever.

        The approach is slower than the impact law resolves: between heavy bodies the impulses on a light one are known to a
        share of rounding, which is a velocity of the light one.
        """
        left = [pair for pair, near in touching if near.approaches and not self._persistent.holds(pair)]
        # A pair that still approaches and got an impulse is hit again in the next event. Only without any would that repeat
        # for ever.
        if left and not impact.impulses.any():
            speed = float(impact.approach_speeds.max())
            message = (
                f"{left[0]} approaches at {speed:.2g} m/s at t = {time_s:.6g} s, and no impulse in double precision stops it"
            )
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}: the masses of the bodies in contact differ too much")

    def _refuse_corners(self, touching: ClosedPairs, met: RestingResult, time_s: float) -> None:
        """End the run if a pair pressed at rest has no defined normal: the same event would repeat for ever."""
        speeds = met.impact.separation_speeds.tolist()
        for (pair, near, _), b, speed in zip(contact_points(touching), met.pressing.tolist(), speeds, strict=True):
            # A pressed pair without separation speed must become a persistent contact. If it could not, the root would be
            # found again at the same time, without end.
            if b > 0.0 and speed <= near.rate_tolerance and not self._persistent.holds(pair):
                message = f"{pair} would stay in contact from t = {time_s:.6g} s by a corner on a corner or on an edge"
                raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}, where the contact normal is not defined")

    def _refuse_rest(self, touching: ClosedPairs, met: RestingResult, time_s: float) -> None:
        """End the run if a pair comes to rest under load and cannot persist."""
        for (pair, _, _), used, b in zip(contact_points(touching), met.used.tolist(), met.pressing.tolist(), strict=True):
            # A plastic contact that is not pressed only grazes: nothing has to keep it closed, and it may go on as free
            # motion.
            if used == 0.0 and b > 0.0 and (why := self._persistent.refusal(pair)):
                message = f"{pair} would stay in contact from t = {time_s:.6g} s, pressed at {b:.3g} m/s^2: {why}"
                raise RunEnded(Outcome.UNSUPPORTED_CONTACT, message)


def _is_of_geoms(records: Sequence[ImpactRecord | LimitImpactRecord]) -> bool:
    """Whether the controller is evaluated at an impact: a joint that hits its limit is no event of the task."""
    return any(isinstance(record, ImpactRecord) for record in records)


def _apart(one: ImpactRecord | LimitImpactRecord, other: ImpactRecord | LimitImpactRecord) -> float:
    """How far the places of two contacts are apart, and in a corner their normals."""
    normals = [record.normal for record in (one, other) if isinstance(record, ImpactRecord)]
    return math.dist(one.point_m, other.point_m) + (math.dist(*normals) if len(normals) == 2 else 0.0)


def _in_order_of(
    logged: Sequence[Any], records: Sequence[ImpactRecord | LimitImpactRecord]
) -> tuple[ImpactRecord | LimitImpactRecord, ...]:
    """Records of an impact in the order of logged ones: of the points of a pair, rounding decides which is the first."""
    left, ordered = list(records), []
    for theirs in logged:
        what = "joint" if isinstance(theirs, LimitImpactRecord) else "pair"
        alike = [contact for contact in left if getattr(contact, what, None) == getattr(theirs, what)]
        if not alike:
            break
        # Points of a face are listed by the feature search, whose order may change by rounding: the nearest point is the
        # same contact.
        ordered.append(min(alike, key=lambda contact: _apart(contact, theirs)))
        left = [contact for contact in left if contact is not ordered[-1]]
    return (*ordered, *left)
