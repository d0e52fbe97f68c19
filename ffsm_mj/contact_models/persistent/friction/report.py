"""Friction of one pair at one state, and the log columns of the contact rules with friction, beside those of all rules."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_use, partners, wedged
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK
from ffsm_mj.contact_models.persistent.friction.problem import Solution
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import CONTACT_WORK, SLIDING_HEAT, Signal, identifier
from ffsm_mj.state import Stateful

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import ContactEvaluation

_SIGNALS = (
    ("friction_N", "N", "friction force of {}: sum of the tangential resultants of its pairs; 0 without force"),
    *((f"friction_{x}_N", "N", "resultant friction force of {} on its second side, world axes") for x in "xyz"),
    (
        "friction_use",
        "",
        "share of the friction limit, mu times the normal force, that {} uses: 1 while a point slides, 0 without force; "
        "while it sticks, it would also stick with mu times this share",
    ),
    ("slip_m_s", "m/s", "largest slip speed of the sliding contact points of {}; 0 if none slides"),
    ("slip_m", "m", "slip distance of {} since t = 0: time integral of its largest slip speed"),
    (SLIDING_HEAT.lstrip("_"), "J", "heat of sliding in persistent contact of {} since t = 0; without that of impacts"),
)
SLIP, _HEAT = len(_SIGNALS) - 2, len(_SIGNALS) - 1
_WORK = Signal(
    "balance",
    CONTACT_WORK,
    "J",
    "work of the forces of persistent contact on all bodies since t = 0, in steps with closed pairs with friction: minus "
    "the heat of sliding",
)


class PairFriction(NamedTuple):
    """Friction of a pair that carries force.

    Attributes:
        slides: Whether any of its points slides; otherwise those that carry force stick.
        force: Tangential resultant on geom b, world axes, N, (3,).
        slip: Slip velocity of geom b relative to geom a at the point that slides fastest, world axes, m/s, (3,).
        use: Share of the friction limit, mu times the normal force, that its points use, in [0, 1]: 1 while one slides;
            while they stick, they would also stick with mu times this.
    """

    slides: bool
    force: FloatArray
    slip: FloatArray
    use: float

    @property
    def slip_speed(self) -> float:
        """Norm of the slip velocity, m/s."""
        return math.hypot(*self.slip.tolist())


class FrictionOfPairs:
    """Friction of the pairs with mu > 0 that carry force, at one state.

    Attributes:
        by_pair: Friction of each of them.
    """

    def __init__(
        self,
        evaluation: ContactEvaluation,
        solution: Solution,
        friction: FloatArray,
        estimates: dict[tuple[ContactPoint, ...], FloatArray],
    ) -> None:
        """Sum over the points of each pair.

        Args:
            evaluation: All closed contact points.
            solution: Solution of their problem.
            friction: Friction forces, world axes, N, (k, 3).
            estimates: Forces with the least use found before, by the points that share a load; those found are stored.
        """
        self._evaluation, self._estimates, self._solution = evaluation, estimates, solution
        self._least_uses: dict[tuple[ContactPoint, ...], float] = {}
        kinds = self._kinds = solution.kinds.tolist()
        self._ratios = evaluation.limit_ratios(solution.forces)
        self._largest = max([ratio for ratio, kind in zip(self._ratios, kinds, strict=True) if kind == STICK], default=0.0)
        self.by_pair = {
            pair: self._of_points(part, friction)
            for pair, part in evaluation.modes.pairs
            if any(kinds[part])  # not CLOSED
        }

    @property
    def _sticks(self) -> IntArray:
        """Indices of the sticking points."""
        sticks: IntArray = (self._solution.kinds == STICK).nonzero()[0]
        return sticks

    def _of_points(self, part: slice, friction: FloatArray) -> PairFriction:
        force: FloatArray = np.add.reduce(friction[part])
        if SLIDE not in self._kinds[part]:
            return PairFriction(False, force, np.zeros(3), self._use(part))
        rows = self._evaluation.rows
        sliding = [i for i in range(part.start, part.stop) if self._kinds[i] == SLIDE]
        slips = rows.across(rows.slips)[sliding]
        return PairFriction(True, force, slips[int(np.argmax(np.linalg.norm(slips, axis=1)))], 1.0)

    def _use(self, part: slice) -> float:
        """Share of the friction limit that the sticking points of a pair use.

        It is their largest ratio with the load shared as by equal springs. Where such shares leave a friction cone, it is
        the least such ratio that any shares have.
        """
        if self._largest <= 1.0:
            return max(self._ratios[part])
        problem, contact_points = self._evaluation.problem, self._evaluation.contact_points
        group = partners(problem, self._sticks, self._first(part))
        points = tuple([contact_points[i] for i in group.tolist()])
        if points not in self._least_uses:  # pairs may share a load
            estimate = least_use(problem, self._solution.forces, group, self._estimates.get(points))
            self._least_uses[points], self._estimates[points] = estimate
        return self._least_uses[points]

    def _first(self, part: slice) -> int:
        """First of some points that carries force."""
        return next(i for i in range(part.start, part.stop) if self._kinds[i] != CLOSED)

    def is_wedged(self, pair: UnilateralConstraint) -> bool:
        """Whether a pair is wedged: forces inside the friction cones hold it without any load."""
        friction = self.by_pair.get(pair)
        return (
            friction is not None
            and not friction.slides
            and wedged(self._evaluation.problem, self._sticks, self._first(dict(self._evaluation.modes.pairs)[pair]))
        )


class FrictionReport(Stateful):
    """Writes the columns of the rules with friction.

    Attributes:
        columns: The columns.
        values: Their values, a row for each rule.
        rules: Row of each rule.
        work_J: Value of the column of the work of contact forces, (1,).
    """

    @dataclass
    class State:
        """Values of the columns: slip, heat and work are sums since t = 0."""

        values: FloatArray
        work_J: FloatArray

    def __init__(self, rules: Iterable[str]) -> None:
        """Start at rest.

        Args:
            rules: Names of the contact rules with mu > 0.
        """
        self.rules = {name: i for i, name in enumerate(rules)}
        self.values = np.zeros((len(self.rules), len(_SIGNALS)))
        signals = tuple(
            Signal("contact", f"{identifier(rule)}_{name}", unit, meaning.format(rule))
            for rule in self.rules
            for name, unit, meaning in _SIGNALS
        )
        self.work_J = np.zeros(1)
        self.columns = (
            Columns(signals, live=self.values.reshape(-1), resume=self._restore, at_state=self.values.flatten),
            Columns((_WORK,), live=self.work_J, resume=self._restore_work),
        )

    def _restore(self, logged: FloatArray) -> None:
        self.values[:] = logged.reshape(self.values.shape)

    def _restore_work(self, logged: FloatArray) -> None:
        self.work_J[:] = logged

    def write(self, by_rule: Mapping[str, Sequence[PairFriction]]) -> None:
        """Write the columns for the pairs that carry force, by rule."""
        self.values[:, :SLIP] = 0.0
        for rule, pairs in by_rule.items():
            sums = [0.0] * SLIP
            for pair in pairs:
                x, y, z = pair.force.tolist()
                sums[0] += math.hypot(x, y, z)
                sums[1] += x
                sums[2] += y
                sums[3] += z
                sums[4], sums[5] = max(sums[4], pair.use), max(sums[5], pair.slip_speed)
            self.values[self.rules[rule], :SLIP] = sums

    def slip(self, rule: str) -> float:
        """Slip distance of a rule since t = 0, m."""
        return float(self.values[self.rules[rule], SLIP])

    def add_step(
        self,
        contact_points: Sequence[ContactPoint],
        stages: Sequence[Stage],
        weights_s: FloatArray,
        work_J: float,
    ) -> float:
        """Add slip, heat and work in a step.

        Args:
            contact_points: Contact points of the stages.
            stages: Stages of the step.
            weights_s: Their quadrature weights, s.
            work_J: Work of all contact forces in the step, J.

        Returns:
            Heat of all rules in the step, J.
        """
        total = 0.0
        self.work_J[0] += work_J
        for stage, weight in zip(stages, weights_s.tolist(), strict=True):
            if stage.slide is None:
                continue
            for contact, heat in zip(contact_points, stage.slide.heat.tolist(), strict=True):
                if contact.pair.mu > 0.0:
                    self.values[self.rules[contact.pair.rule], _HEAT] += weight * heat
                    total += weight * heat
            largest: dict[str, float] = {}
            for contact, speed in zip(contact_points, stage.slide.speeds.tolist(), strict=True):
                if speed > largest.get(contact.pair.rule, 0.0):
                    largest[contact.pair.rule] = speed
            for rule, speed in largest.items():
                self.values[self.rules[rule], SLIP] += weight * speed
        return total
