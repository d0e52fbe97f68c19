"""Closed contacts and the active set: which contact points carry force, how much, and until when the choice is valid.

At a state under given efforts each problem of forces is set up once, and each decision is made once.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ffsm_mj._core.contacts import ContactEvaluation, StageForces
from ffsm_mj._core.row_evaluator import RowEvaluator
from ffsm_mj._core.rows import PointRows
from ffsm_mj._core.stages import Smooth, dip
from ffsm_mj._core.steady import SteadyContacts
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact.features.search import StoredFeatures
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.clearance import Clearance, Tilts
from ffsm_mj.contact_models.persistent.closing import points_at_rest, slow_points
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint, Patch
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.choice import pressing_without_friction
from ffsm_mj.contact_models.persistent.friction.decision import Decision, step_rule
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.friction.problem import ImplicitSlips, stage_of
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.state import entries
from ffsm_mj.tolerances import (
    DRIFT_M,
    DRIFT_M_S,
    FEATURE_BOUND_M,
    LIFT_OFF_M,
)

Points: TypeAlias = tuple[ContactPoint, ...]
_AT_BOUND = 0.9
"""A drift that ends a step has reached this share of its bound, however a replay rounds; see ``before_drift``."""
_PATCH_POINTS = 3
"""Contact points of two convex geoms are corners of a convex polygon or ends of a line: three are not on a line."""


class ForceSolver:
    """Problems of contact forces of a motion, and decisions on modes; the last of each is kept.

    Rows (Jacobians) are kept if only efforts have changed.

    Attributes:
        smooth: Smooth forces on the motion.
        other_forces: Applied forces besides those of persistent contacts, (nv,).
        last_rows: Rows computed last, with their points and the token of their state.
        last_evaluation: Points evaluated last, with the tokens of their state and load.
        flat: Patches that are held at three points at least; see :attr:`.contact_points.ContactPoint.flat_on`.
    """

    def __init__(self, data: Any, modes: FrictionModes) -> None:
        """Store the data of the logged system, and the friction modes."""
        self._data, self._modes = data, modes
        self.flat: frozenset[Patch] = frozenset()
        self._evaluators: dict[tuple[Any, ...], RowEvaluator] = {}

    def bind(self, motion: Motion) -> None:
        """Use another motion."""
        self._motion, self.smooth = motion, Smooth(motion, self._data)
        self.other_forces = np.zeros(motion.model.nv)
        self._loops = motion.loops
        self.forget_state()
        self.forget_points()

    def forget_state(self) -> None:
        """Discard what is kept for the last state."""
        self.last_rows: tuple[Points, object, PointRows] | None = None
        self.last_evaluation: tuple[object, object, ContactEvaluation] | None = None
        self._decision: tuple[object, Decision] | None = None
        self._stage_forces: StageForces | None = None

    def forget_points(self) -> None:
        """Discard what is kept for certain contact points."""
        self._evaluators.clear()
        self._stage_forces = None

    def kinematics(self) -> object:
        """Token of the current positions and velocities."""
        return self.smooth.kinematics()

    def _follow_loops(self) -> None:
        """Discard what is kept where the motion holds other rows now, as of joints that have come to rest at this state."""
        if self._motion.loops is not self._loops:
            self._loops = self._motion.loops
            self.forget_state()
            self._modes.forget_structures()

    def evaluation(self, contact_points: Points) -> ContactEvaluation:
        """The contact problem of some contact points in their modes."""
        self._follow_loops()
        smooth, modes = self.smooth, self._modes.of(contact_points)
        kinematics, load, known = smooth.kinematics(), smooth.load(self.other_forces), self.last_evaluation
        # The modes, too: an event may have put others at the same state under the same efforts.
        if known is not None and known[0] is kinematics and known[1] is load and known[2].modes is modes:
            return known[2]
        rows = self.last_rows
        # By value: the active set may be another tuple of the same points, whose rows are these.
        if rows is None or rows[1] is not kinematics or rows[0] != contact_points:
            rows = self.last_rows = contact_points, kinematics, self._rows(contact_points)
        now = ContactEvaluation(contact_points, rows[2], smooth.force(self.other_forces), modes)
        self.last_evaluation = kinematics, load, now
        return now

    def falls(self, contact_points: Points, others: Points) -> FloatArray:
        """Accelerations with which gaps of other points close while some contact points alone carry force, m/s^2, (k,).

        None of them has friction.
        """
        problem, count = self.evaluation((*contact_points, *others)).problem, len(contact_points)
        forces = pressing_without_friction(problem, count)
        return np.asarray(-(problem.b[::3] + problem.G[::3, ::3] @ forces)[count:])

    def stage_forces(self, contact_points: Points) -> StageForces:
        """Forces of the active set in the stages inside a step."""
        modes, known = self._modes.of(contact_points), self._stage_forces
        if known is None or known.contact_points != contact_points or known.modes is not modes:
            evaluator = self.evaluator(contact_points)
            known = self._stage_forces = StageForces(self.smooth, evaluator, contact_points, modes)
        return known

    def decide(self, contact_points: Points) -> Decision:
        """Which of some contact points carry force, and their modes."""
        self._follow_loops()
        state, known = self.smooth.state(self.other_forces), self._decision
        if known is None or known[0] is not state or not known[1].is_for(contact_points, self._modes):
            known = self._decision = state, Decision(self.evaluation(contact_points), self._modes)
        return known[1]

    def assume(self, decision: Decision) -> None:
        """Keep a decision as that at the present state under the present efforts."""
        self._follow_loops()
        self._decision = self.smooth.state(self.other_forces), decision

    def _rows(self, contact_points: Points) -> PointRows:
        """Rows of some contact points, with the closed loops of the motion."""
        rows = self.evaluator(contact_points).rows()
        if self._motion.loops is not None:
            rows.close_loops(self._motion.loops)
        return rows

    def evaluator(self, contact_points: Points) -> RowEvaluator:
        """Evaluator of the rows of some contact points; kept for the present contact points and parts of them."""
        key = contact_points, self.flat
        known = self._evaluators.get(key)
        if known is None:
            known = self._evaluators[key] = RowEvaluator(self._motion, self._data, contact_points, self.flat)
        return known


class ClosedContacts:
    """Closed contacts and joints at limits of a motion, and the active set among them.

    Attributes:
        motion: The current motion.
        by_pair: Contact points of each closed pair or joint limit; changed by :meth:`set_points` and :meth:`remove`.
        contact_points: All of them, pair by pair.
        pressing: The active set: contact points constrained in the stages of a step.
        stages: Contact forces of the stages since the start of the step.
        modes: Friction modes of the contact points.
        solver: Contact forces at the present state.
        clearance: Clearance of closed pairs outside their contact points.
        opens: Whether a gap is known to open at the state in ``data``, as a log says.
        settles: Whether points that separate slowly have been kept, whose rates the next projection takes away.
        steady: Shortcut through steady states.
    """

    def __init__(self, scene: Scene) -> None:
        """Initialise with no closed contacts."""
        self._scene, self._model = scene, scene.system.mj
        self.motion: Motion
        self.by_pair: dict[UnilateralConstraint, tuple[ContactPoint, ...]] = {}
        self.contact_points: tuple[ContactPoint, ...] = ()
        self.pressing: tuple[ContactPoint, ...] = ()
        self.stages: list[Stage] = []
        self.modes, self.opens, self.settles = FrictionModes(), False, False
        self.solver, self.clearance = ForceSolver(scene.data, self.modes), Clearance(scene)
        self._tilts = Tilts(scene.data)
        self._chosen: Decision | None = None
        self._slips: ImplicitSlips
        self.steady = SteadyContacts(self, scene.system)

    @dataclass
    class State:
        """Contact points and modes of closed pairs and limits.

        Attributes:
            closed: Name of each with its features and their patches, in order.
            joined: What each pair of them has joined; see :meth:`ContactPair.joining`.
            pressing: Places of the points that carry force among all of them.
            flat: Patches that carried force at enough points, be it at others than now: names of pair and patch.
            modes: Friction modes of the points.
            in_step: Whether a step since the last event has ended here: the forces at its end are known.
            settles: See :attr:`ClosedContacts.settles`.
        """

        closed: list[tuple[str, list[Any], list[str]]]
        joined: list[Any]
        pressing: list[int]
        flat: list[tuple[str, str]]
        modes: Any
        in_step: bool
        settles: bool

    def get_state(self) -> State:
        """The closed contacts."""
        stored = StoredFeatures(self._model)
        closed = [
            (
                pair.name,
                [None if pair.is_limit else stored.to_plain(point.feature) for point in points],
                [point.patch for point in points],
            )
            for pair, points in self.by_pair.items()
        ]
        place = {contact: i for i, contact in enumerate(self.contact_points)}
        # A point of the active set may have been removed at this state, where its gap opened.
        pressing = [place[point] for point in self.pressing if point in place]
        flat = sorted((pair.name, patch) for pair, patch in self.solver.flat)
        joined = [None if pair.is_limit else pair.joining() for pair in self.by_pair]
        modes, in_step = self.modes.get_state(self.contact_points), bool(self.stages)
        return self.State(closed, joined, pressing, flat, modes, in_step, self.settles)

    def set_state(self, state: Any, pairs: Mapping[str, UnilateralConstraint]) -> None:
        """Close contacts at the state in ``data``.

        Args:
            state: The contacts.
            pairs: All pairs and limits by name.

        Raises:
            StateError: They do not fit.
        """
        values, stored = entries(state, self.State), StoredFeatures(self._model)
        self.by_pair.clear()
        for name, kept, patches in values["closed"]:
            pair = pairs[name]
            self.by_pair[pair] = tuple(
                ContactPoint(pair, pair.feature if pair.is_limit else stored.from_plain(feature), patch)
                for feature, patch in zip(kept, patches, strict=True)
            )
        self._follow_points()
        for pair, joined in zip(self.by_pair, values["joined"], strict=True):
            if not pair.is_limit and joined is not None:
                pair.set_joining(joined)
        self.set_pressing(tuple(self.contact_points[i] for i in values["pressing"]))
        # After set_pressing, which counts the points that press now: the run may have found the patch at others.
        self.solver.flat = frozenset((pairs[name], patch) for name, patch in values["flat"])
        self.modes.set_state(values["modes"], self.contact_points)
        self._chosen, self.settles = None, values["settles"]
        self.stages.clear()

    @property
    def data(self) -> Any:
        """MuJoCo data of the logged system."""
        return self._scene.data

    @property
    def last_stage(self) -> Stage | None:
        """Contact forces at the end of the last step; None without a step since the last event."""
        return self.stages[-1] if self.stages else None

    def bind(self, motion: Motion) -> None:
        """Use another motion, with all caches cleared."""
        # Rows, structures and stages are in the coordinates of one motion: none of them serves another.
        self.motion, self._chosen = motion, None
        self.solver.bind(motion)
        self.clearance.forget()
        self.modes.forget_structures()
        self.stages.clear()

    def set_points(self, pair: UnilateralConstraint, contact_points: Sequence[ContactPoint]) -> None:
        """Set the contact points of a pair; none if it is about to open."""
        self.by_pair[pair] = tuple(contact_points)
        self._follow_points()
        self.join(pair)

    def remove(self, pair: UnilateralConstraint) -> None:
        """Remove a pair."""
        del self.by_pair[pair]
        if not pair.is_limit:
            pair.hold(())
        self._follow_points()

    def _follow_points(self) -> None:
        self.modes.forget_structures()
        self.contact_points = tuple(contact for contact_points in self.by_pair.values() for contact in contact_points)
        self.solver.forget_points()
        self.clearance.set_pairs(self.by_pair)
        for pair, contact_points in self.by_pair.items():
            if not pair.is_limit:
                pair.hold([contact.feature for contact in contact_points])
        self._tilts.set_closed(self.contact_points)

    def add_closed(self, pair: UnilateralConstraint, patches: Sequence[tuple[Proximity, float]]) -> None:
        """Set the contact points of a pair to those found at the current state, patch by patch.

        See :func:`points_at_rest`.
        """
        points = [point for near, still in patches for point in points_at_rest(self._scene, pair, near, still)]
        self.set_points(pair, points)

    def join(self, pair: UnilateralConstraint) -> None:
        """Watch the pieces of two unions that touch at the state in ``data`` by their contact points, from here on."""
        if not pair.is_limit and self.by_pair[pair]:
            pair.join(self._model, self.data)

    def keep_slow_points(self, pairs: Sequence[tuple[UnilateralConstraint, Proximity]]) -> None:
        """Also close contact points that separate so slowly that the load would stop them below ``LIFT_OFF_M``.

        Otherwise a block that rocks from corner to corner would do so for ever, at heights below rounding (Zeno behaviour).
        """
        slow, points = slow_points(self._scene, pairs, self.contact_points), self.contact_points
        if not slow:
            return
        # Of all that separate, while the others hold: these may leave a light body only a heavy way to move.
        falls = self.solver.falls(points, tuple(contact for contact, _ in slow))
        for (contact, rate), b in zip(slow, falls.tolist(), strict=True):
            # Under a constant deceleration b the gap peaks at rate^2 / (2 b).
            if rate**2 <= 2.0 * b * LIFT_OFF_M:
                self.set_points(contact.pair, (*self.by_pair.get(contact.pair, ()), contact))
                self.settles = True

    def push(self, data: Any) -> None:
        """Add the forces of the active set to ``data.qfrc_applied``, which already holds all other applied forces."""
        applied, solver, stepper = data.qfrc_applied, self.solver, self.motion.forced_stepper
        assert stepper is not None
        # Inside a step the modes are fixed, so that it integrates a smooth ODE: only rows and forces change with the stage.
        if stepper.inside:
            if self.pressing:
                self.stages.append(solver.stage_forces(self.pressing).add(applied))
            return
        # All other sources have pushed by now: what is applied is the load on the contacts.
        solver.other_forces = applied.copy()
        if not self.pressing:
            return
        evaluation = solver.evaluation(self.pressing)
        # At the nodes of an implicit step friction and slips depend on each other; elsewhere forces follow from the state.
        if stepper.stage is None:
            stage, generalised = stage_of(evaluation)
        else:
            if stepper.stage.stiff is None:
                stepper.stage.stiff = self._slips = ImplicitSlips(evaluation)
            stage, generalised = self._slips.stage_of(evaluation, stepper.stage.node)
        applied += generalised
        # An implicit step evaluates each node in several passes: the balance integrates the last one.
        if stepper.repeats:
            self.stages[stepper.repeats] = stage
        else:
            self.stages.append(stage)

    def see_other_forces(self) -> None:
        """Take the applied forces of all others at the state in ``data``, which a step without contact does not tell."""
        applied = self.motion.data.qfrc_applied
        pushed = applied.copy()
        applied.fill(0.0)
        for push in self.motion.pushes:
            push(self.motion.data)
        self.solver.other_forces = applied.copy()
        applied[:] = pushed

    def decide(self) -> Decision:
        """Solve for the contact points that carry force at the state in ``data`` under its efforts."""
        return self.solver.decide(self.contact_points)

    def leaving(self) -> tuple[ContactPoint, ...]:
        """Contact points whose gap acceleration is positive: they open."""
        # Where a body rocks to rest all points are held first: one end alone at rest would turn it onto the other again.
        if self.settles or not self.contact_points:
            return ()
        return self.decide().leaving(reached=self.opens)

    def update_pressing(self) -> None:
        """Set the active set to the contact points that carry force at the state in ``data``."""
        decision = self.decide() if self.contact_points else None
        if decision is None or decision.is_settled:
            pressing = self.contact_points
        else:
            pressing = tuple([decision.contact_points[i] for i in decision.pressing])
        if pressing != self.pressing:
            self.set_pressing(pressing)
        self._chosen = decision
        if self._chosen is not None:
            self._chosen.keep_modes()
        self._tilts.begin_step()

    @property
    def may_be_steady(self) -> bool:
        """Whether :attr:`steady` knows all that bounds a step: not tilts, joint limits, closed loops and dry friction."""
        closed = all(contact_points and not pair.is_limit for pair, contact_points in self.by_pair.items())
        others = self.motion.loops is not None or self.motion.rubs or self._tilts.bound_steps
        return closed and not others and self.contact_points != () and self.pressing in (self.contact_points, ())

    def begin_steady_step(self) -> None:
        """Begin an explicit step with the active set of the step before, in which no point slides."""
        self._chosen = None
        self.stages.clear()
        assert self.motion.forced_stepper is not None
        self.motion.forced_stepper.implicit = False

    def set_pressing(self, pressing: tuple[ContactPoint, ...]) -> None:
        """Set the active set."""
        self.pressing = pressing
        count_of = Counter(contact.flat_on for contact in pressing)
        # The points of a flat patch share one normal: those of each would let tilts grow without bound where the patch
        # shrinks to a line (_in_patch in contact_points.py).
        self.solver.flat = frozenset(on for on, points in count_of.items() if points >= _PATCH_POINTS)
        self._tilts.set_points(pressing)

    def plan_step(self, left_s: float) -> float:
        """Longest (sub-)step from the state in ``data``, s; sets whether its stages are implicit.

        Args:
            left_s: Remaining time of the grid step, s.
        """
        stepper = self.motion.forced_stepper
        if stepper is None:
            return left_s
        stepper.implicit, limit = False, left_s
        if self._tilts.bound_steps:
            limit = min(limit, self._tilts.step_limit(left_s))
        if self._chosen is not None:
            modes = self.modes
            # A jump of the efforts begins a layer: any change of them counts (docs/derivations.md).
            limit, stepper.implicit, modes.layers = step_rule(
                self._chosen, modes.layers, limit, self.motion.data.time, self.data.ctrl.tobytes()
            )
        return limit

    def witness_value(self, *, exact: bool = False) -> float:
        """Witness function of the active set: positive while it is valid at the state in ``data``, negative after a change.

        Valid means: active contact points push, the others do not accelerate into contact, every contact point is within
        its feature, no gap has drifted and no rim has tilted too far, and no pair touches at another point.

        Args:
            exact: Whether sticking points are valid up to the limit of friction only, at which they are released.
        """
        if not self.contact_points:
            return math.inf
        decision = self.decide()
        inside, gap, rate, _ = decision.rows.extremes
        # All terms are continuous in time, as bracketing needs; their units differ, but only the sign counts.
        # Beyond the bound of a feature, not at it: without hysteresis a contact there would change its feature at each
        # evaluation.
        bounds = inside + FEATURE_BOUND_M, DRIFT_M - gap, DRIFT_M_S - rate, *self._tilts.margins()
        return min(*bounds, self._clearance_elsewhere(decision), decision.validity_margin(exact=exact))

    def dip_s(self) -> float:
        """Time in the last step at which a contact force may be outside its bounds although it is inside at both ends, s.

        0: at none. In an implicit step only its end is looked at.
        """
        stepper = self.motion.forced_stepper
        # The parabola is that of the stages of RK4: start, twice the middle, end. Radau IIA has no node at the start.
        if not self.pressing or stepper is None or stepper.implicit:
            return 0.0
        share = dip(self.stages[-1 - len(stepper.weights) :], self.modes.of(self.pressing).stick_mu)
        return share * float(self.motion.data.time - self.motion.path.start[0])

    def is_settled(self) -> bool:
        """Whether no contact point opens, leaves its feature or changes its mode, and no pair touches at another point."""
        # A pair without points has nothing that could change any more, but its end is due.
        if not self.contact_points or not all(self.by_pair.values()):
            return False
        decision = self.decide()
        if not decision.is_settled or decision.rows.extremes.inside < -FEATURE_BOUND_M:
            return False
        return self._clearance_elsewhere(decision) >= 0.0 and self._tilts.least_rise() >= 0.0

    def note_release(self, *, slips: bool = False) -> None:
        """Note whether sticking points are at the limit of friction at the state in ``data``: they slide from there.

        Args:
            slips: Whether a pair is known to slip here; the forces are then at the limit even if rounding puts them inside.
        """
        if self.contact_points:
            decision = self.decide()
            # Forces at a logged slip may be inside their cones by the rounding of the state: the replay has to follow the
            # run.
            self.modes.released = decision.releases or (slips and decision.validity_margin() >= 0.0)

    def _clearance_elsewhere(self, decision: Decision | None) -> float:
        """Least clearance of closed pairs outside their active contact points, m."""
        largest = decision.rows.extremes.gap if decision is not None else 0.0
        return self.clearance.least(self.solver.kinematics(), largest, self.gaps_of)

    def gaps_of(self, pair: ContactPair) -> list[float]:
        """Gaps of the contact points of a pair, m."""
        if not self.by_pair[pair]:
            return []
        decision = self.decide()
        gaps = zip(decision.contact_points, decision.rows.gaps, strict=True)
        return [gap for contact, gap in gaps if contact.pair is pair]

    def touches_elsewhere(self) -> bool:
        """Whether a closed pair touches at a point other than its contact points, as a cap does that has fallen flat."""
        decision = self.decide() if self.contact_points else None
        # A cap that has fallen flat touches all round its rim before any other point of it overlaps.
        return self._clearance_elsewhere(decision) < 0.0 or self._tilts.least_rise() < 0.0

    def overlapping_features(self) -> list[Feature]:
        """Features other than the contact points, by which closed pairs overlap."""
        return self.clearance.overlapping_features(self.gaps_of)

    def states_of(self, pair: UnilateralConstraint) -> list[tuple[ContactPoint, FeatureState]]:
        """Contact points of a closed pair with their states."""
        return [(contact, contact.feature.at(self.data)) for contact in self.by_pair.get(pair, ())]

    def pairs_outside_feature(self) -> list[UnilateralConstraint]:
        """Pairs with a contact point outside its feature."""
        if not self.contact_points or self.decide().rows.extremes.inside >= -FEATURE_BOUND_M:
            return []
        return self._pairs_where(lambda rows: [inside < -FEATURE_BOUND_M for inside in rows.insides])

    def pairs_with_drift(self) -> list[UnilateralConstraint]:
        """Pairs with a gap, or its rate, that has drifted to the limit of a step."""
        gaps = self._pairs_where(lambda rows: [abs(gap) > _AT_BOUND * DRIFT_M for gap in rows.gaps])
        rates = self._pairs_where(lambda rows: [abs(rate) > _AT_BOUND * DRIFT_M_S for rate in rows.rates])
        return list(dict.fromkeys([*gaps, *rates]))

    def pairs_with_tilt(self) -> list[UnilateralConstraint]:
        """Pairs with a rim whose tilt has changed to the limit of a step."""
        return self._tilts.pairs_at_limit()

    def _pairs_where(self, holds: Callable[[PointRows], list[bool]]) -> list[UnilateralConstraint]:
        if not self.contact_points:
            return []
        decision = self.decide()
        beyond = zip(decision.contact_points, holds(decision.rows), strict=True)
        return list(dict.fromkeys([contact.pair for contact, is_beyond in beyond if is_beyond]))
