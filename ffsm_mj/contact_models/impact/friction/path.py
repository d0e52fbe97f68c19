"""Where the path of one contact stands, and its straight segments in closed form."""

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
_STRAIGHT = 1e-13
_ITERATIONS = 100


@dataclass
class Problem:
    """One contact in units of G_nn and of the largest speed before.

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
        moves = values > CANCELLED * max(1.0, float(values[-1]))
        self._values, self._vectors = values[moves], vectors[:, moves]
        self._g = self._vectors.T @ self.g
        self.hold: FloatArray = -self._vectors @ (self._g / self._values)
        """Friction per normal impulse that keeps slip as it is, -H^-1 g, (2,)."""

    def pull(self, direction: FloatArray) -> FloatArray:
        """Change of tangential velocity per normal impulse in slip along ``direction``, g - mu H s, (2,)."""
        pull: FloatArray = self.g - self.mu * (self.H @ direction)
        return pull

    def impulse_for(self, change: FloatArray) -> FloatArray:
        """Tangential impulse of least norm for a change of tangential velocity, (2,)."""
        impulse: FloatArray = self._vectors @ ((self._vectors.T @ change) / self._values)
        return impulse

    def slip_from_rest(self) -> FloatArray | None:
        """Direction in which slip grows out of rest, (2,), or None where friction holds it.

        Slip along s grows at the rate a > 0 if g - mu H s = a s, so s = (mu H + a)^-1 g of length one. The length falls
        with a and is above one at a = 0; Newton's method on its inverse, which is concave, rises to the root from below.
        """
        if hypot(*self.hold) <= self.mu:
            return None
        rate = max(0.0, float(np.linalg.norm(self._g)) - self.mu * float(self._values[-1]))
        for _ in range(_ITERATIONS):
            parts = self._g / (self.mu * self._values + rate)
            length = float(np.linalg.norm(parts))
            slope = float(parts @ (parts / (self.mu * self._values + rate)))
            step = (length - 1.0) * length * length / slope
            if not step > 1e-16 * rate:
                break
            rate += step
        direction: FloatArray = self._vectors @ parts
        return direction / hypot(*direction)


@dataclass
class Path:
    """Where the path of one contact stands.

    Attributes:
        u_n: Normal velocity.
        speed: Of slip, |u_t|.
        direction: Of slip, (2,), or None where the contact sticks.
        impulse: So far, (3,).
        normal_work: So far.
        friction_work: So far.
    """

    u_n: float
    speed: float
    direction: FloatArray | None
    impulse: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal_work: float = 0.0
    friction_work: float = 0.0

    @classmethod
    def begin(cls, problem: Problem) -> Path:
        """Before the impact."""
        speed = hypot(problem.u[1], problem.u[2])
        return cls(float(problem.u[0]), speed, problem.u[1:] / speed if speed > 0.0 else np.zeros(2))

    @property
    def sticks(self) -> bool:
        """Whether it sticks."""
        return self.direction is None

    def force(self, problem: Problem) -> FloatArray:
        """Impulse per normal impulse, (3,): (1, -mu s) in slip, (1, f) where it sticks."""
        return np.append(1.0, problem.hold if self.direction is None else -problem.mu * self.direction)

    def normal_rate(self, problem: Problem) -> float:
        """Change of the normal velocity per normal impulse."""
        return float(problem.G[0] @ self.force(problem))

    def is_straight(self, problem: Problem) -> bool:
        """Whether slip keeps its direction: then velocities are linear in the impulse."""
        assert self.direction is not None
        s, pull = self.direction, problem.pull(self.direction)
        return bool(abs(s[0] * pull[1] - s[1] * pull[0]) <= _STRAIGHT * (1.0 + problem.mu) * np.abs(problem.G).max())

    def stop(self, problem: Problem, direction: FloatArray | None) -> None:
        """Slip is zero, exactly; from here on it slips along ``direction`` or sticks."""
        self.impulse[1:] -= problem.impulse_for(problem.u[1:] + problem.G[1:] @ self.impulse)
        self.u_n = float(problem.u[0] + problem.G[0] @ self.impulse)
        self.speed, self.direction = 0.0, direction

    def straight(self, problem: Problem, target: float | None) -> str:
        """Go straight to the next event and name it.

        Args:
            problem: What does not change.
            target: Normal work at which the impact ends; None in compression.
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
        """Velocities linear, works quadratic in the normal impulse given."""
        self.normal_work += impulse * (self.u_n + 0.5 * rate * impulse)
        if self.direction is not None:
            self.friction_work -= problem.mu * impulse * (self.speed + 0.5 * grows * impulse)
        self.impulse = self.impulse + impulse * self.force(problem)
        self.u_n += rate * impulse
        self.speed = max(self.speed + grows * impulse, 0.0)


def _until(work: float, u_n: float, rate: float) -> float:
    """Normal impulse that does a work >= 0 from u_n >= 0 on; infinite where u_n falls to zero before."""
    square = u_n * u_n + 2.0 * rate * work
    if square < 0.0:
        return inf
    through = u_n + sqrt(square)
    return 2.0 * work / through if through > 0.0 else (0.0 if work <= 0.0 else inf)
