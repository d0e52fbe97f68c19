"""Log columns and event records: of closed contacts their forces and places, of joints at limits their states and forces.

Columns of contacts are by rule, records by pair.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj._core.stages import StageSums
from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.features.body_motion import shifted
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint, by_kind
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint, point_runs
from ffsm_mj.contact_models.persistent.exchange import Shares, Stage, exchanged, robot_dofs
from ffsm_mj.contact_models.persistent.friction.decision import Decision
from ffsm_mj.contact_models.persistent.friction.report import FrictionReport
from ffsm_mj.contact_models.persistent.record import FRICTION_KINDS
from ffsm_mj.contact_models.persistent.rule_columns import (
    IMPULSE,
    NOTHING,
    Resultant,
    RuleMode,
    RuleTables,
    points_of,
    resultant,
    row_of,
    signals_of,
)
from ffsm_mj.contact_models.state_projection import sum_exchanges
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import ActiveContact, Wrench
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import Signal, identifier, limit_force_name
from ffsm_mj.state import Stateful

_FREE, _TOUCHING, _PRESSED = 0.0, 1.0, 2.0
"""Magnitude of the state of a joint's limits in the log; its sign is negative at the lower limit."""
_STATES = {_FREE: "free", _TOUCHING: "touching", _PRESSED: "pressed"}


def state_key(limit: JointLimit) -> str:
    """Column of the state of a joint's limits."""
    return f"contact.{identifier(limit.joint)}_limit"


def force_key(limit: JointLimit) -> str:
    """Column of the force of a joint's limits."""
    return f"contact.{limit_force_name(limit.joint, limit.unit)}"


class _ForceTable(Stateful):
    """Values of the columns of some contacts or limits; blank while none of them is closed."""

    @dataclass
    class State:
        """Values of the columns, and whether nothing has been written since they were blank."""

        values: FloatArray
        is_blank: bool

    _values: FloatArray
    _is_blank = True

    def _columns(self, signals: tuple[Signal, ...]) -> Columns:
        live = self._values.reshape(-1)
        return Columns(signals, live, None, lambda _: self._write_values(), self._restore_values, self._at_state)

    def _write_values(self) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        raise NotImplementedError

    def _restore_values(self, logged: FloatArray) -> None:
        self._values[:] = logged.reshape(self._values.shape)
        self._is_blank = False

    def _at_state(self) -> FloatArray:
        self._write_values()
        return self._values.flatten()


