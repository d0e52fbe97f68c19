"""Choice of the active set at one state under given efforts, and the range in which it stays valid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj._core.contacts import ContactAcceleration
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint

_OPENS = 10.0
"""A gap opens, or a force stops pushing, where a gap'' exceeds its rounding by this factor."""


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
