"""Longest steps for points that slide in two directions, and whether the steps must be implicit.

Friction turns the slip u at the rate (k + |f|) / |u|, with k = mu N times the inverse mass and the slip acceleration f. A
slip in a wrong direction, as rounding, an impact or a jump of the efforts leaves it, is thus turned within a layer of some
|u| / k, within which steps must follow it. The component across the direction to which it turns, the deviation, falls with
exp(-integral of k / |u| dt). Behind the layer, where none is left, the slip is as smooth as the forces, and only explicit
stages would have to follow the rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision

STIFF = 0.1
"""Settled points make a step implicit where its duration times their rate exceeds this. RK4 is stable up to 2.8, but beyond
this it errs by 1e-9 m/s just after a start of slip, when the step is as long as the time since then."""
DEVIATION_M_S = 1e-12
"""A smaller deviation is rounding."""
_ERROR_M_S, _LEAST, _MOST = 24e-12, 0.05, 1.0
"""Unsettled points make steps no longer than (first / deviation)^(1/5) over their rate, a number within the other two.

A step of RK4 turns the deviation with an error of (h rate)^5 / 120: of 2e-13 m/s, in a layer of several steps the rounding
of slips."""
NEAR_STOP = 6.0
"""A step is divided where a point would stop within this many durations of the step."""
_STOP_SHARE = 0.5
"""Such a step takes at most this share of the time to the stop."""


class Layers(NamedTuple):
    """Layers of points that slide, at the start of a (sub-)step.

    Attributes:
        points: The points that slide in two directions, m.
        efforts: Efforts, bit by bit.
        time_s: Time of the start.
        deviations: Deviations at the start of the layer, m/s, (m,).
        damping: Integral of k / |u| since then, (m,).
        speeds: Slips, m/s, (m,).
        strengths: k, m/s^2, (m,).
    """

    points: tuple[ContactPoint, ...]
    efforts: bytes
    time_s: float
    deviations: FloatArray
    damping: FloatArray
    speeds: FloatArray
    strengths: FloatArray


class StepRule(NamedTuple):
    """What limits a (sub-)step.

    Attributes:
        limit_s: Its longest duration, s.
        implicit: Whether its stages must be implicit.
        layers: Layers of the points that slide; None without any.
    """

    limit_s: float
    implicit: bool = False
    layers: Layers | None = None


def step_rule(decision: FrictionalDecision, last: Layers | None, left_s: float, time_s: float, efforts: bytes) -> StepRule:
    """What limits a (sub-)step for the points that slide in two directions.

    Args:
        decision: Choice of modes at the start of the step.
        last: Layers at the start of the step before.
        left_s: Remaining time of the grid step, s.
        time_s: Time at the start of the step.
        efforts: Efforts in it, bit by bit.
    """
    if decision.sticks or not (slides := decision.turning).any():
        return StepRule(left_s)
    problem, solution = decision.problem, decision.solution
    u, d = decision.rows.slips[slides], solution.directions[slides]
    f = solution.accelerations[slides, 1:]
    k = (problem.mu * np.maximum(solution.forces[:, 0], 0.0) * problem.tangent_inverse_mass)[slides]
    # A point that begins to slide has the direction to which friction turns it, and a slip of rounding.
    r = np.where(decision.slipping[slides], np.hypot(u[:, 0], u[:, 1]), 0.0)
    along, across = np.sum(d * f, axis=1), np.abs(d[:, 0] * f[:, 1] - d[:, 1] * f[:, 0])
    stiffness = np.maximum(k + np.abs(along), np.finfo(float).tiny)
    deviations = r * np.minimum(1.0, across / stiffness)
    points = tuple([point for point, turns in zip(decision.contact_points, slides.tolist(), strict=True) if turns])
    first, damping = deviations, np.zeros(len(points))
    if last is not None and last.points == points and last.efforts == efforts and not decision.changes_modes:
        # The layer goes on.
        slips = np.maximum(np.maximum(r, last.speeds), np.finfo(float).tiny)
        first, damping = last.deviations, last.damping + last.strengths * (time_s - last.time_s) / slips
    layers = Layers(points, efforts, time_s, first, damping, r, k)
    # A direction that changes on and on stays behind: only what is left of the deviation at the start falls at the rate.
    left = np.minimum(deviations, first * np.exp(-damping))
    settled = left <= DEVIATION_M_S
    turning, limit = k + np.hypot(f[:, 0], f[:, 1]), left_s
    for speed, rate, deviation, brake, rests in zip(
        r.tolist(), turning.tolist(), left.tolist(), (-along).tolist(), settled.tolist(), strict=True
    ):
        if not rests:
            share = min(max((_ERROR_M_S / deviation) ** 0.2, _LEAST), _MOST)
            limit = min(limit, share * speed / rate)
        if brake > 0.0 and DEVIATION_M_S < speed < NEAR_STOP * left_s * brake:
            limit = min(limit, _STOP_SHARE * speed / brake)
    return StepRule(limit, bool(np.any(settled & (limit * turning > STIFF * r))), layers)