class LimitReport(_ForceTable):
    """Writes the columns and event records of the limited joints of a run.

    Attributes:
        columns: Columns of every limited joint.
    """

    def __init__(self, scene: Scene, limits: Sequence[JointLimit], closed: ClosedContacts) -> None:
        """Initialise with no joint at a limit."""
        self._scene, self._closed, self._limits = scene, closed, tuple(limits)
        joints = list(dict.fromkeys((limit.joint, limit.unit) for limit in limits))
        self._values = np.zeros((len(joints), 3))
        self._row = {limit: joints.index((limit.joint, limit.unit)) for limit in limits}
        signals = tuple(signal for joint, unit in joints for signal in _limit_signals(joint, unit))
        self.columns = (self._columns(signals),) if signals else ()

    def logged_limits(self) -> list[JointLimit]:
        """Limits at which a joint rests according to the columns."""
        return [limit for limit, row in self._row.items() if self._values[row, 0] * limit.sign < 0.0]

    def _write_values(self) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        _, limits = by_kind(self._closed.by_pair)
        if not limits and self._is_blank:
            return
        # The third column is a sum since t = 0, which stays.
        self._values[:, :2], self._is_blank = 0.0, not limits
        for limit, (state, force) in self._now(limits).items():
            self._values[self._row[limit], :2] = -limit.sign * state, limit.sign * force

    def _now(self, limits: Sequence[JointLimit]) -> dict[JointLimit, tuple[float, float]]:
        """State and force of some limits, N or N m, at the state in ``data`` under its efforts."""
        state = dict.fromkeys(limits, (_FREE, 0.0))
        if not self._closed.contact_points or not limits:
            return state
        decision = self._closed.decide()
        for i, (contact, force) in enumerate(zip(decision.contact_points, decision.forces.tolist(), strict=True)):
            if contact.pair.is_limit and contact.pair in state:
                state[contact.pair] = (_PRESSED, force) if i in decision.pressing else (_TOUCHING, 0.0)
        return state

    def add_forces(self, applied: FloatArray) -> None:
        """Add the forces of all limits under the efforts in ``data``, (nv,) of the motion."""
        _, limits = by_kind(self._closed.by_pair)
        for limit, (_, force) in self._now(limits).items():
            motion = self._closed.motion
            applied += limit.row(motion.model, motion.data, motion.dofs) * force

    def add_impulses(self, impulses: Mapping[Any, float]) -> None:
        """Add the impulses in a step, N s or N m s."""
        for limit, impulse in impulses.items():
            if limit.is_limit:
                self._values[self._row[limit], 2] += impulse

    def forces_before(self, limits: Sequence[JointLimit]) -> dict[JointLimit, float]:
        """Forces at the end of the last step, N or N m; 0 if there was no step since the last event."""
        forces: dict[JointLimit, float] = dict.fromkeys(limits, 0.0)
        last = self._closed.last_stage
        if last is not None:
            for contact, force in zip(self._closed.pressing, last.forces.tolist(), strict=True):
                if contact.pair.is_limit and contact.pair in forces:
                    forces[contact.pair] = force
        return forces

    def records(
        self,
        kind: RecordKind,
        before: Mapping[JointLimit, float],
        shared: Mapping[str, Any],
    ) -> tuple[Any, ...]:
        """Event records of joint limits at the state in ``data``.

        Args:
            kind: Kind of record.
            before: Force of each limit just before, N or N m.
            shared: Fields of all records of the event; see :func:`~ffsm_mj.contact_models.interface.event_fields`.
        """
        model, data = self._scene.system.mj, self._scene.data
        near = {limit: limit.proximity(model, data) for limit in before}
        return tuple(
            kind.record(
                joint=limit.joint,
                side=limit.side,
                unit=limit.unit,
                value=limit.value(data),
                limit=limit.limit,
                state=_STATES[state],
                force_before=before[limit],
                force_after=force,
                impulse=float(self._values[self._row[limit], 2]),
                point_m=tuple(near[limit].points[0].tolist()),
                axis=tuple(near[limit].normal.tolist()),
                **shared,
            )
            for limit, (state, force) in self._now([*before]).items()
        )


def _limit_signals(joint: str, unit: str) -> tuple[Signal, ...]:
    """Columns of the limits of one joint."""
    force = "torque" if unit == "rad" else "force"
    of_force = "N_m" if unit == "rad" else "N"
    units = of_force.replace("_", " ")
    return (
        Signal(
            "contact",
            f"{identifier(joint)}_limit",
            "",
            f"limits of {joint}: 0 free, -1 at the lower and 1 at the upper one without force, -2 and 2 pressed against it",
            joint,
        ),
        Signal(
            "contact",
            limit_force_name(joint, unit),
            units,
            f"{force} of the limits on {joint}, positive at the lower one, under the efforts of this row",
            joint,
        ),
        Signal(
            "contact",
            f"{identifier(joint)}_limit_impulse_{of_force}_s",
            f"{units} s",
            f"time integral of the magnitude of the {force} of the limits on {joint} since t = 0",
            joint,
        ),
    )


def _active_contact(pair: ContactPair, at: Resultant, decision: Decision | None) -> ActiveContact:
    """A closed pair as control laws see it."""
    place = pair.name, at.force, at.centre.copy(), at.normal.copy()
    friction = decision.of_pairs.by_pair.get(pair) if decision is not None else None
    if friction is None:
        return ActiveContact(*place, (RuleMode.PRESSING if at.size else RuleMode.CLOSED).word)
    mode = (RuleMode.SLIDING if friction.is_sliding else RuleMode.STICKING).word
    return ActiveContact(*place, mode, friction.force, friction.slip, friction.use)


