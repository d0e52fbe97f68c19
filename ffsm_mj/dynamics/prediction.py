"""Prediction of a state by the model's own motion under held efforts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco

from ffsm_mj.dynamics.joint_springs import JointSprings
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.dynamics.loops.rows import RowSource
from ffsm_mj.dynamics.motion import Motion, clear_applied_forces
from ffsm_mj.dynamics.step_path import time_step
from ffsm_mj.model.system import has_springs_or_dampers
from ffsm_mj.tolerances import DAMPER_STEP, MECHANISM_RANK, MODE_STEP

_TURN = 0.05
"""Largest product of rates and sub-step, rad: RK4 then errs by some 1e-9 of a turn per sub-step."""
_MOST_STEPS = 200
"""Largest number of sub-steps for rates alone; springs and dampers need theirs, or RK4 is unstable."""


def predict(model: Any, data: Any, duration_s: float) -> None:
    """Integrate the state in ``data`` under its ``ctrl``, without contact forces; derived quantities are not updated.

    Args:
        model: MuJoCo model, with RK4.
        data: Its data.
        duration_s: How far ahead, s; nothing is done unless it is positive.
    """
    if not duration_s > 0.0:
        return
    fastest = max(map(abs, data.qvel.tolist()), default=0.0)
    steps = min(max(1, math.ceil(duration_s * fastest / _TURN)), _MOST_STEPS)
    if has_springs_or_dampers(model):
        mujoco.mj_fwdPosition(model, data)
        mode, decay = JointSprings(model).fastest(model, data)
        steps = max(steps, math.ceil(duration_s * max(mode.rate / MODE_STEP, decay.rate / DAMPER_STEP)))
    if sources := [each.source for each in equalities_of(model)]:
        _predict_mechanism(model, data, sources, duration_s, steps)
        return
    with time_step(model, duration_s / steps):
        for _ in range(steps):
            mujoco.mj_step(model, data)


def _predict_mechanism(model: Any, data: Any, sources: Sequence[RowSource], duration_s: float, steps: int) -> None:
    """The same with equality constraints."""
    mujoco.mj_forward(model, data)
    motion = Motion(model, data)
    loops = motion.loops = ClosedLoops(model, data, sources, rank=MECHANISM_RANK)
    motion.push_with([], [lambda _: loops.push()])
    for _ in range(steps):
        loops.choose()
        motion.step(duration_s / steps)
    clear_applied_forces(model, data)
