"""One contact with friction and tangential compliance: springs along and across the normal, and a Coulomb slider.

A normal spring of stiffness k_n acts between the bodies, and across it a spring of stiffness k_t in series with a slider
that holds up to mu times the normal force (Maw, Barber & Fawcett, Wear 38:101, 1976; Stronge, *Impact Mechanics*, 2000,
chapter 5). With the normal force f, the stretch s of the tangential spring (2,), the slip v of the slider, the impulse p,
d = s / |s| and rho = k_n / k_t,

    u = u0 + G p,  p' = (f, -s / rho),  f' = -kappa u_n,  s' = u_t - v,  v = 0 or v = |v| d with |s| = rho mu f,

in units where k_n = 1: only rho matters. Restitution is Stronge's: after the largest force f_c the contact unloads along the
stiffness kappa = 1 / e^2 (1 before), which returns e^2 of the work of compression; it loads along the same line again, up
to f_c, should the bodies approach once more. The contact ends at f = 0. There |s| <= rho mu f is zero too: nothing is left in
the tangential spring. With e = 0 it ends at f_c, and the slider takes what the spring holds. No part of the path gains energy:
the works are -(1 - e^2) f_c^2 / 2 and minus that of the slider. rho -> 0 is the law of Routh and Stronge.

Where the slider holds, the motion is one of three oscillators in the modes of K^1/2 G K^1/2. Where it slips along a line,
velocities are linear in p_n and the stored energy E = f^2 / (2 kappa) is quadratic. Where the direction d = (cos a, sin a)
of its slip turns, dp_n = 2 mu rho kappa E dtau removes the singularity at E = 0:

    a' = u_t x d,  (ln E)' = -2 mu rho kappa u_n,  p_n' = 2 mu rho kappa E,  p_t' = -mu d p_n'
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import atan2, cbrt, cos, exp, hypot, inf, log, pi, sin, sqrt

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, Status, clip_to_cone
from ffsm_mj.contact_models.impact.friction.routh import ROUNDING, until_event
from ffsm_mj.contact_models.impact.laws import IMMOVABLE
from ffsm_mj.tolerances import CANCELLED, RANK, SOLVED

TURN = "compression ends"
LOAD = "compression goes on"
END = "normal force is zero"
HOLD = "slider stops"
SLIP = "slider slips"
NONE = "nothing ahead"

_PLASTIC = 1e-12
"""Restitution below this is zero: unloading changes no velocity by a larger share."""
_LINE = 1e-13
"""Slip whose direction changes by less than this share is along a line: some hundred EPSILON."""
_BEGUN = 1e-8
"""Share E of the stored energy over that of the bounce below which slip is along a line.

The impulse of such a step is as small a share of the whole. At the start d follows u_t, which turns by a share E, so the
impulse misses E^2 of the whole; at the end what d and u_t are apart comes to it.
"""
_STEPS = 20_000
"""Most steps of the solver in a segment: the direction of slip is stiff where k_t is large."""
_LARGEST = 50.0
"""Logarithm of stored energy that no impact reaches: a first step of the solver, tried and refused, may lead beyond."""
_SEGMENTS = 1000
"""Largest number of segments; random contacts have up to twenty, and stiff tangential springs slip once in each period."""
_PERIODS = 10.0
"""Slowest periods after which a contact whose slider holds counts as locked: its force would oscillate for ever."""
_NEWTON = 100
"""Largest number of Newton's steps for a zero of a cubic, which converge quadratically."""
_SAFE_STEPS = 20_000
"""Largest number of steps to a zero, of which a period of the fastest mode takes about ten."""


@dataclass(frozen=True)
class _Modes:
    """Free oscillation of a contact whose slider holds, for one stiffness kappa of the normal spring.

    Attributes:
        roots: Square roots of the stiffnesses, (3,): (kappa, 1 / rho, 1 / rho)^1/2.
        frequencies: Angular frequencies, ascending, (3,); zero for what does not move.
        axes: Modes of K^1/2 G K^1/2 as columns, (3, 3).
    """

    roots: FloatArray
    frequencies: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, G: FloatArray, kappa: float, rho: float) -> _Modes:
        roots = np.sqrt([kappa, 1.0 / rho, 1.0 / rho])
        values, axes = np.linalg.eigh(roots[:, None] * G * roots)
        # A combination of forces that moves nothing has an eigenvalue of rounding, which would be a slow oscillation.
        values[values < CANCELLED * values[-1]] = 0.0
        return cls(roots, np.sqrt(values), axes)


