"""Curved segments of the impulse path of one contact, where the direction of slip turns: integrated numerically.

With slip u_t = R (cos theta, sin theta) and the parameter dp = R dtau, the singularity at u_t = 0 disappears:

    theta' = s x (g - mu H s),  (ln R)' = s . (g - mu H s),  p' = R,  lambda_t' = -mu R s,  W' = R u_n
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, exp, hypot, sin, sqrt
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.path import END, NONE, STOP, TURN, Path, Problem

_STOPPED = -23.0
"""ln(R / R0) at which integration ends, a slip of 1e-10 of the initial one: the rest of the path to u_t = 0 is straight."""
_TAU_END = 1e12
"""End of integration: never reached, since an event or the number of steps ends it before."""
_MAX_STEPS = 3000
_ROUNDING = 1e-15
"""Absolute tolerance of integration, relative to the size of each component."""
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
    event, y = _until_event(_rates(problem, begin), start, _events(target), _ROUNDING * sizes)
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


def _until_event(
    rates: Callable[[float, FloatArray], list[float]],
    start: FloatArray,
    events: dict[str, Callable[[FloatArray], float]],
    rounding: FloatArray,
) -> tuple[str, FloatArray]:
    from scipy.integrate import LSODA

    # A stiff method: for slip that is slow compared with the bounce, its direction settles at once.
    solver: Any = LSODA(rates, 0.0, start, _TAU_END, rtol=1e-13, atol=rounding)
    before = start
    for _ in range(_MAX_STEPS):
        solver.step()
        if solver.status != "running":
            return NONE, before
        passed = [name for name, value in events.items() if value(before) <= 0.0 < value(solver.y)]
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
    tau = brentq(lambda tau: value(dense(tau)), solver.t_old, solver.t, xtol=1e-300, rtol=1e-15)
    return tau, dense(tau)


def _put(path: Path, y: FloatArray, begin: float) -> None:
    path.direction = np.array([cos(y[_THETA]), sin(y[_THETA])])
    path.direction /= hypot(*path.direction)
    path.speed = begin * exp(y[_LOG])
    path.impulse = y[2:5].copy()
    path.u_n, path.normal_work, path.friction_work = float(y[_U_N]), float(y[_WORK]), float(y[_FRICTION])
