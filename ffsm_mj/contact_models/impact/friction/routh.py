"""One contact with friction: Stronge's energetic restitution along Routh's impulse path.

The normal impulse p parametrises the path; with G = A A^T and the direction of slip s,

    du/dp = G (1, -mu s),  dW/dp = u_n.  Compression ends at u_n = 0 with W = W_c < 0, the impact at W = (1 - e^2) W_c.

Slip that reaches u_t = 0 sticks if friction |f| = |H^-1 g| <= mu can hold it (g = G_tn, H = G_tt); otherwise it continues
along the one direction s in which slip can grow. No part of the path gains energy: normal work (1 - e^2) W_c and friction
work are <= 0. Units: the speed U = max |u| before, and G_nn. (Stronge, *Impact Mechanics*, 2000; Routh, *Dynamics of a
System of Rigid Bodies*, 1860.)

State on the impulse path of one contact, and the straight segments of the path in closed form.

Curved segments of the impulse path of one contact, where the direction of slip turns: integrated numerically.

With slip u_t = R (cos theta, sin theta) and the parameter dp = R dtau, the singularity at u_t = 0 disappears:

    theta' = s x (g - mu H s),  (ln R)' = s . (g - mu H s),  p' = R,  lambda_t' = -mu R s,  W' = R u_n
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import atan2, cos, exp, hypot, inf, sin, sqrt
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, Status, clip_to_cone, result_of_path
from ffsm_mj.contact_models.impact.laws import IMMOVABLE
from ffsm_mj.tolerances import CANCELLED, RANK, SOLVED

STOP = "slip is zero"
TURN = "normal velocity is zero"
END = "normal work is given back"
NONE = "nothing ahead"
_NO_TURN = 1e-13
"""Slip whose direction changes by less than this share of the largest inverse mass is straight: some hundred EPSILON."""
_ITERATIONS = 100
"""Largest number of Newton's steps, which converge quadratically, from one side: up to 7 in the tests."""


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
        # The impulse that keeps the slip at zero lies in the cone: by Coulomb's law the contact then sticks.
        if hypot(*self.hold) <= self.mu:
            return None
        # At this rate |(mu H + a)^-1 g| >= 1, as no eigenvalue of H exceeds the largest: a start below the root.
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
        # The slip is zero to the tolerance of integration only. Left so, it would count as slip in some direction of
        # rounding.
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
            # In expansion the normal velocity may fall to zero again before the work is given back: compression begins anew.
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
        # At the event STOP the sum is zero to rounding, and a negative speed would turn the slip around.
        self.speed = max(self.speed + grows * impulse, 0.0)


def _until(work: float, u_n: float, rate: float) -> float:
    """Normal impulse whose work from u_n >= 0 on is ``work`` >= 0; infinite if u_n falls to zero before."""
    square = u_n * u_n + 2.0 * rate * work
    # The normal velocity falls to zero before so much work is done; TURN is then the event.
    if square < 0.0:
        return inf
    through = u_n + sqrt(square)  # the form of the quadratic root without cancellation
    return 2.0 * work / through if through > 0.0 else (0.0 if work <= 0.0 else inf)


_STOPPED = -23.0
"""ln(R / R0) at which integration ends, a slip of 1e-10 of the initial one: the rest of the path to u_t = 0 is straight."""
_TAU_END = 1e12
"""End of integration: never reached, since an event or the number of steps ends it before."""
_MAX_STEPS = 3000
"""Steps of the solver after which a segment is given up: the impact is then solved without its path."""
ROUNDING = 1e-15
"""Absolute tolerance of integration, relative to the size of each component."""
_BISECTIONS = 2000
"""Most steps to a root: if it is next to the start, one of bisection for each power of two to the smallest number."""
_THETA, _LOG, _U_N, _WORK, _FRICTION = 0, 1, 5, 6, 7


def curved_slip(problem: Problem, path: Path, target: float | None) -> str:
    """Integrate to the next event, which is returned; the path is advanced to it.

    Args:
        problem: The impact.
        path: State at the start of the segment, slipping.
        target: Normal work at which the impact ends; None during compression.
    """
    assert path.direction is not None
    begin = path.speed
    start = np.concatenate(
        (
            (atan2(path.direction[1], path.direction[0]), 0.0),
            path.impulse,
            (path.u_n, path.normal_work, path.friction_work),
        )
    )
    # Absolute tolerances follow the normal motion, so that a slow bounce with fast slip is as accurate as any other.
    bounce = max(abs(path.u_n), sqrt(2.0 * abs(path.normal_work)))
    sizes = np.array([1.0, 1.0, *4 * (bounce,), bounce**2, bounce * max(bounce, begin)])
    event, y = until_event(_rates(problem, begin), start, _events(target), ROUNDING * sizes)
    _put(path, y, begin)
    if event == STOP:
        s, pull = path.direction, problem.pull(path.direction)
        grows = float(s @ pull)
        if grows >= 0.0:  # slip does not reach zero after all: the segment has no event
            return NONE
        path.advance(problem, -path.speed / grows, path.normal_rate(problem), grows)
    return event


