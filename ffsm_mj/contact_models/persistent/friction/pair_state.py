"""Friction of one pair at one state: mode, friction force, slip, and how much of the limit of friction is used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact_models.persistent.friction.choice import Solution
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_use, limit_ratios, partners, wedged
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.rows import ContactPoint, FrictionalRows


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
        contact_points: Sequence[ContactPoint],
        rows: FrictionalRows,
        problem: FrictionProblem,
        solution: Solution,
        friction: FloatArray,
        estimates: dict[tuple[ContactPoint, ...], FloatArray],
    ) -> None:
        """Sum over the points of each pair.

        Args:
            contact_points: All closed contact points.
            rows: Their rows.
            problem: Their problem.
            solution: Its solution.
            friction: Friction forces, world axes, N, (k, 3).
            estimates: Forces with the least use found before, by the points that share a load; those found are stored.
        """
        self._contact_points, self._estimates = contact_points, estimates
        self._least_uses: dict[tuple[ContactPoint, ...], float] = {}
        self._rows, self._problem, self._solution, self._kinds = rows, problem, solution, solution.kinds.tolist()
        self._sticks: IntArray = (solution.kinds == STICK).nonzero()[0]
        self._points: dict[UnilateralConstraint, list[int]] = {}
        for i, (contact, kind) in enumerate(zip(contact_points, self._kinds, strict=True)):
            if kind != CLOSED and contact.pair.mu > 0.0:
                self._points.setdefault(contact.pair, []).append(i)
        self._ratios = limit_ratios(solution.forces, problem.mu)
        self.by_pair = {pair: self._of_points(mine, friction) for pair, mine in self._points.items()}

    def _of_points(self, mine: list[int], friction: FloatArray) -> PairFriction:
        force = friction[mine].sum(axis=0)
        sliding = [i for i in mine if self._kinds[i] == SLIDE]
        if not sliding:
            return PairFriction(False, force, np.zeros(3), self._use(mine))
        slips = self._rows.across(self._rows.slips)[sliding]
        return PairFriction(True, force, slips[int(np.argmax(np.linalg.norm(slips, axis=1)))], 1.0)

    def _use(self, mine: list[int]) -> float:
        """Share of the friction limit that the sticking points of a pair use.

        It is their largest ratio with the load shared as by equal springs. Where such shares leave a friction cone, it is
        the least such ratio that any shares have.
        """
        sticks = self._sticks
        if max([self._ratios[i] for i in sticks.tolist()]) <= 1.0:
            return max([self._ratios[i] for i in mine])
        group = partners(self._problem, sticks, mine[0])
        points = tuple([self._contact_points[i] for i in group.tolist()])
        if points not in self._least_uses:  # pairs may share a load
            found = least_use(self._problem, self._solution.forces, group, self._estimates.get(points))
            self._least_uses[points], self._estimates[points] = found
        return self._least_uses[points]

    def is_wedged(self, pair: UnilateralConstraint) -> bool:
        """Whether a pair is wedged: forces inside the friction cones hold it without any load."""
        found = self.by_pair.get(pair)
        return found is not None and not found.slides and wedged(self._problem, self._sticks, self._points[pair][0])
