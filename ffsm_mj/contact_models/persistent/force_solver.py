"""Contact forces at the present state under the present efforts, each problem set up once; active sets without friction."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ffsm_mj._core.contacts import ContactAcceleration, FrictionState, StageForces
from ffsm_mj._core.rows import RowEvaluator
from ffsm_mj._core.stages import Smooth
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.point_rows import ContactRows, FrictionalRows, PointRows
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix

_OPENS = 10.0
"""A gap opens, or a force stops pushing, where a gap'' exceeds its rounding by this factor."""
Points: TypeAlias = tuple[ContactPoint, ...]
_Rows = TypeVar("_Rows", bound=PointRows)


class Decision:
    """Contact forces and active set at one state; computed on demand.

    Attributes:
        contact_points: All closed contact points.
        problem: Their complementarity problem.
        rows: Their states and Jacobians.
    """

    def __init__(
        self, contact_points: tuple[ContactPoint, ...], problem: ContactAcceleration, last: Sequence[ContactPoint] = ()
    ) -> None:
        """Store the contact points and their problem; ``last`` is the active set of the last step, which may still hold."""
        self.contact_points, self.problem, self.rows = contact_points, problem, problem.rows
        self._last = last
        self._forces: FloatArray | None = None
        self._pressing: list[int] | None = None

    @property
    def forces(self) -> FloatArray:
        """Non-negative contact forces, shared by redundant contacts by least norm, N, (k,)."""
        if self._forces is None:
            self._forces = self.problem.unilateral_forces(self._indices(self._last))
        return self._forces

    @property
    def pressing(self) -> list[int]:
        """Indices of the contact points that carry force: the active set."""
        if self._pressing is None:
            self._pressing = self.problem.pushing(self.forces)
        return self._pressing

    @property
    def holds_all(self) -> bool:
        """Whether all contact points carry force, as in the step before."""
        return len(self.pressing) == len(self.contact_points)

    def _indices(self, contact_points: Sequence[ContactPoint]) -> list[int]:
        """Indices of some of the contact points, ascending."""
        if contact_points == self.contact_points:
            return list(range(len(contact_points)))
        chosen = set(contact_points)
        return [i for i, contact in enumerate(self.contact_points) if contact in chosen]

    @property
    def held_forces(self) -> FloatArray:
        """Forces in the stages of a step that starts here, N, (k,): of either sign, zero outside the active set."""
        return self.problem.bilateral_forces(self.pressing)

    def changed_by(self, forces: FloatArray) -> Decision:
        """The same active set with the forces changed by (n, t1, t2), N, (k, 3)."""
        other = Decision(self.contact_points, self.problem, self._last)
        other._forces, other._pressing = self.forces + forces[:, 0], self.pressing
        return other

    @property
    def friction(self) -> FloatArray:
        """Friction forces: none, (k, 3)."""
        return np.zeros((len(self.contact_points), 3))

    def leaving(self) -> tuple[ContactPoint, ...]:
        """Contact points whose gap opens, in the order of ``contact_points``: a ``set`` would order them by address."""
        if self.holds_all:
            return ()
        rates = zip(self.contact_points, self._gap_accelerations(self.forces), self.problem.rounding, strict=True)
        return tuple([contact for contact, rate, rounding in rates if rate > _OPENS * rounding])

    def validity_margin(self, held: Sequence[ContactPoint]) -> float:
        """Margin by which an active set still solves the complementarity problem, m/s^2; negative where it does not.

        With redundant contacts an active force may become negative although the motion is unchanged, because the load can be
        redistributed: the set then counts as valid if it gives the same gap'' as the solution of the problem.
        """
        problem, which = self.problem, self._indices(held)
        least = problem.validity(which)
        if least >= 0.0:
            return least
        opening = self._gap_accelerations(problem.bilateral_forces(which))
        allowed = [_OPENS * rounding for rounding in problem.rounding]
        others = zip(opening, self._gap_accelerations(self.forces), allowed, strict=True)
        return float(min([a - max(abs(rate - other), other) for rate, other, a in others]))

    def _gap_accelerations(self, forces: FloatArray) -> list[float]:
        """Gap'' under given forces, m/s^2, (k,)."""
        rates: list[float] = self.problem.gap_accelerations(forces).tolist()
        return rates


class ForceSolver:
    """Problems of contact forces of a motion, and decisions on active sets; the last of each is kept.

    Rows (Jacobians) are kept if only efforts have changed.

    Attributes:
        smooth: Smooth forces on the motion.
        other_forces: Applied forces besides those of persistent contacts, (nv,).
        last_rows: Rows computed last, with their points and place.
        last_problem: Contact problem set up last, with its place and load; without friction.
        last_friction_rows: As ``last_rows``, with friction.
        last_friction_state: Points with friction evaluated last, with their place and load.
        flat: Pairs that are held at three points of a flat patch at least.
    """

    def __init__(self, data: Any, modes: FrictionModes) -> None:
        """Store the data of the logged system, and the friction modes."""
        self._data, self._modes = data, modes
        self.flat: frozenset[UnilateralConstraint] = frozenset()
        self._evaluators: dict[tuple[Any, ...], RowEvaluator] = {}

    def bind(self, motion: Motion) -> None:
        """Use another motion."""
        self._motion, self.smooth = motion, Smooth(motion, self._data)
        self.other_forces = np.zeros(motion.model.nv)
        self.last_rows: tuple[Points, object, ContactRows] | None = None
        self.last_problem: tuple[object, object, ContactAcceleration] | None = None
        self._decision: tuple[object, Decision] | None = None
        self.last_friction_rows: tuple[Points, object, FrictionalRows] | None = None
        self.last_friction_state: tuple[object, object, FrictionState] | None = None
        self._friction_decision: tuple[object, FrictionalDecision] | None = None
        self.forget_points()

    def forget_points(self) -> None:
        """Discard what is kept for certain contact points."""
        self._evaluators.clear()
        self._stage_forces: StageForces | None = None

    def place(self) -> object:
        """Token of the current positions and velocities."""
        return self.smooth.place()

    def problem(self, contact_points: Points) -> ContactAcceleration:
        """Gap accelerations of some contact points."""
        motion, smooth = self._motion, self.smooth
        place, load, known, rows = smooth.place(), smooth.load(self.other_forces), self.last_problem, self.last_rows
        if rows is None or rows[1] is not place or rows[0] != contact_points:
            known, rows = None, (contact_points, place, self._with_loops(self.evaluator(contact_points).rows()))
            self.last_rows = rows
        if known is None or known[0] is not place or known[1] is not load:
            M = partial(mass_matrix, motion.model, motion.data)
            known = place, load, ContactAcceleration(M, rows[2], smooth.force(self.other_forces))
            self.last_problem = known
        return known[2]

    def friction_state(self, contact_points: Points) -> FrictionState:
        """Some contact points with friction, in their modes."""
        smooth, modes = self.smooth, self._modes.of(contact_points)
        place, load, known = smooth.place(), smooth.load(self.other_forces), self.last_friction_state
        if known is not None and known[0] is place and known[1] is load and known[2].modes is modes:
            return known[2]
        rows = self.last_friction_rows
        if rows is None or rows[1] is not place or rows[0] != contact_points:
            found = self._with_loops(self.evaluator(contact_points).frictional_rows())
            rows = self.last_friction_rows = contact_points, place, found
        here = FrictionState(contact_points, rows[2], smooth.force(self.other_forces), modes)
        self.last_friction_state = place, load, here
        return here

    def stage_forces(self, contact_points: Points, *, friction: bool) -> StageForces:
        """Forces of the active set in the stages inside a step."""
        modes, known = self._modes.of(contact_points) if friction else None, self._stage_forces
        if known is None or known.contact_points != contact_points or known.modes is not modes:
            evaluator = self.evaluator(contact_points)
            known = self._stage_forces = StageForces(self.smooth, evaluator, contact_points, modes)
        return known

    def decide(self, contact_points: Points, last: Sequence[ContactPoint]) -> Decision:
        """Which of some contact points carry force; ``last`` is the active set of the last step."""
        state, known = self.smooth.state(self.other_forces), self._decision
        if known is None or known[0] is not state or known[1].contact_points != contact_points:
            known = self._decision = state, Decision(contact_points, self.problem(contact_points), last)
        return known[1]

    def decide_with_friction(self, contact_points: Points) -> FrictionalDecision:
        """Modes of some contact points."""
        state, known = self.smooth.state(self.other_forces), self._friction_decision
        if known is None or known[0] is not state or not known[1].is_for(contact_points, self._modes):
            here = self.friction_state(contact_points)
            known = self._friction_decision = state, FrictionalDecision(here, self._modes)
        return known[1]

    def assume(self, decision: Decision | FrictionalDecision) -> None:
        """Keep a decision as that at the present state under the present efforts."""
        state = self.smooth.state(self.other_forces)
        if isinstance(decision, FrictionalDecision):
            self._friction_decision = state, decision
        else:
            self._decision = state, decision

    def _with_loops(self, rows: _Rows) -> _Rows:
        """Rows as they are with the closed loops of the motion."""
        if self._motion.loops is not None:
            rows.close_loops(self._motion.loops)
        return rows

    def evaluator(self, contact_points: Points) -> RowEvaluator:
        """Evaluator of the rows of some contact points; kept for the present contact points and parts of them."""
        key = contact_points, self.flat
        found = self._evaluators.get(key)
        if found is None:
            found = self._evaluators[key] = RowEvaluator(self._motion, self._data, contact_points, self.flat)
        return found