def _rates(problem: Problem, begin: float) -> Callable[[float, FloatArray], list[float]]:
    mu, (g1, g2) = problem.mu, problem.g.tolist()
    (a, b), (_, c) = problem.H.tolist()

    def rates(_tau: float, y: FloatArray) -> list[float]:
        theta, log = y[_THETA], y[_LOG]
        s1, s2, speed = cos(theta), sin(theta), begin * exp(log)
        v1, v2 = g1 - mu * (a * s1 + b * s2), g2 - mu * (b * s1 + c * s2)
        slides = -mu * speed
        return [
            s1 * v2 - s2 * v1,
            s1 * v1 + s2 * v2,
            speed,
            slides * s1,
            slides * s2,
            speed * (1.0 - mu * (g1 * s1 + g2 * s2)),
            speed * y[_U_N],
            slides * speed,
        ]

    return rates


def _events(target: float | None) -> dict[str, Callable[[FloatArray], float]]:
    """Witness function of each event, which rises through zero there."""
    events: dict[str, Callable[[FloatArray], float]] = {STOP: lambda y: _STOPPED - float(y[_LOG])}
    if target is None:
        return {**events, TURN: lambda y: float(y[_U_N])}
    return {**events, TURN: lambda y: -float(y[_U_N]), END: lambda y: float(y[_WORK]) - target}


def until_event(
    rates: Callable[[float, FloatArray], list[float]],
    start: FloatArray,
    events: dict[str, Callable[[FloatArray], float]],
    rounding: FloatArray,
    steps: int = _MAX_STEPS,
) -> tuple[str, FloatArray]:
    """Integrate to the first event; returns its name, and the state there. Without one: NONE, and the last state.

    Args:
        rates: Rates of the state by the parameter, from zero.
        start: State at the start, (n,).
        events: Witness function of each event, which rises through zero there.
        rounding: Absolute tolerance of each component, (n,); the relative one is 1e-13.
        steps: Most steps of the solver.
    """
    from scipy.integrate import LSODA

    # A stiff method: for slip that is slow compared with the bounce, its direction settles at once. The explicit DOP853
    # takes up to 1.8 s on such directions, and its interpolation put one event 2e-7 off.
    solver: Any = LSODA(rates, 0.0, start, _TAU_END, rtol=1e-13, atol=rounding)
    before, values = start, {name: value(start) for name, value in events.items()}
    for _ in range(steps):
        solver.step()
        # Failure is no solution: the caller takes the law that needs no path instead.
        if solver.status != "running":
            return NONE, before
        last, values = values, {name: value(solver.y) for name, value in events.items()}
        passed = [name for name in events if last[name] <= 0.0 < values[name]]
        if passed:
            reached = {name: _rise(solver, events[name]) for name in passed}
            first = min(reached, key=lambda name: reached[name][0])
            return first, reached[first][1]
        before = solver.y.copy()
    return NONE, before


def _rise(solver: Any, value: Callable[[FloatArray], float]) -> tuple[float, FloatArray]:
    """Parameter and state at which a value rose through zero in the last step of the solver."""
    from scipy.optimize import brentq

    dense = solver.dense_output()
    for end in (solver.t_old, solver.t):  # interpolation is rounded at its ends: zero may lie just outside
        if (value(dense(end)) >= 0.0) == (end == solver.t_old):
            return end, dense(end)
    # Tau starts at zero and has no scale of its own: only a relative tolerance fits.
    tau = brentq(lambda tau: value(dense(tau)), solver.t_old, solver.t, xtol=1e-300, rtol=1e-15, maxiter=_BISECTIONS)
    return tau, dense(tau)


def _put(path: Path, y: FloatArray, begin: float) -> None:
    path.direction = np.array([cos(y[_THETA]), sin(y[_THETA])])
    path.direction /= hypot(*path.direction)
    path.speed = begin * exp(y[_LOG])
    path.impulse = y[2:5].copy()
    path.u_n, path.normal_work, path.friction_work = float(y[_U_N]), float(y[_WORK]), float(y[_FRICTION])


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
    works = follower.path.normal_work, follower.path.friction_work, follower.deepest
    return result_of_path("stronge", status, A, w, impulse, np.array(works) * (speed * speed / scale), follower.modes)


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
        # Along stick this rate is the Schur complement G_nn - g^T H^-1 g >= 0. Where it is zero, G is singular: no impulse
        # changes the normal velocity without slip, and compression would never end.
        locked = path.sticks and path.normal_rate(self.problem) <= CANCELLED
        return locked or (self.compressing and max(abs(path.u_n), path.speed) <= SOLVED)

    def _stop(self, slips: str) -> str:
        """Set the slip to zero; the contact then sticks, or slips in the only possible direction. Returns which."""
        direction = self.problem.slip_from_rest()
        self.path.stop(self.problem, direction)
        return "stick" if direction is None else slips
