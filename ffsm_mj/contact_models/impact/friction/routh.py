"""One contact with friction: Stronge's energetic restitution along Routh's impulse path.

The normal impulse p parametrises the path; with G = A A^T and the direction of slip s,

    du/dp = G (1, -mu s),  dW/dp = u_n.  Compression ends at u_n = 0 with W = W_c < 0, the impact at W = (1 - e^2) W_c.

Slip that reaches u_t = 0 sticks if friction |f| = |H^-1 g| <= mu can hold it (g = G_tn, H = G_tt); otherwise it continues
along the one direction s in which slip can grow. No part of the path gains energy: normal work (1 - e^2) W_c and friction
work are <= 0. Units: the speed U = max |u| before, and G_nn. (Stronge, *Impact Mechanics*, 2000; Routh, *Dynamics of a
System of Rigid Bodies*, 1860.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.path import END, NONE, STOP, TURN, Path, Problem
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, Status, clip_to_cone
from ffsm_mj.contact_models.impact.friction.slip import curved_slip
from ffsm_mj.contact_models.impact.laws import IMMOVABLE
from ffsm_mj.tolerances import CANCELLED, RANK, SOLVED

_SEGMENTS = 20
"""Largest number of segments; a path has a few: slip, stick or reverse slip, in compression and expansion."""


def stronge(A: FloatArray, w: FloatArray, mu: float, e: float) -> FrictionResult:
    """Solve an impact of one contact; equal arguments give equal results bit for bit.

    A contact that does not approach gets no impulse. The status is ``unconverged`` if the path cannot be integrated.

    Args:
        A: Rows J L^-T of normal and two tangents with M = L L^T, (3, n); a tangent in which nothing moves may be zero.
        w: Mass-weighted velocity before, L^T qdot, (n,).
        mu: Coefficient of friction, >= 0.
        e: Energetic coefficient of restitution, the square root of the ratio of expansion work to compression work, 0 to 1.

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
    follower = _ImpulsePath(Problem(G / scale, u / speed, mu), e)
    status = follower.run()
    impulse = clip_to_cone(follower.path.impulse * (speed / scale), mu)
    after = w + A.T @ impulse
    normal, friction, compression = np.array(
        [[follower.path.normal_work], [follower.path.friction_work], [follower.deepest]]
    ) * (speed * speed / scale)
    energy = 0.5 * float(w @ w)
    missed = abs(float(normal[0] + friction[0]) - (0.5 * float(after @ after) - energy)) / energy
    # Both works must give the change of kinetic energy; otherwise the integration of the path is not trusted.
    if missed > SOLVED:
        status = "unconverged"
    modes = ", ".join(follower.modes)
    return FrictionResult(impulse[None], after, "stronge", status, 1.0, missed, (modes,), normal, friction, compression)


@dataclass
class _ImpulsePath:
    """The impulse path from the start of contact to its end, segment by segment.

    Attributes:
        problem: The impact.
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
        """Follow the path to its end; returns the status."""
        slips = self.path.speed > RANK  # otherwise there is no slip before, to rounding
        self.modes.append("slip" if slips else self._stop("slip"))
        for _ in range(_SEGMENTS):
            event = self._segment()
            if event == END:
                return "ok"
            # Slip and normal velocity may vanish together, as they do wherever joints and latches leave the contact a single
            # relative motion, and wherever it locks. Rounding decides which is located first: they are one event.
            stops = event == STOP or (self.path.speed <= RANK and not self.path.sticks)
            turns = event == TURN or (self.compressing and abs(self.path.u_n) <= RANK)
            mode = self._stop("reverse slip") if stops else ""
            ends = turns and self._turned()
            rests = self._at_rest()
            if ends and not rests:
                return "ok"
            if mode:
                self.modes.append(mode)
            if event == NONE or (turns and rests):
                return "wedged" if rests else "unconverged"
        return "unconverged"

    def _segment(self) -> str:
        """Advance to the next event; returns it."""
        path = self.path
        # Sticking friction may pull the bodies together as fast as the normal impulse separates them: the contact locks.
        if path.sticks and path.normal_rate(self.problem) <= CANCELLED:
            return NONE
        target = None if self.compressing else (1.0 - self.e * self.e) * self.deepest
        if not path.sticks and not path.is_straight(self.problem):
            return curved_slip(self.problem, path, target)
        return path.straight(self.problem, target)

    def _turned(self) -> bool:
        """Handle a zero of the normal velocity: compression ends, or begins again. Returns whether the impact ends."""
        # Friction couples slip and normal motion, so the normal velocity may fall to zero again during expansion: a second
        # compression, whose end counts as the end of compression if its work is the lowest.
        self.path.u_n = 0.0
        if self.compressing:
            self.deepest = min(self.deepest, self.path.normal_work)
        self.compressing = not self.compressing
        return not self.compressing and self.e == 0.0

    def _at_rest(self) -> bool:
        """Whether the contact is locked, or all speeds have vanished during compression."""
        path = self.path
        locked = path.sticks and path.normal_rate(self.problem) <= CANCELLED
        return locked or (self.compressing and max(abs(path.u_n), path.speed) <= SOLVED)

    def _stop(self, slips: str) -> str:
        """Set the slip to zero; the contact then sticks, or slips in the only possible direction. Returns which."""
        direction = self.problem.slip_from_rest()
        self.path.stop(self.problem, direction)
        return "stick" if direction is None else slips
