"""Environments in orbit: an episode is the run, also after a reset, and motions of the tip are those that are asked for."""

from __future__ import annotations

import numpy as np

import ffsm_mj
from ffsm_mj.gym import ScenarioEnv
from tests.fields.test_laws import ARM
from tests.mutants.scenes import ASTEROID, TURN
from tests.scenes import ball, scene

START = {
    "frame": "lvlh",
    "joints": {"robot/free": [5.0, 3.0, -1.0, *TURN], "a": 0.4, "b": -0.8, "c": 0.6, "ball/free": [7.0, 3.1, -1.0, *TURN]},
    "rates": {"robot/free": [0.1, 0, 0, 0.1, 0.2, -0.3], "a": 0.3, "ball/free": [-3.0, 0, 0, 0, 0, 0.2]},
}


def in_orbit(folder, *actions, initial=START):
    """An arm and a ball that comes closer, with actions of an environment; 0.2 s."""
    return scene(
        folder,
        ARM,
        {"ball": ball("ball")},
        environment=ASTEROID,
        initial=initial,
        env={"actions": actions, "observations": ["q_robot_free_x_m"], "ticks_per_step": 5},
        duration_s=0.2,
        control_period_s=0.004,
        time_step_s=0.002,
    )


def episode(env, **reset):
    """The run of an episode under no effort."""
    env.reset(**reset)
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape))
        over = terminated or truncated
    return env.finish()


def test_an_episode_is_the_run_also_after_a_reset(tmp_path):
    path = in_orbit(tmp_path, {"kind": "effort", "actuators": ["a"], "max_effort": 1.0})
    env = ScenarioEnv(path, record=tmp_path / "episodes")
    env.reset(seed=0)
    for _ in range(3):  # an episode that does not come to its end, and moves differently
        env.step(np.ones(1))
    other = {"environment.orbit.true_anomaly_deg": 170.0}
    for number, changes in enumerate(({}, other, {})):
        made, alone = episode(env, options={"overrides": changes}), ffsm_mj.run(path, changes)
        keys = [
            key for key in alone.log.header.layout.keys if key.startswith(("state.", "orbit.", "balance.field", "energy."))
        ]
        for key in keys:
            np.testing.assert_array_equal(made[key], alone[key], err_msg=f"{number} {key}")
        assert all(check.passes for check in made.checks())
    assert len([key for key in keys if key.startswith("orbit.")]) > 20


def test_a_tip_that_is_to_rest_does_so_in_a_tide(tmp_path):
    """Velocity 0 is asked for, from rest: efforts are constant over ticks, so the error is of order one in their length.

    A field that is left out of the drift gives 2e-3 m at any length: half of 0.1 m/s^2 times (0.2 s)^2.
    """
    start = {"joints": START["joints"] | {"robot/free": [5.0, 3.0, -1.0, 1, 0, 0, 0]}}
    action = {"kind": "tip_velocity", "site": "tip", "max_speed_m_s": 0.1, "gain_1_s": 5.0, "axes": ["x", "y", "z"]}
    path, moved = in_orbit(tmp_path, action, initial=start), []
    for tick_s in (0.004, 0.002):
        env = ScenarioEnv(path, overrides={"control_period_s": tick_s})
        env.reset(seed=0)
        data, tip = env.simulator.observation.data, env.simulator.assembly.system.index("site", "robot/tip")
        first, over = data.site_xpos[tip].copy(), False
        while not over:
            *_, over, _ = env.step(np.zeros(3))
        moved.append(np.linalg.norm(data.site_xpos[tip] - first))
    assert moved[0] < 5e-5
    assert 1.8 < moved[0] / moved[1] < 2.2
