"""Images of an episode, and logs of one that is killed."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.gym import EnvError, RenderError, ScenarioEnv
from tests.gym.scenes import pushed_ball


def test_an_image_shows_the_motion_or_says_what_is_missing(tmp_path, monkeypatch):
    """Without OpenGL, as on a bare server, the message names what to install."""
    monkeypatch.setenv("MUJOCO_GL", "egl")
    env = ScenarioEnv(pushed_ball(tmp_path), render_mode="rgb_array", width=64, height=48)
    assert env.metadata["render_fps"] == pytest.approx(100.0)
    with pytest.raises(EnvError, match="nothing to render"):
        env.render()
    env.reset(seed=0, options={"overrides": {"initial.rates.robot/x": 3.0, "initial.joints.target/x": 2.0}})
    try:
        first = env.render()
    except RenderError as error:
        assert "libosmesa6" in str(error)  # noqa: PT017 (either is right, by machine)
        return
    for _ in range(9):
        env.step(np.zeros(1))
    second = env.render()
    assert (first.shape, first.dtype) == ((48, 64, 3), np.uint8)
    assert np.abs(second.astype(int) - first).max() > 50
    env.close()
    env.close()


@pytest.mark.parametrize(("backend", "said"), [("disable", "MUJOCO_GL=disable does not give it"), ("cgl", "MUJOCO_GL=cgl")])
def test_no_opengl(tmp_path, monkeypatch, backend, said):
    monkeypatch.setenv("MUJOCO_GL", backend)
    env = ScenarioEnv(pushed_ball(tmp_path), render_mode="rgb_array")
    env.reset()
    with pytest.raises(RenderError, match=said):
        env.render()


def test_a_camera_that_there_is_not(tmp_path):
    env = ScenarioEnv(pushed_ball(tmp_path), render_mode="rgb_array", camera="above")
    env.reset()
    with pytest.raises(RenderError, match="unknown camera 'above'"):
        env.render()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_killed_environment_leaves_a_readable_log(tmp_path):
    """The log is flushed at every event: killed after the impact, it has the impact."""
    scenario = pushed_ball(tmp_path)
    child = os.fork()
    if not child:
        env = ScenarioEnv(scenario, overrides={"initial.rates": {"robot/x": 1.0}}, record=tmp_path / "log")
        env.reset()
        env.step(np.zeros(1))
        env.step(np.zeros(1))
        os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    run = ffsm_mj.load_run(tmp_path / "log")
    assert run.outcome == "incomplete"
    assert [impact.impulse_N_s for impact in run.impacts] == pytest.approx([1.2])
