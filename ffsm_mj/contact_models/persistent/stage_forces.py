"""Contact forces in the stages inside a step: of points whose modes are frozen for the step.

States inside a step are evaluated once. What decisions need of the states at the ends of steps, and what is kept between
these, is in :mod:`.force_solver`.
"""

from __future__ import annotations

from functools import partial

from ffsm_mj.arrays import FloatArray
from ffsm_mj.compiled import fastest
from ffsm_mj.contact_models.persistent.acceleration import ContactAcceleration
from ffsm_mj.contact_models.persistent.exchange import Stage, TwistStage
from ffsm_mj.contact_models.persistent.friction.point_modes import PointModes
from ffsm_mj.contact_models.persistent.friction.stage import stage_of
from ffsm_mj.contact_models.persistent.friction.state import FrictionState
from ffsm_mj.contact_models.persistent.holds.held_twists import HeldTwists
from ffsm_mj.contact_models.persistent.rows import ContactPoint, RowEvaluator
from ffsm_mj.contact_models.persistent.smooth import Smooth
from ffsm_mj.dynamics.rigid_body import mass_matrix


class StageForces:
    """Contact forces of some points in the modes of a step.

    Attributes:
        contact_points: The points: the active set.
        modes: Their modes; None without friction.
    """

    def __init__(
        self, smooth: Smooth, evaluator: RowEvaluator, contact_points: tuple[ContactPoint, ...], modes: PointModes | None
    ) -> None:
        """Store the points.

        Args:
            smooth: Smooth forces on the motion.
            evaluator: Evaluator of the rows of the points.
            contact_points: See the attributes.
            modes: See the attributes.
        """
        self._smooth, self._evaluator, self.contact_points, self.modes = smooth, evaluator, contact_points, modes
        self._state_kind, self._problem_kind = fastest(FrictionState), fastest(ContactAcceleration)
        self._start: FloatArray | None = None
        self._twists = HeldTwists.of(smooth.motion, evaluator.data, contact_points, modes)
        self._holds_twists = modes is None

    def begin(self, points: FloatArray) -> None:
        """Begin a step at the current state, with the contact points there, m, (k, 3); required with friction."""
        if self._twists is not None and points is not self._start:
            self._start, self._holds_twists = points, self._twists.begin(points)

    def add(self, applied: FloatArray) -> Stage | TwistStage:
        """Add the forces at the current state to the applied ones, (nv,), and return the stage; explicit stages only."""
        stage, generalised = self._evaluate(self._smooth.force(applied))
        applied += generalised
        return stage

    def _evaluate(self, force: FloatArray) -> tuple[Stage | TwistStage, FloatArray]:
        motion, evaluator = self._smooth.motion, self._evaluator
        if self._twists is not None and self._holds_twists:
            return self._twists.stage(force)
        if self.modes is not None:
            tangential = evaluator.frictional_rows()
            if motion.loops is not None:
                tangential.close_loops(motion.loops)
            return stage_of(self._state_kind(self.contact_points, tangential, force, self.modes))
        rows = evaluator.rows()
        if motion.loops is not None:
            rows.close_loops(motion.loops)
        M = partial(mass_matrix, motion.model, motion.data)
        return self._problem_kind(M, rows, force).stage(motion.data.qvel)
