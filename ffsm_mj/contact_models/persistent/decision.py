"""Which of the closed contacts press, at one state and under some efforts, and what follows from that."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.acceleration import Acceleration
from ffsm_mj.contact_models.persistent.rows import ContactPoint

_OPENS = 10.0
"""A gap opens, or a force ceases to push, where a second rate is so many times its rounding."""


class Decision:
    """All closed contacts at one state; most of it is worked out only where it is asked for.

    Attributes:
        touches: The contacts.
        problem: Their accelerations.
        rows: They themselves, at the state.
    """

    def __init__(self, touches: tuple[ContactPoint, ...], problem: Acceleration) -> None:
        """Of contacts and their accelerations."""
        self.touches, self.problem, self.rows = touches, problem, problem.rows
        self._forces: FloatArray | None = None
        self._pressing: list[int] | None = None

    @property
    def forces(self) -> FloatArray:
        """Forces that only push, shared evenly by redundant contacts, N, (k,)."""
        if self._forces is None:
            self._forces = self.problem.pushed()
        return self._forces

    @property
    def pressing(self) -> list[int]:
        """Indices of those that press."""
        if self._pressing is None:
            eased = zip(self.problem.eased(self.forces).tolist(), self.problem.rounding, strict=True)
            self._pressing = [i for i, (rate, rounding) in enumerate(eased) if rate > rounding]
        return self._pressing

    def leaving(self) -> tuple[ContactPoint, ...]:
        """Those whose gap opens, in the order of the contacts: a set of objects has another one in every process."""
        rates = zip(self.touches, self._opening(self.forces), self.problem.rounding, strict=True)
        return tuple(touch for touch, rate, rounding in rates if rate > _OPENS * rounding)

    def holds_for(self, held: Sequence[ContactPoint]) -> float:
        """Below zero where others are held than those that press, up to forces that redundant contacts may share anew."""
        problem = self.problem
        forces = problem.held([self.touches.index(touch) for touch in held])
        allowed = [_OPENS * rounding for rounding in problem.rounding]
        eased, opening = problem.eased(forces).tolist(), self._opening(forces)
        least = min([min(push + a, a - abs(rate)) for push, rate, a in zip(eased, opening, allowed, strict=True)])
        if least >= 0.0:
            return float(least)
        others = zip(opening, self._opening(self.forces), allowed, strict=True)
        return float(min([a - max(abs(rate - other), other) for rate, other, a in others]))

    def _opening(self, forces: FloatArray) -> list[float]:
        """Gap'' under some forces, m/s^2, (k,)."""
        rates: list[float] = self.problem.opening(forces).tolist()
        return rates
