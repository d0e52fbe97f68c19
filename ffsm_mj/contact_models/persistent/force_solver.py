"""Contact forces at the present state under the present efforts: each problem is set up once, each decision made once."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from ffsm_mj._core.contacts import ContactEvaluation, StageForces
from ffsm_mj._core.rows import RowEvaluator
from ffsm_mj._core.stages import Smooth
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.choice import pressing_without_friction
from ffsm_mj.contact_models.persistent.friction.decision import Decision
from ffsm_mj.contact_models.persistent.friction.modes import FrictionModes
from ffsm_mj.contact_models.persistent.point_rows import PointRows
from ffsm_mj.dynamics.motion import Motion

Points: TypeAlias = tuple[ContactPoint, ...]


class ForceSolver:
    """Problems of contact forces of a motion, and decisions on modes; the last of each is kept.

    Rows (Jacobians) are kept if only efforts have changed.

    Attributes:
        smooth: Smooth forces on the motion.
        other_forces: Applied forces besides those of persistent contacts, (nv,).
        last_rows: Rows computed last, with their points and place.
        last_evaluation: Points evaluated last, with their place and load.
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
        self.last_rows: tuple[Points, object, PointRows] | None = None
        self.last_evaluation: tuple[object, object, ContactEvaluation] | None = None
        self._decision: tuple[object, Decision] | None = None
        self.forget_points()

    def forget_points(self) -> None:
        """Discard what is kept for certain contact points."""
        self._evaluators.clear()
        self._stage_forces: StageForces | None = None

    def place(self) -> object:
        """Token of the current positions and velocities."""
        return self.smooth.place()

    def evaluation(self, contact_points: Points) -> ContactEvaluation:
        """The contact problem of some contact points in their modes."""
        smooth, modes = self.smooth, self._modes.of(contact_points)
        place, load, known = smooth.place(), smooth.load(self.other_forces), self.last_evaluation
        if known is not None and known[0] is place and known[1] is load and known[2].modes is modes:
            return known[2]
        rows = self.last_rows
        if rows is None or rows[1] is not place or rows[0] != contact_points:
            rows = self.last_rows = contact_points, place, self._rows(contact_points)
        here = ContactEvaluation(contact_points, rows[2], smooth.force(self.other_forces), modes)
        self.last_evaluation = place, load, here
        return here

    def pressing_accelerations(self, contact_points: Points) -> FloatArray:
        """Contribution of each normal force to gap'' at its own contact point if none had friction, m/s^2, (k,)."""
        problem = self.evaluation(contact_points).problem
        return pressing_without_friction(problem) * problem.inverse_mass

    def stage_forces(self, contact_points: Points) -> StageForces:
        """Forces of the active set in the stages inside a step."""
        modes, known = self._modes.of(contact_points), self._stage_forces
        if known is None or known.contact_points != contact_points or known.modes is not modes:
            evaluator = self.evaluator(contact_points)
            known = self._stage_forces = StageForces(self.smooth, evaluator, contact_points, modes)
        return known

    def decide(self, contact_points: Points) -> Decision:
        """Which of some contact points carry force, and their modes."""
        state, known = self.smooth.state(self.other_forces), self._decision
        if known is None or known[0] is not state or not known[1].is_for(contact_points, self._modes):
            known = self._decision = state, Decision(self.evaluation(contact_points), self._modes)
        return known[1]

    def assume(self, decision: Decision) -> None:
        """Keep a decision as that at the present state under the present efforts."""
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
        found = self._evaluators.get(key)
        if found is None:
            found = self._evaluators[key] = RowEvaluator(self._motion, self._data, contact_points, self.flat)
        return found
