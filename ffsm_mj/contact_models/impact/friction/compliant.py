"""One contact with friction and tangential compliance: springs along and across the normal, and a Coulomb slider.

A normal spring of stiffness k_n acts between the bodies, and across it a spring of stiffness k_t in series with a slider
that holds up to mu times the normal force (Maw, Barber & Fawcett, Wear 38:101, 1976; Stronge, *Impact Mechanics*, 2000,
chapter 5). With the normal force f, the stretch s of the tangential spring (2,), the slip v of the slider, the impulse p,
d = s / |s| and rho = k_n / k_t,

    u = u0 + G p,  p' = (f, -s / rho),  f' = -kappa u_n,  s' = u_t - v,  v = 0 or v = |v| d with |s| = rho mu f,

in units where k_n = 1: only rho matters. Restitution is Stronge's: after the largest force f_c the contact unloads along the
stiffness kappa = 1 / e^2 (1 before), which returns e^2 of the work of compression; it loads along the same line again, up
to f_c, should the bodies approach once more. The contact ends at f = 0, where |s| <= rho mu f is zero too: nothing is left
in the tangential spring. With e = 0 it ends at f_c, and the slider takes what the spring holds. No part of the path gains
energy: the works are -(1 - e^2) f_c^2 / 2 and minus that of the slider. rho -> 0 is the law of Routh and Stronge.

Where the slider holds, the motion is that of three oscillators. Where it slips along a line, velocities are linear in p_n
and the stored energy E = f^2 / (2 kappa) is quadratic. Where the direction d = (cos a, sin a) of its slip turns, it is
integrated, with dp_n = E dtau / b, which removes the singularity at E = 0, and a speed b of the bounce:

    a' = d x u_t / (2 mu rho kappa b),  (ln E)' = -u_n / b,  p_n' = E / b,  p_t' = -mu d p_n'
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import atan2, cos, exp, hypot, inf, log, pi, sin, sqrt

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.oscillation import Modes, Oscillation
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, Status, clip_to_cone, result_of_path
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
"""Share E of the stored energy over that of the bounce up to which slip that follows u_t is along a line.

The impulse of such a step is as small a share of the whole, and u_t turns by E: the impulse misses E^2. What d and u_t are
apart at the end comes to it, so the product of both is held to E^2.
"""
_STIFF, _NUDGE = 100.0, 1e-9
"""Stiffness from which on, and angle by which, slip starts beside its direction, to which it returns at once.

