"""Environments that are small enough for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.scenes import two_balls

PUSH: dict[str, Any] = {
    "actions": [{"kind": "effort", "actuators": ["robot/push_x"], "max_effort": 4.0}],
    "observations": ["q_robot_x_m", "v_robot_x_m_s", "data.joint.target/x.qpos", "closed_pairs", "force_N.touch"],
    "ticks_per_step": 5,
}
"""A sliding ball of 2 kg, pushed along x by up to 4 N, behind it one of 3 kg; steps of 10 ms."""


def pushed_ball(folder: Path, *, env: dict[str, Any] | None = None, **scenario: Any) -> Path:
    """The scenario of ``PUSH``: at rest, 10 mm apart, e = 0; 0.1 s long, ticks of 2 ms."""
    times = {"duration_s": 0.1, "time_step_s": 0.001, "control_period_s": 0.002}
    rules = {"rules": [{"between": ["ball", "target/target"], "restitution": 0.0, "name": "touch"}]}
    return two_balls(folder, speed=0.0, gap=0.01, **(times | {"contacts": rules, "env": PUSH | (env or {})} | scenario))


def steps_reward(step: Any, factor: float) -> float:
    """A reward function of a package."""
    return factor * (step.time_s > 0.0)
