"""Log columns of closed contacts by rule, and their event records by pair: forces, centres of pressure and features."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import EventTime, Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.rows import ContactPoint, PointRows
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import FORCE_RESIDUAL, Signal, identifier
from ffsm_mj.records.wrench import Wrench

FREE, CLOSED, PRESSING = 0.0, 1.0, 2.0
"""Contact modes of a pair in the log."""

_SIGNALS = (
    ("mode", "", "contact state of {}: 0 open, 1 closed without force, 2 closed with force"),
    ("pairs", "", "number of closed pairs of {}"),
    ("points", "", "number of contact points of {}"),
    ("force_N", "N", "contact force of {}, under the efforts of this row: sum of the resultants of its pairs; 0 if open"),
    *((f"force_{x}_N", "N", "resultant force of {} on its second side, world axes") for x in "xyz"),
    *((f"centre_{x}_m", "m", "centre of pressure of {}, world axes; NaN if no contact point carries force") for x in "xyz"),
    ("impulse_N_s", "N s", "time integral of the contact force of {} since t = 0"),
)
_RESIDUAL = (
    "largest difference between the resultant force of a pair in the step and the non-negative one; ffsm analyze recomputes "
    "it from the states in the log, with other functions"
)
_NOTHING = np.array([FREE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan, math.nan, 0.0])
_IMPULSE = len(_NOTHING) - 1
_NOWHERE = [math.nan] * 3


def force_keys(rule: str) -> tuple[str, ...]:
    """Columns of the resultant force of a contact rule on its second side."""
    return tuple(f"contact.{identifier(rule)}_force_{x}_N" for x in "xyz")


def mode_key(rule: str) -> str:
    """Column of the contact mode of a rule."""
    return f"contact.{identifier(rule)}_mode"


class Resultant(NamedTuple):
    """Resultant contact force of a pair at one state.

    Attributes:
        force: Force on geom b, N, (3,).
        centre: Centre of pressure; mean of the contact points if none carries force, m, (3,).
        normal: Mean unit normal, (3,).
        points: Number of contact points.
        mode: Their features.
    """

    force: FloatArray
    centre: FloatArray
    normal: FloatArray
    points: int
    mode: str

    @property
    def size(self) -> float:
        """Norm of the force, N."""
        return math.hypot(*self.force.tolist())


def resultant(
    contact_points: Sequence[ContactPoint],
    rows: PointRows,
    forces: FloatArray,
    pair: ContactPair,
    friction: FloatArray | None = None,
) -> Resultant:
    """Resultant over the contact points of one pair, of normal forces (k,) and friction forces (k, 3)."""
    mine = [i for i, contact in enumerate(contact_points) if contact.pair is pair]
    if len(mine) == 1:  # the usual case, evaluated in every stage
        only, here = mine[0], rows.states[mine[0]]
        force = forces[only] * here.normal if friction is None else forces[only] * here.normal + friction[only]
        return Resultant(force, here.point, here.normal, 1, contact_points[only].feature.name)
    part = slice(mine[0], mine[-1] + 1) if mine else slice(0)  # the points of a pair are consecutive
    normals, points, pushed = rows.normals[part], rows.points[part], forces[part]
    total = float(pushed.sum())
    weights = pushed / total if total > 0.0 else np.full(len(mine), 1.0 / max(1, len(mine)))
    normal = weights @ normals
    length = math.hypot(*normal.tolist())
    names = " + ".join(dict.fromkeys(contact_points[i].feature.name for i in mine))
    force = pushed @ normals if friction is None else pushed @ normals + friction[part].sum(axis=0)
    return Resultant(force, weights @ points, normal / length if length else normal, len(mine), names)


def _row_of(pairs: Sequence[tuple[ContactPair, Resultant]], pressing: Container[UnilateralConstraint]) -> tuple[float, ...]:
    """Columns of a rule with these closed pairs, except its impulse."""
    count = sum(found.points for _, found in pairs)
    carrying = [found for pair, found in pairs if pair in pressing]
    if len(pairs) == 1:
        ((_, found),) = pairs
        centre = found.centre.tolist() if carrying else _NOWHERE
        return PRESSING if carrying else CLOSED, 1.0, count, found.size, *found.force.tolist(), *centre
    if not carrying:
        return CLOSED, len(pairs), count, 0.0, 0.0, 0.0, 0.0, *_NOWHERE
    sizes = np.array([found.size for found in carrying])
    total = float(sizes.sum())
    force = np.sum([found.force for found in carrying], axis=0)
    centre = (sizes @ np.array([found.centre for found in carrying]) / total).tolist()
    return PRESSING, len(pairs), count, total, *force.tolist(), *centre


class ContactReport:
    """Writes the columns and event records of the closed contacts of a run.

    Attributes:
        columns: Columns of every contact rule.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair], closed: ActiveContactSet) -> None:
        """Initialise with no closed contacts."""
        self._scene, self._active_set = scene, closed
        self._rules = {name: i for i, name in enumerate(dict.fromkeys(pair.rule for pair in pairs))}
        self._values = np.tile(_NOTHING, (len(self._rules), 1))
        self._is_blank = True
        signals = tuple(
            Signal("contact", f"{identifier(rule)}_{name}", unit, meaning.format(rule))
            for rule in self._rules
            for name, unit, meaning in _SIGNALS
        )
        flat, self._residual = self._values.reshape(-1), np.zeros(1)
        self.columns = (
            Columns(signals, live=flat, on_sample=lambda _: self._write_values(), resume=self._restore_values),
            Columns((Signal("balance", FORCE_RESIDUAL, "N", _RESIDUAL),), live=self._residual),
        )

    def closed_rules(self) -> frozenset[str]:
        """Rules with a closed pair according to the columns."""
        return frozenset(rule for rule, row in self._rules.items() if self._values[row, 0] != FREE)

    def _restore_values(self, logged: FloatArray) -> None:
        self._values[:] = logged.reshape(self._values.shape)
        self._is_blank = False

    def _write_values(self) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        closed = self._active_set
        if not closed.by_pair and self._is_blank:
            return
        self._values[:, :_IMPULSE], self._residual[0] = _NOTHING[:_IMPULSE], 0.0
        self._is_blank = not closed.by_pair
        if not closed.contact_points:
            return
        decision = closed.decide()
        forces, contact_points = decision.forces, decision.contact_points
        pressing = {contact_points[i].pair for i in decision.pressing}
        held, friction = decision.held_forces, decision.friction if closed.has_friction else None
        differ = held is not forces and held.tolist() != forces.tolist()
        by_rule: dict[str, list[tuple[ContactPair, Resultant]]] = {}
        for pair, own in closed.by_pair.items():
            if isinstance(pair, JointLimit):
                here = [i for i, contact in enumerate(contact_points) if contact.pair is pair]
                self._residual[0] = max(self._residual[0], *np.abs(held[here] - forces[here]).tolist(), 0.0)
            elif own:
                found = resultant(contact_points, decision.rows, forces, pair, friction)
                by_rule.setdefault(pair.rule, []).append((pair, found))
                if pair in pressing and differ:
                    again = resultant(contact_points, decision.rows, held, pair, friction).force
                    self._residual[0] = max(self._residual[0], math.dist(found.force, again))
        for rule, each in by_rule.items():
            self._values[self._rules[rule], :_IMPULSE] = _row_of(each, pressing)

    def active(self) -> tuple[ActiveContact, ...]:
        """The closed pairs and their forces at the state in ``data`` under its efforts, for control laws."""
        closed = self._active_set.by_pair.items()
        found = self.places([pair for pair, points in closed if points and isinstance(pair, ContactPair)])
        return tuple(ActiveContact(pair.name, at.force, at.centre.copy(), at.normal.copy()) for pair, at in found.items())

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
                self._values[self._rules[pair.rule], _IMPULSE] += impulse

    def forces_before(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, float]:
        """Resultant forces at the end of the last step, N; 0 if there was no step since the last event."""
        stage = self._active_set.stages[-1] if self._active_set.stages else None
        if stage is None:
            return dict.fromkeys(pairs, 0.0)
        return {
            pair: resultant(self._active_set.pressing, stage.rows, stage.forces, pair, stage.friction).size for pair in pairs
        }

    def places(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, Resultant]:
        """Resultant force and centre of pairs at the state in ``data`` under its efforts."""
        closed, found = self._active_set, {}
        decision = closed.decide() if closed.contact_points else None
        forces = decision.forces if decision else np.zeros(0)
        friction = decision.friction if decision and closed.has_friction else None
        for pair in pairs:
            if decision and closed.by_pair.get(pair):
                found[pair] = resultant(decision.contact_points, decision.rows, forces, pair, friction)
            else:
                near = pair.proximity(self._scene.system.mj, self._scene.data)
                found[pair] = Resultant(np.zeros(3), near.points.mean(axis=0), near.normal, 0, "")
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
                impulse_N_s=float(self._values[self._rules[pair.rule], _IMPULSE]),
                closed_pairs=names,
                qpos=tuple(data.qpos.tolist()),
                qvel_before=qvel_before,
                qvel_after=self._scene.system.by_joint(data.qvel),
            )
            for pair, place in places.items()
        )