The impulse misses the product of the angle and of the share of the contact in which it returns, one over the stiffness.
"""
_STEPS = 20_000
"""Most steps of the solver in a segment: the direction of slip is stiff where k_t is large."""
_LARGEST = 50.0
"""Logarithm of stored energy that no impact reaches: a first step of the solver, tried and refused, may lead beyond."""
_SEGMENTS = 200
"""Largest number of segments; random contacts have up to twenty, and stiff tangential springs slip once in each period."""
_PERIODS = 10.0
"""Slowest periods after which a contact whose slider holds counts as locked: its force would oscillate for ever."""


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
        last: Events since the last impulse.
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
    last: set[str] = field(default_factory=set)

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
        self._modes_of: dict[bool, Modes] = {}
        speed = hypot(self.u0[1], self.u0[2])
        # The spring stretches at the rate of slip, its limit rho mu f at that of the approach: the faster one decides.
        self._go_on(self.u0[1:] / speed if speed > self.rho * self.mu * abs(self.u0[0]) else None)
        for _ in range(_SEGMENTS):
            before = float(self.impulse[0])
            event = self._hold() if self.direction is None else self._slip(self.direction)
            # Where bodies have a single relative motion all events of a turn are one: they are told apart by rounding only.
            moved = float(self.impulse[0]) - before > CANCELLED * before
            self.last = {event} if moved else {event, *self.last}
            if event == END or (event == TURN and self.e < _PLASTIC):
                return "ok"
            # Without slip before, the slider holds until both forces are zero: its slip there would be rounding.
            if event == SLIP and not self.compressing and self.force <= RANK * self.peak:
                return "ok"
            if event in (TURN, LOAD):
                self.compressing = event == LOAD
            elif event == NONE:
                break
            else:
                self._go_on(self.stretch / hypot(*self.stretch) if event == SLIP else None)
        return "unconverged"

    def _go_on(self, direction: FloatArray | None) -> None:
        """Let the slider slip in a direction, or hold."""
        self.direction = direction
        slips = "slip" if direction is None or direction @ self.u0[1:] >= 0.0 else "reverse slip"
        self.modes.append("stick" if direction is None else slips)

    def _hold(self) -> str:
        """Go on to the next event with a slider that holds; returns it."""
        if self.compressing not in self._modes_of:
            self._modes_of[self.compressing] = Modes.of(self.G, self.kappa, self.rho)
        modes = self._modes_of[self.compressing]
        motion = Oscillation.begin(modes, np.append(self.force, self.stretch / -self.rho), self.u)
        # Friction and springs that balance where nothing moves any more hold the contact closed for ever.
        if motion.swing <= SOLVED * float(motion.bounds[0][0]):
            return NONE
        ahead, most = {}, _PERIODS * 2.0 * pi / min(modes.frequencies[modes.frequencies > 0.0].tolist())
        if self.compressing:
            ahead[TURN] = motion.peaks(most)
        else:
            ahead[END] = motion.vanishes(most)
            ahead[LOAD] = motion.reaches(self.peak, min(most, ahead[END]), from_there=TURN in self.last)
        ahead[SLIP] = motion.slips(self.mu, min(most, *ahead.values()), from_there=HOLD in self.last)
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

    def _slip(self, direction: FloatArray) -> str:
        """Go on to the next event with a slider that slips; returns it."""
        u = self.u
        bounce = max(abs(float(u[0])), sqrt(2.0 * self.stored))
        turns = max(abs(_cross(direction, self._pull(direction))) * bounce, abs(_cross(direction, u[1:])))
        if turns <= _LINE * max(bounce, hypot(u[1], u[2])):
            return self._line(direction, inf)
        if not _is_short(self.stored / bounce**2, direction.tolist(), u.tolist()):
            event = self._curve(direction, u, bounce)
            if event != END:
                return event
            assert self.direction is not None
            direction = self.direction
        most = 2.0 * _BEGUN * bounce if self.compressing else inf
        return self._line(direction, most) or self._slip(direction)

    def _pull(self, direction: FloatArray) -> FloatArray:
        """Change of tangential velocity per normal impulse, (2,)."""
        return np.asarray(self.G[1:, 0] - self.mu * (self.G[1:, 1:] @ direction))

    def _line(self, direction: FloatArray, most: float) -> str:
        """Go on along a line by at most so much normal impulse; returns the next event, empty if there is none."""
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
            turned = TURN in self.last and rate > 0.0
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
            return 1.0 if _is_short(exp(y[1]) / bounce**2, (cos(y[0]), sin(y[0])), velocity(y)) else -1.0

        def slider(y: FloatArray) -> float:
            u_n, x, z = velocity(y)
            return -(x * cos(y[0]) + z * sin(y[0]) + limit * u_n)

        events: dict[str, Callable[[FloatArray], float]] = {HOLD: slider}
        if self.compressing:
            events[TURN] = lambda y: velocity(y)[0]
        else:
            full = log(0.5 * self.peak * self.peak / kappa)
            events |= {END: left, LOAD: lambda y: min(float(y[1]) - full, -velocity(y)[0])}
        # Slip that follows u_t from the start on shows the solver no stiffness, and it takes steps without end.
        angle, nudge = atan2(direction[1], direction[0]), _NUDGE if turns * hypot(u[1], u[2]) > _STIFF else 0.0
        start = np.array((angle + nudge, log(self.stored), *self.impulse, self.friction_work))
        sizes = np.array([100.0, 1.0, *3 * (bounce,), bounce * max(bounce, hypot(u[1], u[2]))])
        event, y = until_event(rates, start, events, ROUNDING * sizes, _STEPS)
        self.direction = np.array([cos(y[0]), sin(y[0])])
        self.force = sqrt(2.0 * kappa * exp(y[1]))
        self.impulse, self.friction_work = y[2:5].copy(), float(y[5])
        if event != END:
            self._at(event)
        self.stretch = self.rho * mu * self.force * self.direction
        return event


def _is_short(stored: float, direction: Sequence[float], u: Sequence[float]) -> bool:
    """Whether a step along a line may begin or end the contact, with the energy stored then in units of the bounce."""
    speed = hypot(u[1], u[2])
    apart = abs(direction[0] * u[2] - direction[1] * u[1]) / speed if speed > 0.0 else 0.0
    return stored * (stored + apart) <= _BEGUN * _BEGUN


def _cross(a: FloatArray, b: FloatArray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def compliant(A: FloatArray, w: FloatArray, mu: float, e: float, rho: float) -> FrictionResult:
    """Solve an impact of one contact that approaches; equal arguments give equal results bit for bit.

    The status is ``unconverged`` if the slider never lets go, as where friction locks the contact.

    Args:
        A: Rows J L^-T of normal and two tangents with M = L L^T, (3, n); a tangent in which nothing moves may be zero.
        w: Mass-weighted velocity before, L^T qdot, (n,).
        mu: Coefficient of friction, > 0.
        e: Energetic coefficient of restitution, square root of the ratio of restitution work to compression work, 0 to 1.
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
    deepest = -0.5 * path.peak * path.peak
    works = (1.0 - e * e) * deepest, path.friction_work, deepest
    return result_of_path("compliant", status, A, w, impulse, np.array(works) * (speed * speed / scale), path.modes)