class ContactReport(_ForceTable):
    """Writes the columns and event records of the closed contacts of a run.

    Attributes:
        columns: Columns of every contact rule.
        friction: Columns of the rules with friction.
    """

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair], closed: ClosedContacts) -> None:
        """Initialise with no closed contacts."""
        self._scene, self._closed = scene, closed
        self._rules = {name: i for i, name in enumerate(dict.fromkeys(pair.rule for pair in pairs))}
        self._values = np.tile(NOTHING, (len(self._rules), 1))
        with_friction = tuple(dict.fromkeys(pair.rule for pair in pairs if pair.mu > 0.0))
        signals = tuple(signal for rule in self._rules for signal in signals_of(rule, friction=rule in with_friction))
        self.friction = FrictionReport(with_friction)
        friction = self.friction
        closed.steady.report_to(RuleTables(self._values, self._rules, friction.values, friction.rules, friction.work_J))
        self.columns = (self._columns(signals), *(self.friction.columns if with_friction else ()))

    def closed_rules(self) -> frozenset[str]:
        """Rules with a closed pair according to the columns."""
        return frozenset(rule for rule, row in self._rules.items() if self._values[row, 0] != RuleMode.OPEN)

    def _write_values(self) -> None:
        """Write the columns for the state in ``data`` under its efforts."""
        if not self._closed.by_pair and self._is_blank:
            return
        self._is_blank = not self._closed.by_pair
        if self._closed.steady.write():
            return
        decision = self._closed.decide() if self._closed.contact_points else None
        by_rule = self._resultants(decision) if decision is not None else {}
        # Rules whose pairs have opened since the last row; the others are overwritten below. The impulse is a sum and stays.
        if len(by_rule) < len(self._rules):
            self._values[:, :IMPULSE] = NOTHING[:IMPULSE]
        if decision is None:
            self.friction.write({})
            return
        pressing = (
            self._closed.by_pair if decision.is_settled else {decision.contact_points[i].pair for i in decision.pressing}
        )
        by_pair = decision.of_pairs.by_pair
        rubbing = {}
        for rule, resultants in by_rule.items():
            mode, *values = row_of(resultants, pressing)
            pairs = [friction for pair, _ in resultants if (friction := by_pair.get(pair))]
            if pairs:
                rubbing[rule] = pairs
                # By definition a pair slides while any of its points does (docs/friction.md).
                mode = RuleMode.SLIDING if any(pair.is_sliding for pair in pairs) else RuleMode.STICKING
            self._values[self._rules[rule], :IMPULSE] = (mode, *values)
        self.friction.write(rubbing)

    def _resultants(self, decision: Decision) -> dict[str, list[tuple[ContactPair, Resultant]]]:
        """Pairs in contact with the resultants of their forces, by rule."""
        closed, forces, contact_points, end = self._closed, decision.forces, decision.contact_points, 0
        by_rule = dict[str, list[tuple[ContactPair, Resultant]]]()
        for pair, points_ in closed.by_pair.items():
            part = slice(end, end := end + len(points_))
            if points_ and not pair.is_limit:
                sum_of = resultant(contact_points, decision.rows, forces, part, decision.friction)
                by_rule.setdefault(pair.rule, []).append((pair, sum_of))
        return by_rule

    def active(self) -> tuple[ActiveContact, ...]:
        """The closed pairs and their forces at the state in ``data`` under its efforts, for control laws."""
        closed = self._closed.by_pair.items()
        places = self.places([pair for pair, points in closed if points and isinstance(pair, ContactPair)])
        decision = self._closed.decide() if places else None
        return tuple(_active_contact(pair, at, decision) for pair, at in places.items())

    def wrenches(self) -> list[Wrench]:
        """Contact forces on both bodies of each closed contact at the state in ``data`` under its efforts."""
        if not self._closed.contact_points:
            return []
        decision, out = self._closed.decide(), []
        for contact, state, size, along in zip(
            decision.contact_points, decision.rows.states, decision.forces.tolist(), decision.friction, strict=True
        ):
            # A limit acts along a joint, not at a point: add_forces enters it.
            if size and not contact.pair.is_limit:
                force = size * state.normal + along
                out += [Wrench(contact.pair.body_a, state.point, -force), Wrench(contact.pair.body_b, state.point, force)]
        return out

    def add_impulses(self, impulses: Mapping[UnilateralConstraint, float]) -> None:
        """Add the impulses of pairs in a step, N s."""
        for pair, impulse in impulses.items():
            if isinstance(pair, ContactPair):
                self._values[self._rules[pair.rule], IMPULSE] += impulse

    def forces_before(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, float]:
        """Resultant forces at the end of the last step, N; 0 if there was no step since the last event."""
        closed, forces = self._closed, dict.fromkeys(pairs, (0.0, 0.0, 0.0))
        # After an event there is no force just before: what acted belongs to efforts or modes that are gone.
        if closed.stages:
            runs = point_runs(closed.pressing)
            for run, (x, y, z, *_) in zip(runs, closed.stages[-1].wrenches, strict=True):
                pair = closed.pressing[run.start].pair
                if isinstance(pair, ContactPair) and pair in forces:
                    # As the last stage gave it: a decision at this state would have the forces after the event.
                    forces[pair] = shifted((x, y, z), 1.0, forces[pair])
        return {pair: math.hypot(*force) for pair, force in forces.items()}

    def places(self, pairs: Sequence[ContactPair]) -> dict[ContactPair, Resultant]:
        """Resultant force and centre of pairs at the state in ``data`` under its efforts."""
        closed, centres = self._closed, {}
        decision, points = closed.decide() if closed.contact_points else None, closed.contact_points
        for pair in pairs:
            if decision and closed.by_pair.get(pair):
                part = points_of(pair, points)
                centres[pair] = resultant(points, decision.rows, decision.forces, part, decision.friction)
            else:
                # A pair without contact points has no centre of pressure: its place is where the geoms are nearest.
                near = pair.proximity(self._scene.system.mj, self._scene.data)
                centres[pair] = Resultant(np.zeros(3), near.points.mean(axis=0), near.normal)
        return centres

    def records(
        self,
        kind: RecordKind,
        places: Mapping[ContactPair, Resultant],
        before: Mapping[ContactPair, float],
        shared: Mapping[str, Any],
        closed: Sequence[ContactPair],
    ) -> tuple[Any, ...]:
        """Event records of pairs at the state in ``data``.

        Args:
            kind: Kind of record.
            places: Resultant of each pair after the event; before it for a pair that opens.
            before: Resultant forces just before, N.
            shared: Fields of all records of the event; see :func:`~ffsm_mj.contact_models.interface.event_fields`.
            closed: All pairs in persistent contact after the event.
        """
        model, data = self._scene.system.mj, self._scene.data
        ended = {pair: pair not in self._closed.by_pair for pair in places}
        names = tuple(pair.name for pair in closed)
        friction = {pair: {} if ended[pair] else self._friction_fields(kind, pair) for pair in places}
        return tuple(
            kind.record(
                pair=pair.name,
                rule=pair.rule,
                geoms=pair.geoms_among(model, data, (contact.feature.at(data).point for contact in place.contact_points)),
                mode="" if ended[pair] else place.mode,
                points=0 if ended[pair] else place.points,
                point_m=tuple(place.centre.tolist()),
                normal=tuple(place.normal.tolist()),
                force_before_N=before[pair],
                force_after_N=0.0 if ended[pair] else place.size,
                impulse_N_s=float(self._values[self._rules[pair.rule], IMPULSE]),
                closed_pairs=names,
                **shared,
                **friction[pair],
            )
            for pair, place in places.items()
        )

    def _friction_fields(self, kind: RecordKind, pair: ContactPair) -> dict[str, Any]:
        """Fields of a record about the friction of a closed pair at the state in ``data``."""
        decision = self._closed.decide() if self._closed.contact_points else None
        friction = decision.of_pairs.by_pair.get(pair) if decision is not None else None
        if friction is None or decision is None:
            return {}
        mode = (RuleMode.SLIDING if friction.is_sliding else RuleMode.STICKING).word
        fields: dict[str, Any] = {"friction": f"{mode}, wedged" if decision.of_pairs.is_wedged(pair) else mode}
        if kind not in FRICTION_KINDS:
            return fields
        use = {"friction_use": friction.use, "slip_speed_m_s": friction.slip_speed, "slip_m": self.friction.slip(pair.rule)}
        return fields | {"friction_N": math.hypot(*friction.force.tolist())} | use


