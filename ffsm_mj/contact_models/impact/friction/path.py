"""State on the impulse path of one contact, and the straight segments of the path in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, inf, sqrt

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import CANCELLED

STOP = "slip is zero"
TURN = "normal velocity is zero"
END = "normal work is given back"
NONE = "nothing ahead"
_NO_TURN = 1e-13
"""Slip whose direction changes by less than this share of the largest inverse mass is straight: some hundred EPSILON."""
_ITERATIONS = 100


@dataclass
class Problem:
    """Impact of one contact, in units of G_nn and of the largest contact speed before.

    Attributes:
        G: A A^T, (3, 3), G_nn = 1.
        u: Velocity before, (3,).
        mu: Coefficient of friction.
    """

    G: FloatArray
    u: FloatArray
    mu: float

    def __post_init__(self) -> None:
        self.g: FloatArray = self.G[1:, 0].copy()
        self.H: FloatArray = self.G[1:, 1:].copy()
        values, vectors = np.linalg.eigh(self.H)
        # A tangent along which nothing moves, as in a planar scene, has no slip to stop: it is left out of the inverse.
        moves = values > CANCELLED * max(1.0, float(values[-1]))
        self._values, self._vectors = values[moves], vectors[:, moves]
        self._g = self._vectors.T @ self.g
        self.hold: FloatArray = -self._vectors @ (self._g / self._values)
        """Friction per normal impulse that keeps the slip velocity constant, -H^-1 g, (2,)."""

    def pull(self, direction: FloatArray) -> FloatArray:
        """Change of tangential velocity per normal impulse for slip along ``direction``, g - mu H s, (2,)."""
        pull: FloatArray = self.g - self.mu * (self.H @ direction)
        return pull

    def impulse_for(self, change: FloatArray) -> FloatArray:
        """Tangential impulse of least norm for a change of tangential velocity, (2,)."""
        impulse: FloatArray = self._vectors @ ((self._vectors.T @ change) / self._values)
        return impulse

    def slip_from_rest(self) -> FloatArray | None:
        """Direction in which slip starts from rest, (2,), or None if the contact sticks.

        Slip along s grows at the rate a > 0 if g - mu H s = a s, so s = (mu H + a)^-1 g with |s| = 1. The length falls with
        a and exceeds one at a = 0; Newton's method on its inverse, which is concave, converges to the root from below.
        """
        if hypot(*self.hold) <= self.mu:
            return None
        rate = max(0.0, float(np.linalg.norm(self._g)) - self.mu * float(self._values[-1]))
        for _ in range(_ITERATIONS):
            parts = self._g / (self.mu * self._values + rate)
            length = float(np.linalg.norm(parts))
            slope = float(parts @ (parts / (self.mu * self._values + rate)))
            step = (length - 1.0) * length * length / slope
            if not step > 1e-16 * rate:  # below half an EPSILON: the rate no longer changes
                break
            rate += step
        direction: FloatArray = self._vectors @ parts
        return direction / hypot(*direction)


@dataclass
class Path:
    """State on the impulse path of one contact, in the units of :class:`Problem`.

    Attributes:
        u_n: Normal velocity.
        speed: Slip speed, |u_t|.
        direction: Direction of slip, (2,), or None if the contact sticks.
        impulse: Impulse so far, (3,).
        normal_work: Work of the normal impulse so far.
        friction_work: Work of friction so far.
    """

    u_n: float
    speed: float
    direction: FloatArray | None
    impulse: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal_work: float = 0.0
    friction_work: float = 0.0

    @classmethod
    def begin(cls, problem: Problem) -> Path:
        """The state before the impact."""
        speed = hypot(problem.u[1], problem.u[2])
        return cls(float(problem.u[0]), speed, problem.u[1:] / speed if speed > 0.0 else np.zeros(2))

    @property
    def sticks(self) -> bool:
        """Whether the contact sticks."""
        return self.direction is None

    def force(self, problem: Problem) -> FloatArray:
        """Impulse per normal impulse, (3,): (1, -mu s) for slip, (1, f) for stick."""
        return np.append(1.0, problem.hold if self.direction is None else -problem.mu * self.direction)

    def normal_rate(self, problem: Problem) -> float:
        """Change of the normal velocity per normal impulse."""
        return float(problem.G[0] @ self.force(problem))

    def is_straight(self, problem: Problem) -> bool:
        """Whether slip keeps its direction; velocities are then linear in the impulse."""
        assert self.direction is not None
        s, pull = self.direction, problem.pull(self.direction)
        return bool(abs(s[0] * pull[1] - s[1] * pull[0]) <= _NO_TURN * (1.0 + problem.mu) * np.abs(problem.G).max())

    def stop(self, problem: Problem, direction: FloatArray | None) -> None:
        """Set slip to exactly zero; the contact then slips along ``direction`` or sticks."""
        self.impulse[1:] -= problem.impulse_for(problem.u[1:] + problem.G[1:] @ self.impulse)
        self.u_n = float(problem.u[0] + problem.G[0] @ self.impulse)
        self.speed, self.direction = 0.0, direction

    def straight(self, problem: Problem, target: float | None) -> str:
        """Advance to the next event along a straight segment; returns the event.

        Args:
            problem: The impact.
            target: Normal work at which the impact ends; None during compression.
        """
        rate = self.normal_rate(problem)
        grows = 0.0 if self.direction is None else float(self.direction @ problem.pull(self.direction))
        ahead = {STOP: -self.speed / grows if self.speed > 0.0 > grows else inf}
        if target is None:
            ahead[TURN] = -self.u_n / rate if rate > 0.0 else inf
        else:
            ahead[TURN] = -self.u_n / rate if rate < 0.0 else inf
            ahead[END] = _until(target - self.normal_work, self.u_n, rate)
        event = min(ahead, key=ahead.__getitem__)
        if ahead[event] == inf:
            return NONE
        self.advance(problem, ahead[event], rate, grows)
        return event

    def advance(self, problem: Problem, impulse: float, rate: float, grows: float) -> None:
        """Advance by a normal impulse: velocities are linear in it, works quadratic."""
        self.normal_work += impulse * (self.u_n + 0.5 * rate * impulse)
        if self.direction is not None:
            self.friction_work -= problem.mu * impulse * (self.speed + 0.5 * grows * impulse)
        self.impulse = self.impulse + impulse * self.force(problem)
        self.u_n += rate * impulse
        self.speed = max(self.speed + grows * impulse, 0.0)


def _until(work: float, u_n: float, rate: float) -> float:
    """Normal impulse whose work from u_n >= 0 on is ``work`` >= 0; infinite if u_n falls to zero before."""
    square = u_n * u_n + 2.0 * rate * work
    if square < 0.0:
        return inf
    through = u_n + sqrt(square)  # the form of the quadratic root without cancellation
    return 2.0 * work / through if through > 0.0 else (0.0 if work <= 0.0 else inf)
