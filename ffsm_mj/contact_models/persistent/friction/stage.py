"""Contact forces with friction in one stage of a step, in modes that are frozen for the step."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.exchange import Slide, Stage
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision, slip_directions
from ffsm_mj.contact_models.persistent.friction.stage_equation import OwnVelocity
from ffsm_mj.contact_models.persistent.friction.state import FrictionState
from ffsm_mj.dynamics.implicit_stages import StageVelocity

_STIFF = 0.5
"""Friction damps a turn of the slip at the rate k / |u|, k = mu lambda_n times the inverse mass: stages are implicit where
the duration of the step times this rate exceeds this number. Explicit ones are unstable above 2.8."""
_NEAR_STOP = 12.0
"""A step is divided where a point would stop within this many durations of the step."""
_STOP_SHARE = 0.5
"""Such a step takes at most this share of the time to the stop."""
_TURN_ERROR_M_S = 1e-12
"""Error of the slip velocity in such a step."""
_TURN = 1.5
"""Turn of the slip, rad, at which a step of order four errs by the whole slip."""


def stage_of(here: FrictionState, implicit: StageVelocity | None) -> tuple[Stage, FloatArray]:
    """Contact forces in a stage.

    Args:
        here: The points that slide or stick, at the state of the stage.
        implicit: Velocity of the stage as a function of its accelerations; None in an explicit method.

    Returns:
        The stage, and the generalised contact forces, (nv,).
    """
    rows, modes = here.rows, here.modes
    if not modes.any_slides:
        return here.stuck_stage()
    forces, u = _sliding_forces(here, implicit), rows.slips
    along = forces.reshape(-1)
    generalised = along.dot(rows.J)
    heat = -np.sum(forces[:, 1:] * u, axis=1) * modes.slides
    slip_speeds = np.hypot(u[:, 0], u[:, 1]) * modes.slides
    return Stage(rows, along, generalised * rows.qvel, Slide(heat, slip_speeds)), generalised


def _sliding_forces(here: FrictionState, implicit: StageVelocity | None) -> FloatArray:
    """Forces (n, t1, t2) of points some of which slide, N, (k, 3)."""
    rows, problem, modes = here.rows, here.problem, here.modes
    at_start = modes.start_directions(rows.axes)
    directions, _ = slip_directions(problem, rows.slips, at_start, modes.slides, modes.straight)
    free = np.flatnonzero(modes.slides & ~problem.lines & ~modes.straight) if implicit is not None else ()
    if implicit is None or not len(free):
        return problem.forces(modes.kinds, directions)
    without = rows.J @ implicit.given + implicit.step_s * (rows.response @ here.force)
    if rows.loop_rates is not None:
        without += implicit.step_s * rows.loop_rates
    # Slip at the start of a slide is rounding without direction; that of its start is the estimate.
    directions[free] = at_start[free]
    velocity = OwnVelocity(without, implicit.step_s, np.asarray(free))
    found = problem.forces_along_slip(modes.kinds, directions, velocity)
    # A point that stops within the stage keeps the sense of its friction.
    return problem.forces(modes.kinds, directions) if found is None else found[0]


def step_limit(decision: FrictionalDecision, left_s: float) -> tuple[float, bool]:
    """Longest (sub-)step for the points that slide in a plane, s, and whether its stages must be implicit.

    Args:
        decision: Choice of modes at the start of the step.
        left_s: Remaining time of the grid step, s.
    """
    if decision.sticks or not (slides := decision.turning).any():
        return left_s, False
    problem, solution = decision.problem, decision.solution
    u = decision.rows.slips[slides]
    s, a = solution.directions[slides], solution.accelerations[slides, 1:]
    speeds = np.hypot(u[:, 0], u[:, 1])
    slowing = -np.sum(s * a, axis=1)
    turning = np.abs(s[:, 0] * a[:, 1] - s[:, 1] * a[:, 0])
    limit = left_s
    for speed, brake, turn in zip(speeds.tolist(), slowing.tolist(), turning.tolist(), strict=True):
        # A point that begins to slide has a slip of rounding: nothing that stops.
        if brake > 0.0 and _TURN_ERROR_M_S < speed < _NEAR_STOP * left_s * brake:
            share = (_TURN_ERROR_M_S / speed) ** 0.2
            limit = min(limit, _STOP_SHARE * speed / brake, _TURN * share * speed / turn if turn else np.inf)
    rates = (problem.mu * solution.forces[:, 0] * problem.tangent_inverse_mass)[slides]
    return limit, bool(np.any(limit * rates > _STIFF * speeds))
