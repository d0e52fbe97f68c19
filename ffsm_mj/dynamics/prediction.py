"""Prediction of a state by the model's own motion under held efforts."""

from __future__ import annotations

import math
from typing import Any

import mujoco

from ffsm_mj.dynamics.step_path import time_step

_TURN = 0.05
"""Largest product of rates and sub-step, rad: RK4 then errs by some 1e-9 of a turn per sub-step."""
_MOST_STEPS = 200


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
    with time_step(model, duration_s / steps):
        for _ in range(steps):
            mujoco.mj_step(model, data)