@dataclass(frozen=True)
class _Oscillation:
    """Motion from a state on, t = 0, until the slider slips.

    Attributes:
        modes: Its modes.
        sines: Amplitudes of sin(omega t), (3,).
        cosines: Amplitudes of cos(omega t), (3,).
    """

    modes: _Modes
    sines: FloatArray
    cosines: FloatArray

    @classmethod
    def begin(cls, modes: _Modes, force: FloatArray, u: FloatArray) -> _Oscillation:
        """From the force (f, -s / rho), (3,), and the velocity, (3,)."""
        at, rate = -modes.axes.T @ (force / modes.roots), modes.axes.T @ (modes.roots * u)
        moves = modes.frequencies > 0.0
        return cls(modes, np.divide(rate, modes.frequencies, out=np.zeros(3), where=moves), at)

    @property
    def swing(self) -> float:
        """Bound on the part of the force that oscillates."""
        moves = self.modes.frequencies > 0.0
        parts = np.abs(self.modes.roots[:, None] * self.modes.axes)[:, moves]
        return float((parts @ np.hypot(self.sines, self.cosines)[moves]).max())

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds on the normal force and on the size of the tangential one, with derivatives up to the fourth, (5,) each."""
        sizes = np.hypot(self.sines, self.cosines) * self.modes.frequencies ** np.arange(5)[:, None]
        parts = np.abs(self.modes.roots[:, None] * self.modes.axes)
        return sizes @ parts[0], sizes @ np.hypot(parts[1], parts[2])

    def forces(self, time: float) -> list[list[float]]:
        """Forces and their first three derivatives at a time, (4, 3)."""
        w = self.modes.frequencies
        c, s = np.cos(w * time), np.sin(w * time)
        at, rate = self.sines * s + self.cosines * c, w * (self.sines * c - self.cosines * s)
        modal = np.array((at, rate, -w * w * at, -w * w * rate))
        forces: list[list[float]] = (-modal @ self.modes.axes.T * self.modes.roots).tolist()
        return forces

    def impulse(self, time: float) -> FloatArray:
        """Integral of the force, (3,)."""
        w, moves = self.modes.frequencies, self.modes.frequencies > 0.0
        # 1 - cos without cancellation; what does not move keeps its force.
        modal = self.sines * 2.0 * np.sin(0.5 * w * time) ** 2 + self.cosines * np.sin(w * time)
        modal = np.divide(modal, w, out=self.cosines * time, where=moves)
        return np.asarray(-self.modes.roots * (self.modes.axes @ modal))


def _first_zero(jet: Callable[[float], tuple[float, float, float]], third: float, most: float) -> float:
    """The first time at which a function falls to zero, at most ``most``; infinite if it does not.

    From each time the function stays positive for as long as its Taylor polynomial does less the bound on its remainder, so
    that no zero is stepped over; near one these steps are Newton's. It may begin at zero, and rise.

    Args:
        jet: The function with its first two derivatives.
        third: Bound on the size of the third.
        most: End of the search.
    """
    time = 0.0
    for _ in range(_SAFE_STEPS):
        value, rate, bend = jet(time)
        step = _safe_step(max(value, 0.0), rate, bend, third)
        if step <= 4e-16 * time or (step == 0.0 and value <= 0.0):
            return time
        time += step
        if time >= most:
            return inf
    return inf


def _safe_step(value: float, rate: float, bend: float, third: float) -> float:
    """A time up to which value + rate t + bend t^2 / 2 - third t^3 / 6 stays positive: near a zero its zero, to rounding."""
    if rate >= 0.0 and bend >= 0.0:
        return max(cbrt(6.0 * value / third), sqrt(6.0 * rate / third), 3.0 * bend / third)
    # Without a bend that is positive the cubic is concave, and its one zero below this time: Newton's method from there on
    # is monotone.
    bend = min(bend, 0.0)
    step = cbrt(12.0 * value / third) + sqrt(12.0 * max(rate, 0.0) / third)
    for _ in range(_NEWTON):
        slope = rate + step * (bend - 0.5 * third * step)
        below = value + step * (rate + step * (0.5 * bend - third * step / 6.0))
        # Past the zero by rounding, or at it.
        if below >= 0.0 or slope >= 0.0:
            break
        step -= below / slope
    return max(step, 0.0)


def _root(stored: float, u_n: float, rate: float) -> float:
    """The first normal impulse p > 0 with u_n p + rate p^2 / 2 = stored >= 0, where u_n + rate p is the velocity; or inf."""
    square = u_n * u_n + 2.0 * rate * stored
    if square < 0.0:
        return inf
    # Of both forms of the root, the one without cancellation.
    if u_n >= 0.0:
        return 2.0 * stored / through if (through := u_n + sqrt(square)) > 0.0 else inf
    return (sqrt(square) - u_n) / rate if rate > 0.0 else inf


@dataclass
class _Path:
    """The contact from its start to its end, segment by segment, in units of G_nn, k_n and the largest speed before.

    Attributes:
        G: A A^T, (3, 3), G_nn = 1.
        u0: Velocity before, (3,).
        mu: Coefficient of friction, > 0.
        e: Coefficient of restitution.
        rho: Tangential over normal compliance, k_n / k_t, > 0.
        force: Normal force f.
        stretch: Stretch s of the tangential spring, (2,).
        direction: Direction d in which the slider slips, (2,), or None if it holds.
        impulse: Impulse so far, (3,).
        friction_work: Work of the tangential force so far.
        peak: Largest normal force, at the end of compression.
        compressing: Whether the normal spring loads for the first time to its force.
        modes: Names of what the slider did.
    """

    G: FloatArray
    u0: FloatArray
    mu: float
    e: float
    rho: float
    force: float = 0.0
    stretch: FloatArray = field(default_factory=lambda: np.zeros(2))
    direction: FloatArray | None = None
    impulse: FloatArray = field(default_factory=lambda: np.zeros(3))
    friction_work: float = 0.0
    peak: float = 0.0
    compressing: bool = True
    modes: list[str] = field(default_factory=list)

    @property
    def kappa(self) -> float:
        """Stiffness of the normal spring: 1, or 1 / e^2 in restitution."""
        return 1.0 if self.compressing else 1.0 / (self.e * self.e)

    @property
    def stored(self) -> float:
        """Energy in the normal spring that it will give back."""
        return 0.5 * self.force * self.force / self.kappa

    @property
    def u(self) -> FloatArray:
        """Velocity, (3,)."""
        return np.asarray(self.u0 + self.G @ self.impulse)

    def run(self) -> Status:
        """Follow the path to its end; returns the status."""
        self._modes_of: dict[bool, _Modes] = {}
        speed = hypot(self.u0[1], self.u0[2])
        # The spring stretches at the rate of slip, its limit rho mu f at that of the approach: the faster one decides.
        self._go_on(self.u0[1:] / speed if speed > self.rho * self.mu * abs(self.u0[0]) else None)
        event = ""
        for _ in range(_SEGMENTS):
            event = self._hold(event) if self.direction is None else self._slip(self.direction, event)
            if event == END or (event == TURN and self.e < _PLASTIC):
                return "ok"
            if event in (TURN, LOAD):
                self.compressing = event == LOAD
            elif event == NONE:
                break
            else:
                length = hypot(*self.stretch)
                self._go_on(self.stretch / length if event == SLIP and length > 0.0 else None)
        return "unconverged"

    def _go_on(self, direction: FloatArray | None) -> None:
        """Let the slider slip in a direction, or hold."""
        self.direction = direction
        slips = "slip" if direction is None or direction @ self.u0[1:] >= 0.0 else "reverse slip"
        self.modes.append("stick" if direction is None else slips)

    def _hold(self, last: str) -> str:
        """Go on from an event to the next one with a slider that holds; returns it."""
        if self.compressing not in self._modes_of:
            self._modes_of[self.compressing] = _Modes.of(self.G, self.kappa, self.rho)
        modes = self._modes_of[self.compressing]
        motion = _Oscillation.begin(modes, np.append(self.force, self.stretch / -self.rho), self.u)
        along, across = motion.bounds
        # Friction and springs that balance where nothing moves any more hold the contact closed for ever.
        if motion.swing <= SOLVED * float(along[0]):
            return NONE
        most = _PERIODS * 2.0 * pi / min(modes.frequencies[modes.frequencies > 0.0].tolist())

        def normal(order: int) -> Callable[[float], tuple[float, float, float]]:
            def jet(time: float) -> tuple[float, float, float]:
                value, rate, bend = (row[0] for row in motion.forces(time)[order : order + 3])
                return value, rate, bend

            return jet

        def below(time: float) -> tuple[float, float, float]:
            """Largest force less the force: both it and its rate are zero as compression ends."""
            f, rate, bend = normal(0)(time)
            return (0.0, 0.0, -bend) if last == TURN and time == 0.0 else (self.peak - f, -rate, -bend)

        def margin(time: float) -> tuple[float, float, float]:
            """(mu f)^2 - |s / rho|^2."""
            (f, *t), (f1, *t1), (f2, *t2), _ = motion.forces(time)
            square = self.mu * self.mu
            bend = 2.0 * (square * (f1 * f1 + f * f2) - _dot(t1, t1) - _dot(t, t2))
            # Where the slider has just stopped both are zero: by rounding it would slip again at once.
            if last == HOLD and time == 0.0:
                return 0.0, 0.0, bend
            return square * f * f - _dot(t, t), 2.0 * (square * f * f1 - _dot(t, t1)), bend

        ahead = {}
        if self.compressing:
            ahead[TURN] = _first_zero(normal(1), along[4], most)  # f' = -u_n
        else:
            ahead[END] = _first_zero(normal(0), along[3], most)
            ahead[LOAD] = _first_zero(below, along[3], min(most, ahead[END]))
        third = 2.0 * float(self.mu**2 * _third(along) + _third(across))
        ahead[SLIP] = _first_zero(margin, third, min(most, *ahead.values()))
        event = min(ahead, key=ahead.__getitem__)
        time = ahead[event]
        if time == inf:
            return NONE
        before = float(self.stretch @ self.stretch)
        self.force, *across_now = motion.forces(time)[0]
        self.stretch = -self.rho * np.array(across_now)
        self.impulse = self.impulse + motion.impulse(time)
        self.friction_work -= 0.5 * (float(self.stretch @ self.stretch) - before) / self.rho
        return self._at(event)

    def _at(self, event: str) -> str:
        """Set to exactly what it is at an event what is so to rounding only; returns the event."""
        if event == TURN:
            self.peak = self.force
        self.force = {END: 0.0, LOAD: self.peak}.get(event, self.force)
        return event

    def _slip(self, direction: FloatArray, last: str) -> str:
        """Go on from an event to the next one with a slider that slips; returns it."""
        u = self.u
        bounce = max(abs(float(u[0])), sqrt(2.0 * self.stored))
        least = _BEGUN * bounce * bounce
        turns = max(abs(_cross(direction, self._pull(direction))) * bounce, abs(_cross(direction, u[1:])))
        if turns <= _LINE * max(bounce, hypot(u[1], u[2])):
            return self._line(direction, inf, last)
        if self.stored > least:
            event = self._curve(direction, u, bounce)
            if event != END:
                return event
            assert self.direction is not None
            direction = self.direction
        return self._line(direction, least / bounce if self.compressing else inf, last) or self._slip(direction, last)

    def _pull(self, direction: FloatArray) -> FloatArray:
        """Change of tangential velocity per normal impulse, (2,)."""
        return np.asarray(self.G[1:, 0] - self.mu * (self.G[1:, 1:] @ direction))

    def _line(self, direction: FloatArray, most: float, last: str) -> str:
        """Go on from an event by at most so much normal impulse along a line; returns the next one, empty if there is none."""
        u = self.u
        u_n, speed = float(u[0]), float(direction @ u[1:])
        rate = float(self.G[0, 0] - self.mu * (direction @ self.G[1:, 0]))
        grows, limit = float(direction @ self._pull(direction)), self.mu * self.rho * self.kappa
        slows = grows + limit * rate
        ahead = {"": most, HOLD: max(speed + limit * u_n, 0.0) / -slows if slows < 0.0 else inf}
        if self.compressing:
            ahead[TURN] = -u_n / rate if rate > 0.0 else inf
        else:
            full = 0.5 * self.peak * self.peak / self.kappa
            ahead[END] = _root(self.stored, u_n, rate)
            # As compression ends the spring is at its largest force, and unloads.
            turned = last == TURN and rate > 0.0
            ahead[LOAD] = inf if turned else _root(max(full - self.stored, 0.0), -u_n, -rate)
        event = min(ahead, key=ahead.__getitem__)
        step = ahead[event]
        if step == inf:
            return NONE
        self.friction_work -= self.mu * step * (speed + 0.5 * grows * step)
        self.impulse = self.impulse + step * np.append(1.0, -self.mu * direction)
        stored = self.stored - step * (u_n + 0.5 * rate * step)
        self.force = sqrt(max(2.0 * self.kappa * stored, 0.0))
        self._at(event)
        self.stretch = self.rho * self.mu * self.force * direction
        return event

    def _curve(self, direction: FloatArray, u: FloatArray, bounce: float) -> str:
        """Integrate to the next event; returns it, the end if what is left is along a line."""
        mu, kappa, (g0, g1, g2) = self.mu, self.kappa, self.G.tolist()
        limit, turns, (n0, t0, b0) = mu * self.rho * kappa, 0.5 / (mu * self.rho * kappa * bounce), self.u0.tolist()

        def velocity(y: FloatArray) -> tuple[float, float, float]:
            p, a, b = y[2], y[3], y[4]
            return (
                n0 + g0[0] * p + g0[1] * a + g0[2] * b,
                t0 + g1[0] * p + g1[1] * a + g1[2] * b,
                b0 + g2[0] * p + g2[1] * a + g2[2] * b,
            )

        def rates(_tau: float, y: FloatArray) -> list[float]:
            c, s, (u_n, x, z) = cos(y[0]), sin(y[0]), velocity(y)
            step = exp(min(y[1], _LARGEST)) / bounce
            friction = -mu * step
            return [turns * (z * c - x * s), -u_n / bounce, step, friction * c, friction * s, friction * (x * c + z * s)]

        def left(y: FloatArray) -> float:
            (_, x, z), share = velocity(y), exp(y[1]) / (bounce * bounce)
            apart = abs(z * cos(y[0]) - x * sin(y[0])) / max(hypot(x, z), RANK * bounce)
            return _BEGUN * _BEGUN - share * (share + apart)

        def slider(y: FloatArray) -> float:
            u_n, x, z = velocity(y)
            return -(x * cos(y[0]) + z * sin(y[0]) + limit * u_n)

        events: dict[str, Callable[[FloatArray], float]] = {HOLD: slider}
        if self.compressing:
            events[TURN] = lambda y: velocity(y)[0]
        else:
            full = log(0.5 * self.peak * self.peak / kappa)
            events |= {END: left, LOAD: lambda y: min(float(y[1]) - full, -velocity(y)[0])}
        angle = atan2(direction[1], direction[0])
        start = np.array((angle, log(self.stored), *self.impulse, self.friction_work))
        sizes = np.array([1.0, 1.0, *3 * (bounce,), bounce * max(bounce, hypot(u[1], u[2]))])
        event, y = until_event(rates, start, events, ROUNDING * sizes, _STEPS)
        self.direction = np.array([cos(y[0]), sin(y[0])])
        self.force = sqrt(2.0 * kappa * exp(y[1]))
        self.impulse, self.friction_work = y[2:5].copy(), float(y[5])
        if event != END:
            self._at(event)
        self.stretch = self.rho * mu * self.force * self.direction
        return event


def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _cross(a: FloatArray, b: FloatArray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _third(bounds: FloatArray) -> float:
    """Bound on half the third derivative of the square of a function, from those on its derivatives."""
    return float(bounds[0] * bounds[3] + 3.0 * bounds[1] * bounds[2])


def compliant(A: FloatArray, w: FloatArray, mu: float, e: float, rho: float) -> FrictionResult:
    """Solve an impact of one contact that approaches; equal arguments give equal results bit for bit.

    The status is ``unconverged`` if the slider never lets go, as where friction locks the contact.

    Args:
        A: Rows J L^-T of normal and two tangents with M = L L^T, (3, n); a tangent in which nothing moves may be zero.
        w: Mass-weighted velocity before, L^T qdot, (n,).
        mu: Coefficient of friction, > 0.
        e: Energetic coefficient of restitution, the square root of the ratio of restitution work to compression work, 0 to 1.
        rho: Tangential over normal compliance, k_n / k_t, > 0.

    Raises:
        ValueError: Neither body can move along the contact normal.
    """
    G, u = A @ A.T, A @ w
    if G[0, 0] <= 0.0:
        raise ValueError(IMMOVABLE)
    scale, speed = float(G[0, 0]), float(np.abs(u).max())
    path = _Path(G / scale, u / speed, mu, e, rho)
    status = path.run()
    impulse = clip_to_cone(path.impulse * (speed / scale), mu)
    after = w + A.T @ impulse
    deepest = -0.5 * path.peak * path.peak
    works = ((1.0 - e * e) * deepest, path.friction_work, deepest)
    normal, friction, compression = np.array([[work] for work in works]) * (speed * speed / scale)
    energy = 0.5 * float(w @ w)
    missed = abs(float(normal[0] + friction[0]) - (0.5 * float(after @ after) - energy)) / energy
    # Both works must give the change of kinetic energy; otherwise the path is not trusted.
    if missed > SOLVED:
        status = "unconverged"
    modes = ", ".join(path.modes)
    return FrictionResult(impulse[None], after, "compliant", status, 1.0, missed, (modes,), normal, friction, compression)
