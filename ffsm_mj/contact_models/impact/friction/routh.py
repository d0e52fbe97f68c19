"""One contact with friction: Stronge's energetic restitution along Routh's path of impulse.

The normal impulse p is the time of the path, G = A A^T, s the direction of slip:

    du/dp = G (1, -mu s),  dW/dp = u_n.  Compression ends at u_n = 0 with W = W_c < 0, the impact at W = (1 - e^2) W_c.

Slip that reaches u_t = 0 sticks if friction |f| = |H^-1 g| <= mu holds it (g = G_tn, H = G_tt), else it slips on along the
one direction s in which slip can grow. No part of the path can gain energy: normal work (1 - e^2) W_c and friction work
are <= 0. Everything here is in units of the speed U = max |u| before and of G_nn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.path import END, NONE, STOP, TURN, Path, Problem
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, Status, clip_to_cone
from ffsm_mj.contact_models.impact.friction.slip import curved_slip
from ffsm_mj.contact_models.impact.laws import IMMOVABLE
from ffsm_mj.tolerances import CANCELLED, SOLVED

_SEGMENTS = 20


def stronge(A: FloatArray, w: FloatArray, mu: float, e: float) -> FrictionResult:
    """Impact of one contact; the same arguments give the same result to the last bit.

    A contact that does not approach gets no impulse. Status ``unconverged`` stands for a path that cannot be integrated.

    Args:
        A: Rows J L^-T of normal and two tangents with M = L L^T, (3, n); a tangent in which nothing moves may be zero.
        w: Mass-weighted velocity before, L^T qdot, (n,).
        mu: Coefficient of friction, >= 0.
        e: Energetic coefficient of restitution, the root of the ratio of normal work given back, 0 to 1.

    Raises:
        ValueError: Neither body can move along the contact normal.
    """
    G, u = A @ A.T, A @ w
    if G[0, 0] <= 0.0:
        raise ValueError(IMMOVABLE)
    if u[0] >= 0.0:
        nothing = np.zeros(1)
        return FrictionResult(np.zeros((1, 3)), w.copy(), "stronge", "ok", 1.0, 0.0, ("",), nothing, nothing, nothing)
    scale, speed = float(G[0, 0]), float(np.abs(u).max())
    course = _ImpulsePath(Problem(G / scale, u / speed, mu), e)
    status = course.run()
    impulse = clip_to_cone(course.path.impulse * (speed / scale), mu)
    after = w + A.T @ impulse
    normal, friction, compression = np.array([[course.path.normal_work], [course.path.friction_work], [course.deepest]]) * (
        speed * speed / scale
    )
    energy = 0.5 * float(w @ w)
    missed = abs(float(normal[0] + friction[0]) - (0.5 * float(after @ after) - energy)) / energy
    if missed > SOLVED:
        status = "unconverged"
    modes = ", ".join(course.modes)
    return FrictionResult(impulse[None], after, "stronge", status, 1.0, missed, (modes,), normal, friction, compression)


@dataclass
class _ImpulsePath:
    """The path from touch to parting, segment by segment.

    Attributes:
        problem: What does not change along it.
        e: Coefficient of restitution.
    """

    problem: Problem
    e: float

    def __post_init__(self) -> None:
        self.path = Path.begin(self.problem)
        self.modes: list[str] = []
        self.compressing = True
        self.deepest = 0.0

    def run(self) -> Status:
        """Follow the path to its end."""
        if self.path.speed <= CANCELLED:
            self._choose("slip")
        else:
            self.modes.append("slip")
        for _ in range(_SEGMENTS):
            event = self._segment()
            if event == STOP:
                self._choose("reverse slip")
            elif event == END or (event == TURN and self._turned()):
                return "ok"
            elif event == NONE or (event == TURN and self._at_rest()):
                return "wedged" if self._at_rest() else "unconverged"
        return "unconverged"

    def _segment(self) -> str:
        """Go on to the next event."""
        path = self.path
        if path.sticks and path.normal_rate(self.problem) <= CANCELLED:
            return NONE
        target = None if self.compressing else (1.0 - self.e * self.e) * self.deepest
        if not path.sticks and not path.is_straight(self.problem):
            return curved_slip(self.problem, path, target)
        return path.straight(self.problem, target)

    def _turned(self) -> bool:
        """The normal velocity passes zero: compression ends or, falling back, begins again. True where the impact ends."""
        self.path.u_n = 0.0
        if self.compressing:
            self.deepest = min(self.deepest, self.path.normal_work)
        self.compressing = not self.compressing
        return not self.compressing and self.e == 0.0

    def _at_rest(self) -> bool:
        path = self.path
        locked = path.sticks and path.normal_rate(self.problem) <= CANCELLED
        return locked or (self.compressing and max(abs(path.u_n), path.speed) <= SOLVED)

    def _choose(self, slips: str) -> None:
        """Stick or slip, with slip at zero."""
        direction = self.problem.slip_from_rest()
        self.path.stop(self.problem, direction)
        self.modes.append("stick" if direction is None else slips)
