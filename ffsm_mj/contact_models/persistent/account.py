"""Account of a (sub-)step of the closed contacts of a scene, from its stages: what is exchanged, slip, heat and overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ffsm_mj._core.stages import StageSums
from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.impact.deepest_overlap import DeepestOverlap
from ffsm_mj.contact_models.impact.friction_heat import FrictionHeat
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.exchange import Shares, Stage, exchanged, robot_dofs
from ffsm_mj.contact_models.persistent.friction.report import FrictionReport
from ffsm_mj.contact_models.state_projection import sum_exchanges
from ffsm_mj.dynamics.motion import Motion


class StepAccount:
    """Accounts for the last (sub-)step of the closed contacts of a scene, from its stages.

    Attributes:
        projected: Exchange by the drift projection at the start of the step; None without one.
    """

    def __init__(
        self,
        scene: Scene,
        closed: ActiveContactSet,
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
        self._system, self._active_set, self._friction, self._heat = scene.system, closed, friction, heat
        self.projected: Exchange | None = None
        closed.steady.account_to(overlap.deepest, heat.total_J)
        self._sums: StageSums
        self._last: tuple[Sequence[Stage], FloatArray]
        self._shares_cache: tuple[tuple[tuple[ContactPoint, ...], Motion], Shares, slice] | None = None

    def of_steady_step(self, duration_s: float) -> Exchange | None:
        """Energy and momentum exchanged in a step that ends in a steady state, with all that it adds to columns."""
        return None if self.projected is not None else self._active_set.steady.exchange(duration_s)

    def exchanged(self, duration_s: float) -> tuple[Exchange | None, Mapping[UnilateralConstraint, float]]:
        """Energy and momentum exchanged, and the impulse of each pair in N s."""
        closed, system, motion = self._active_set, self._system, self._active_set.motion
        if not closed.pressing:
            return self.projected, {}
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
            heat_J = self._friction.add_step(self._active_set.pressing, *self._last, self._sums.total)
            if heat_J:
                self._heat.add(heat_J)

    def add_overlap(self) -> None:
        """Update the deepest overlap at the state in ``data``; joint limits have columns of their own."""
        points, rows = self._active_set.contact_points, self._active_set.decide().rows
        if points and not any(isinstance(pair, JointLimit) for pair in self._active_set.by_pair):
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
        closed = self._active_set
        return bool(closed.pressing and closed.modes.of(closed.contact_points).pairs)

    def _stages(self, duration_s: float) -> tuple[Sequence[Stage], FloatArray]:
        """Stages of the step and their quadrature weights, s; the last entry of all is the evaluation at its end."""
        flight = self._active_set.motion.forced
        assert flight is not None
        return self._active_set.stages[-1 - len(flight.weights) : -1], duration_s * flight.weights