class StepAccount:
    """Accounts for the last (sub-)step of the closed contacts of a scene, from its stages.

    Attributes:
        projected: Exchange by the drift projection at the start of the step; None without one.
    """

    def __init__(
        self,
        scene: Scene,
        closed: ClosedContacts,
        friction: FrictionReport,
        heat: FrictionHeat,
        overlap: DeepestOverlap,
    ) -> None:
        """Initialise before the first step.

        Args:
            scene: The logged system and its data.
            closed: Its closed contacts.
            friction: Columns of slip and heat.
            heat: Heat of friction of the run.
            overlap: Its deepest overlap.
        """
        self._overlap = overlap
        self._system, self._closed, self._friction, self._heat = scene.system, closed, friction, heat
        self.projected: Exchange | None = None
        closed.steady.account_to(overlap.deepest, heat.total_J)
        self._sums: StageSums
        self._last: tuple[Sequence[Stage], FloatArray]
        self._shares_cache: tuple[tuple[tuple[ContactPoint, ...], Motion], Shares, slice] | None = None

    def of_steady_step(self, duration_s: float) -> Exchange | None:
        """Energy and momentum exchanged in a step that ends in a steady state, with all that it adds to columns."""
        # A projection at the start has an exchange of its own, which the shortcut does not enter.
        return None if self.projected is not None else self._closed.steady.exchange(duration_s)

    def exchanged(self, duration_s: float) -> tuple[Exchange | None, Mapping[UnilateralConstraint, float]]:
        """Energy and momentum exchanged, and the impulse of each pair in N s."""
        closed, system, motion = self._closed, self._system, self._closed.motion
        if not closed.pressing:
            return self.projected, {}
        # Signs depend on which bodies are grasped, and thus on the motion.
        key = closed.pressing, motion
        if self._shares_cache is None or self._shares_cache[0] != key:
            self._shares_cache = (
                key,
                Shares.of(system, closed.pressing, motion.grasped_bodies),
                robot_dofs(system, motion),
            )
        stages, parts = self._last = self._stages(duration_s)
        self._sums = StageSums(stages, parts)
        booking, impulses = exchanged(self._sums, stages, parts, *self._shares_cache[1:])
        return sum_exchanges(self.projected, booking), impulses

    def add_friction(self) -> None:
        """Add work, slip and heat to their columns; :meth:`exchanged` must precede."""
        if self._rubs:
            heat_J = self._friction.add_step(self._closed.pressing, *self._last, self._sums.total)
            if heat_J:
                self._heat.add(heat_J)

    def add_overlap(self) -> None:
        """Update the deepest overlap at the state in ``data``; joint limits have columns of their own."""
        points, rows = self._closed.contact_points, self._closed.decide().rows
        # Overlaps of geoms have one column in m, overruns of limits others in rad or m: only with both is the pair of a gap
        # needed.
        if points and not any(pair.is_limit for pair in self._closed.by_pair):
            self._overlap.add(points[0].pair, rows.extremes.lowest)
            return
        for contact, gap in zip(points, rows.gaps, strict=True):
            self._overlap.add(contact.pair, gap)

    def work_without_heat(self, duration_s: float) -> float:
        """Work of all contact forces on all bodies plus the heat of sliding, J; the check of the heat sums it up."""
        if not self._rubs:
            return 0.0
        stages, weights = self._stages(duration_s)
        work = [float(stage.power.sum()) for stage in stages]
        heat = [0.0 if stage.slide is None else float(stage.slide.heat.sum()) for stage in stages]
        return float(weights.dot(np.add(work, heat)))

    @property
    def _rubs(self) -> bool:
        """Whether a pair with friction was closed and contacts carried force."""
        return bool(self._closed.pressing and self._closed.modes.of(self._closed.contact_points).pairs)

    def _stages(self, duration_s: float) -> tuple[Sequence[Stage], FloatArray]:
        """Stages of the step and their quadrature weights, s; the last entry of all is the evaluation at its end."""
        stepper = self._closed.motion.forced_stepper
        assert stepper is not None
        return self._closed.stages[-1 - len(stepper.weights) : -1], duration_s * stepper.weights
