"""Account of the last (sub-)step of persistent contact: energy and momentum exchanged, impulses, slip and heat.

The stages of a step constrain the active set chosen at its start. If contacts are redundant, their forces are of least norm,
and one of them may become negative without changing the motion. The logged force of a pair is of least norm among the
non-negative ones; as a function of time it has a kink where a contact enters or leaves that distribution. Quadrature over a
kink is only second order, so the step is split there, and each piece is integrated by Simpson's rule along its path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

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
from ffsm_mj.contact_models.persistent.force_solver import Decision
from ffsm_mj.contact_models.persistent.friction.report import FrictionReport
from ffsm_mj.contact_models.state_projection import sum_exchanges
from ffsm_mj.dynamics.motion import Motion

_SHARE_CHANGE = 1e-9
"""Relative change of a force at the end of a step below which its kink came so late that the impulse error is rounding."""
_OTHER_MOTION = 1e-8
"""Generalised force of a redistribution over that of its parts: they cancel to rounding, which a redundant set amplifies."""
_ALONG_JOINT = np.array((1.0, 0.0, 0.0))
"""Direction that stands for the joint of a limit, whose force has none in space."""
_SHARP = 1e-6
"""Accuracy of a kink as a fraction of the step; the error of the impulse is of the order of its square."""


class Pieces(NamedTuple):
    """Quadrature nodes and weights for impulses along a step.

    Attributes:
        contact_points: The contact points.
        stages: Their forces at each node.
        weights_s: Weight of each node, s.
    """

    contact_points: tuple[ContactPoint, ...]
    stages: list[Stage]
    weights_s: list[float]


def pieces(closed: ActiveContactSet, motion: Motion, duration_s: float) -> Pieces | None:
    """Quadrature of the last step, split at the kinks of the forces; None if there are none.

    Args:
        closed: The closed contacts, at the end of the step.
        motion: The current motion; its state is restored.
        duration_s: Length of the step.
    """
    if closed.has_friction or sum(map(bool, closed.by_pair.values())) < 2 or not _shares_change(closed):
        return None
    path, data = motion.path, motion.data
    kept = path.at_s, data.qpos.copy(), data.qvel.copy(), list(closed.stages)
    path.at_s = math.nan
    ends = [0.0, *_kinks(closed, motion, duration_s), duration_s]
    stages, weights = [], []
    for start, end in pairwise(ends):
        for at, part in ((start, 1.0), (0.5 * (start + end), 4.0), (end, 1.0)):
            path.move_to(at)
            stages.append(_stage(closed, data.qvel))
            weights.append((end - start) * part / 6.0)
    path.at_s, qpos, qvel, closed.stages[:] = kept
    if not (np.array_equal(qpos, data.qpos) and np.array_equal(qvel, data.qvel)):
        motion.go_to(qpos, qvel)  # a log replay continues from the logged state, which the path reproduces only to rounding
    return Pieces(closed.contact_points, stages, weights)


def _shares_change(closed: ActiveContactSet) -> bool:
    """Whether redundant contacts redistribute their load: active set and non-negative forces, of equal effect, differ."""
    decision = closed.decide()
    assert isinstance(decision, Decision)
    held = decision.problem.bilateral_forces([decision.contact_points.index(contact) for contact in closed.pressing])
    if decision.forces is held:
        return False
    apart = np.abs(decision.forces - held)
    allowed = _SHARE_CHANGE * (1.0 + float(np.abs(decision.forces).max(initial=0.0)))
    if apart.max(initial=0.0) <= allowed:
        return False
    # Redistribution leaves the motion as it is. A contact that opens within a trial step does not: the step as it was made
    # has a tensile force there, which is what moved the bodies, and the step will end at the opening.
    effect, J = decision.forces - held, decision.rows.J
    if np.abs(effect.dot(J)).max() > _OTHER_MOTION * np.abs(effect).dot(np.abs(J)).max():
        return False
    # Redistribution among the points of one pair does not change its resultant, which alone is logged.
    changes: dict[object, FloatArray] = {}
    for contact, here, change in zip(
        decision.contact_points, decision.rows.states, (decision.forces - held).tolist(), strict=True
    ):
        along = _ALONG_JOINT if isinstance(contact.pair, JointLimit) else here.normal
        changes[contact.pair] = changes.get(contact.pair, np.zeros(3)) + change * along
    return any(math.hypot(*change.tolist()) > allowed for change in changes.values())


def _kinks(closed: ActiveContactSet, motion: Motion, duration_s: float) -> list[float]:
    """Times at which the set of contacts with force changes, s since the start of the step."""
    last, found = _pressing(closed, motion, duration_s), list[float]()
    here = _pressing(closed, motion, 0.0)
    while here != last and len(found) <= len(closed.contact_points):
        low, high = (found or [0.0])[-1], duration_s
        while high - low > _SHARP * duration_s:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _pressing(closed, motion, middle) == here else (low, middle)
        found.append(high)
        here = _pressing(closed, motion, high)
    return found


def _pressing(closed: ActiveContactSet, motion: Motion, time_s: float) -> Sequence[int]:
    motion.path.move_to(time_s)
    return closed.decide().pressing


def _stage(closed: ActiveContactSet, rates: FloatArray) -> Stage:
    """Non-negative contact forces at the current state of the motion."""
    decision = closed.decide()
    return Stage(decision.rows, decision.forces, decision.forces.dot(decision.rows.J) * rates)


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
        redistributed = pieces(closed, motion, duration_s)
        if redistributed is not None:
            shares = Shares.of(system, redistributed.contact_points, motion.grasped_bodies)
            parts = np.array(redistributed.weights_s)
            sums = StageSums(redistributed.stages, parts)
            booking, impulses = exchanged(sums, redistributed.stages, parts, shares, robot_dofs(system, motion))
            return sum_exchanges(self.projected, booking), impulses
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
        return bool(self._active_set.has_friction and self._active_set.pressing)

    def _stages(self, duration_s: float) -> tuple[Sequence[Stage], FloatArray]:
        """Stages of the step and their quadrature weights, s; the last entry of all is the evaluation at its end."""
        flight = self._active_set.motion.forced
        assert flight is not None
        return self._active_set.stages[-1 - len(flight.weights) : -1], duration_s * flight.weights
