"""Log columns of closed contacts by rule, and their event records by pair: forces, centres of pressure and features."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.body_motion import shifted
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import EventTime, Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.contact_points import point_runs
from ffsm_mj.contact_models.persistent.friction.decision import Decision
from ffsm_mj.contact_models.persistent.friction.report import FrictionReport
from ffsm_mj.contact_models.persistent.record import FRICTION_KINDS
from ffsm_mj.contact_models.persistent.rule_columns import (
    CLOSED,
    FREE,
    IMPULSE,
    MODE_NAMES,
    NOTHING,
    PRESSING,
    SLIDING,
    STICKING,
    Resultant,
    RuleTables,
    points_of,
    resultant,
    row_of,
    signals_of,
)
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import FORCE_RESIDUAL, Signal
from ffsm_mj.records.wrench import Wrench

_RESIDUAL = (
    "zero; ffsm analyze finds the largest difference between the logged resultant force of a pair and that which it "
    "recomputes from the states in the log, with other functions"
)


def _active_contact(pair: ContactPair, at: Resultant, decision: Decision | None) -> ActiveContact:
    """A closed pair as control laws see it."""
    place = pair.name, at.force, at.centre.copy(), at.normal.copy()
    friction = decision.of_pairs.by_pair.get(pair) if decision is not None else None
    if friction is None:
        return ActiveContact(*place, MODE_NAMES[PRESSING if at.size else CLOSED])
    mode = MODE_NAMES[SLIDING if friction.slides else STICKING]
    return ActiveContact(*place, mode, friction.force, friction.slip, friction.use)


class ContactReport:
    """Writes the columns and event records of the closed contacts of a run.

    Attributes:
        columns: Columns of every contact rule.
        friction: Columns of the rules with friction.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair], closed: ActiveContactSet) -> None:
        """Initialise with no closed contacts."""
        self._scene, self._active_set = scene, closed
        self._rules = {name: i for i, name in enumerate(dict.fromkeys(pair.rule for pair in pairs))}
        self._values = np.tile(NOTHING, (len(self._rules), 1))
        self._is_blank = True
        with_friction = tuple(dict.fromkeys(pair.rule for pair in pairs if pair.mu > 0.0))
        signals = tuple(signal for rule in self._rules for signal in signals_of(rule, friction=rule in with_friction))
        self.friction = FrictionReport(with_friction)
        flat, friction = self._values.reshape(-1), self.friction
        closed.steady.report_to(RuleTables(self._values, self._rules, friction.values, friction.rules, friction.work_J))
        self.columns = (
            Columns(signals, flat, None, lambda _: self._write_values(), self._restore_values, self._at_state),
            Columns((Signal("balance", FORCE_RESIDUAL, "N", _RESIDUAL),), live=np.zeros(1)),
            *(self.friction.columns if with_friction else ()),
        )

    def closed_rules(self) -> frozenset[str]:
        """Rules with a closed pair according to the columns."""
        return frozenset(rule for rule, row in self._rules.items() if self._values[row, 0] != FREE)

    def _restore_values(self, logged: FloatArray) -> None:
        self._values[:] = logged.reshape(self._values.shape)
        self._is_blank = False

    def _at_state(self) -> FloatArray:
        self._write_values()
        return self._values.flatten()

    def _write_values(self) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        closed = self._active_set
        if not closed.by_pair and self._is_blank:
            return
        self._is_blank = not closed.by_pair
        if closed.steady.write():
            return
        decision = closed.decide() if closed.contact_points else None
        by_rule = self._resultants(decision) if decision is not None else {}
        if len(by_rule) < len(self._rules):
            self._values[:, :IMPULSE] = NOTHING[:IMPULSE]
        if decision is None:
            self.friction.write({})
            return
        pressing = closed.by_pair if decision.holds_all else {decision.contact_points[i].pair for i in decision.pressing}
        by_pair = decision.of_pairs.by_pair
        rubbing = {}
        for rule, each in by_rule.items():
            mode, *values = row_of(each, pressing)
            pairs = [friction for pair, _ in each if (friction := by_pair.get(pair))]
            if pairs:
                rubbing[rule] = pairs
                mode = SLIDING if any(pair.slides for pair in pairs) else STICKING
            self._values[self._rules[rule], :IMPULSE] = (mode, *values)
        self.friction.write(rubbing)

    def _resultants(self, decision: Decision) -> dict[str, list[tuple[ContactPair, Resultant]]]:
        """Pairs in contact with the resultants of their forces, by rule."""
        closed, forces, contact_points, end = self._active_set, decision.forces, decision.contact_points, 0
        by_rule = dict[str, list[tuple[ContactPair, Resultant]]]()
        for pair, own in closed.by_pair.items():
            part = slice(end, end := end + len(own))
            if own and not isinstance(pair, JointLimit):
                found = resultant(contact_points, decision.rows, forces, part, decision.friction)
                by_rule.setdefault(pair.rule, []).append((pair, found))
        return by_rule

    def active(self) -> tuple[ActiveContact, ...]:
        """The closed pairs and their forces at the state in ``data`` under its efforts, for control laws."""
        closed = self._active_set.by_pair.items()
        found = self.places([pair for pair, points in closed if points and isinstance(pair, ContactPair)])
        decision = self._active_set.decide() if found else None
        return tuple(_active_contact(pair, at, decision) for pair, at in found.items())

    def wrenches(self) -> list[Wrench]:
        """Contact forces on both bodies of each closed contact at the state in ``data`` under its efforts."""
        closed = self._active_set
        if not closed.contact_points:
            return []
        decision, out = closed.decide(), []
        for contact, here, size, along in zip(
            decision.contact_points, decision.rows.states, decision.forces.tolist(), decision.friction, strict=True
        ):
            if size and not isinstance(contact.pair, JointLimit):
                force = size * here.normal + along
                out += [Wrench(contact.pair.body_a, here.point, -force), Wrench(contact.pair.body_b, here.point, force)]
        return out

    def add_impulses(self, impulses: Mapping[UnilateralConstraint, float]) -> None:
        """Add the impulses of pairs in a step, N s."""
        for pair, impulse in impulses.items():
            if isinstance(pair, ContactPair):
                self._values[self._rules[pair.rule], IMPULSE] += impulse

    def forces_before(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, float]:
        """Resultant forces at the end of the last step, N; 0 if there was no step since the last event."""
        closed, forces = self._active_set, dict.fromkeys(pairs, (0.0, 0.0, 0.0))
        if closed.stages:
            runs = point_runs(closed.pressing)
            for run, (x, y, z, *_) in zip(runs, closed.stages[-1].wrenches, strict=True):
                pair = closed.pressing[run.start].pair
                if isinstance(pair, ContactPair) and pair in forces:
                    forces[pair] = shifted((x, y, z), 1.0, forces[pair])
        return {pair: math.hypot(*force) for pair, force in forces.items()}

    def places(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, Resultant]:
        """Resultant force and centre of pairs at the state in ``data`` under its efforts."""
        closed, found = self._active_set, {}
        decision, points = closed.decide() if closed.contact_points else None, closed.contact_points
        for pair in pairs:
            if decision and closed.by_pair.get(pair):
                part = points_of(pair, points)
                found[pair] = resultant(points, decision.rows, decision.forces, part, decision.friction)
            else:
                near = pair.proximity(self._scene.system.mj, self._scene.data)
                found[pair] = Resultant(np.zeros(3), near.points.mean(axis=0), near.normal)
        return found

    def records(
        self,
        kind: RecordKind,
        places: Mapping[ContactPair, Resultant],
        before: Mapping[ContactPair, float],
        instant: EventTime,
        event: int,
        qvel_before: Mapping[str, tuple[float, ...]],
        closed: Sequence[ContactPair],
    ) -> tuple[Any, ...]:
        """Event records of pairs at the state in ``data``.

        Args:
            kind: Kind of record.
            places: Resultant of each pair after the event; before it for a pair that opens.
            before: Resultant forces just before, N.
            instant: Time and step of the event.
            event: Event number.
            qvel_before: Generalised velocity before, by joint.
            closed: All pairs in persistent contact after the event.
        """
        data = self._scene.data
        ended = {pair: pair not in self._active_set.by_pair for pair in places}
        names = tuple(pair.name for pair in closed)
        friction = {pair: {} if ended[pair] else self._friction_fields(kind, pair) for pair in places}
        return tuple(
            kind.record(
                event=event,
                time_s=instant.time_s,
                step=instant.step,
                pair=pair.name,
                rule=pair.rule,
                geoms=pair.geoms,
                mode="" if ended[pair] else place.mode,
                points=0 if ended[pair] else place.points,
                point_m=tuple(place.centre.tolist()),
                normal=tuple(place.normal.tolist()),
                force_before_N=before[pair],
                force_after_N=0.0 if ended[pair] else place.size,
                impulse_N_s=float(self._values[self._rules[pair.rule], IMPULSE]),
                closed_pairs=names,
                qpos=tuple(data.qpos.tolist()),
                qvel_before=qvel_before,
                qvel_after=self._scene.system.by_joint(data.qvel),
                **friction[pair],
            )
            for pair, place in places.items()
        )

    def _friction_fields(self, kind: RecordKind, pair: ContactPair) -> dict[str, Any]:
        """Fields of a record about the friction of a closed pair at the state in ``data``."""
        decision = self._active_set.decide() if self._active_set.contact_points else None
        found = decision.of_pairs.by_pair.get(pair) if decision is not None else None
        if found is None or decision is None:
            return {}
        mode = MODE_NAMES[SLIDING if found.slides else STICKING]
        fields: dict[str, Any] = {"friction": f"{mode}, wedged" if decision.of_pairs.is_wedged(pair) else mode}
        if kind not in FRICTION_KINDS:
            return fields
        use = {"friction_use": found.use, "slip_speed_m_s": found.slip_speed, "slip_m": self.friction.slip(pair.rule)}
        return fields | {"friction_N": math.hypot(*found.force.tolist())} | use
