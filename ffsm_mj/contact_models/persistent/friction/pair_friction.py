"""Friction of each pair at one state: its resultant, slip, share of the limit, and whether it is wedged."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_use, partners, wedged
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK
from ffsm_mj.contact_models.persistent.friction.problem import Solution

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import ContactEvaluation


class PairFriction(NamedTuple):
    """Friction of a pair that carries force.

    Attributes:
        is_sliding: Whether any of its points slides; otherwise those that carry force stick.
        force: Tangential resultant on geom b, world axes, N, (3,).
        slip: Slip velocity of geom b relative to geom a at the point that slides fastest, world axes, m/s, (3,).
        use: Share of the friction limit, mu times the normal force, that its points use, in [0, 1]: 1 while one slides;
            while they stick, they would also stick with mu times this.
    """

    is_sliding: bool
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
        # Over all pairs: those that share a load share it by one convention.
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
        # A sliding point is at its limit, so the pair uses all of it, whatever its other points do.
        return PairFriction(True, force, slips[int(np.argmax(np.linalg.norm(slips, axis=1)))], 1.0)

    def _use(self, part: slice) -> float:
        """Share of the friction limit that the sticking points of a pair use.

        It is their largest ratio with the load shared as by equal springs. Where such shares leave a friction cone, it is
        the least such ratio that any shares have.
        """
        # By convention forces are those of equal springs while these stay inside all cones (docs/friction.md); only beyond
        # does another share have to be found by cone programs.
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
            and not friction.is_sliding
            and wedged(self._evaluation.problem, self._sticks, self._first(dict(self._evaluation.modes.pairs)[pair]))
        )
