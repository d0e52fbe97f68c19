"""Shipped environments: the scripted policies succeed, random actions do not, and the draws are those of campaigns."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from ffsm_mj.errors import InputError
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.worker import prepared_run
from ffsm_mj.gym import ScenarioEnv
from ffsm_mj.gym.policies import BASELINES
from ffsm_mj.scenario.shipped import scenarios_dir
from tests.gym.scenes import PUSH, pushed_ball

NEAR = {"initial.joints.object/x": 4.08, "initial.joints.object/y": -0.5}
"""The box is 20 mm from the tip."""


def ending(env, policy, seed, **options):
    observation, _ = env.reset(seed=seed, options=options)
    while True:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        if terminated or truncated:
            return info["ending"]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("is_scripted", [True, False])
@pytest.mark.parametrize("name", BASELINES)
def test_the_scripted_policy_succeeds_and_random_actions_do_not(name, is_scripted, seed):
    env = gymnasium.make(name)
    env.action_space.seed(seed)
    policy = BASELINES[name] if is_scripted else lambda _: env.action_space.sample()
    assert (ending(env, policy, seed) == "success") is is_scripted


def planar(**overrides):
    return ScenarioEnv(scenarios_dir() / "gym" / "capture-planar.yaml", {"design": None}, NEAR | overrides)


def test_a_capture_by_a_request_and_a_reset_while_it_holds():
    """Latched within the gap over the speed of the policy, 20 mm at 30 mm/s; without the request the tip bounces."""
    env, policy = planar(duration_s=2.0), BASELINES["ffsm_mj/CapturePlanar-v0"]
    first = [env.reset(seed=0)[0]]
    while not (step := env.step(policy(first[-1])))[2]:
        first.append(step[0])
    assert step[4]["ending"] == "success"
    assert 0.5 < step[4]["time_s"] < 1.2
    assert [type(record).__name__ for record in step[4]["events"]].count("GraspRecord") == 1
    again = [env.reset(seed=0)[0]]
    for _ in first[1:]:
        again.append(env.step(policy(again[-1]))[0])
    np.testing.assert_array_equal(again, first)
    assert ending(env, lambda seen: policy(seen) * [1, 1, -1], 0) == "failure"


def test_tip_velocity_is_reached_as_a_first_order_lag():
    """V' = 4 (v_0 - v) held over ticks of 10 ms: v = v_0 (1 - exp(-4 t)) to the period times the rate, 4 %."""
    env = planar(duration_s=0.5)
    env.reset(seed=0)
    for k in range(1, 6):
        observation, *_ = env.step(np.array([0.0, 0.5, -1.0]))
        assert observation[3] == pytest.approx(0.15 * (1 - np.exp(-0.4 * k)), rel=0.04)
        assert abs(observation[2]) < 0.002


def test_tip_velocity_accounts_for_a_grasped_object():
    """The same lag after the capture of the box: of the arm alone, a third of the speed after 0.1 s would be missing."""
    path = scenarios_dir() / "gym" / "capture-planar.yaml"
    on = {"design": None, "success": "grasps.count == 2"}
    env, policy = ScenarioEnv(path, on, NEAR | {"duration_s": 2.0}), BASELINES["ffsm_mj/CapturePlanar-v0"]
    observation = env.reset(seed=0)[0]
    while not env.simulator.observation.grasps:
        observation, *_ = env.step(policy(observation))
    begun = observation[3]
    for k in range(1, 4):
        observation, *_ = env.step(np.array([0.0, 0.5, -1.0]))
        assert observation[3] == pytest.approx(0.15 + (begun - 0.15) * np.exp(-0.4 * k), rel=0.04)


def test_tip_wrench_does_the_work_that_it_says():
    """Power of the joints is force times velocity of the tip, less what momentum alone moves it: none, from rest."""
    env = ScenarioEnv(scenarios_dir() / "gym" / "touch.yaml", {"design": None, "ticks_per_step": 1})
    env.reset(seed=0)
    env.step(np.array([0.5, 0.0]))
    data, task = env.simulator.assembly.data, env._bound.actions._parts[0][1]._tasks[""]
    task.update(data)
    efforts = env.simulator.assembly.actuation.applied[task.joints.actuators]
    assert efforts.dot(task.qd) == pytest.approx(1.0 * task.yd[0], rel=1e-3)  # the arm turns by 1e-4 rad in the tick


def draws(folder):
    """An environment with a campaign of four rows: masses and places of the target."""
    (folder / "draws.yaml").write_text(
        '{"campaign": "draws", "scenario": "scene.yaml", "samples": {"kind": "random", "n": 4},'
        ' "overrides": {"duration_s": 0.05}, "dispersions": {"initial.joints.target/x": {"uniform": [0.3, 0.6]},'
        ' "model.target.target.mass_kg": {"scale": {"uniform": [0.5, 2.0]}}}}'
    )
    return pushed_ball(folder, env={"design": "draws.yaml"}, seed=7)


def test_rows_are_those_of_the_campaign(tmp_path):
    """Run k of the campaign and reset(seed=k) have the same scenario, noise included; k counts modulo n."""
    env = ScenarioEnv(draws(tmp_path))
    folder = Campaign.load(tmp_path / "draws.yaml", tmp_path / "campaign")
    for number, row in ((3, 3), (4 + 2, 2)):
        _, info = env.reset(seed=number)
        ours = env.simulator.assembly.scenario
        job = folder._job(exclusive=False)
        theirs = prepared_run(job, row, folder.design.overrides(row)).scenario
        assert info["row"] == row
        assert ours.seed == theirs.seed + number - row == 7 + number
        assert (ours.initial, ours.model, ours.duration_s) == (theirs.initial, theirs.model, theirs.duration_s)
    assert env.reset()[1]["row"] == 3


def test_a_vector_takes_each_row_once(tmp_path):
    """Two environments with stride 2: rows 0, 2 and 1, 3. A key that the scenario lacks is a fault of the campaign file."""
    scenario = draws(tmp_path)
    environments = [ScenarioEnv(scenario, stride=2) for _ in range(2)]
    taken = [(env.reset(seed=k)[1]["row"], env.reset()[1]["row"]) for k, env in enumerate(environments)]
    assert taken == [(0, 2), (1, 3)]
    campaign = tmp_path / "draws.yaml"
    campaign.write_text(campaign.read_text().replace("target/x", "nothing"))
    with pytest.raises(InputError, match=r"env\.design: .*draws\.yaml"):
        ScenarioEnv(scenario)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_processes_step_at_once(tmp_path):
    """AsyncVectorEnv: two worker processes, the same episodes as alone."""
    scenario = pushed_ball(tmp_path)
    vector = gymnasium.make_vec(
        "ffsm_mj/Scenario-v0", num_envs=2, vectorization_mode="async", scenario=str(scenario), env=dict(PUSH)
    )
    try:
        observations, infos = vector.reset(seed=0)
        assert infos["seed"].tolist() == [0, 1]
        observations, rewards, *_ = vector.step(np.array([[1.0], [-1.0]], dtype=np.float32))
        assert observations[:, 1] == pytest.approx([0.02, -0.02], abs=1e-14)
        assert rewards.tolist() == [0.0, 0.0]
    finally:
        vector.close()


@pytest.mark.parametrize("word", ["force_N.paddle", pytest.param("BASELINES", marks=pytest.mark.long)])
def test_examples_of_the_page(word, capsys):
    """The code of docs/gymnasium.md prints what it promises."""
    page = (Path(__file__).parents[2] / "docs" / "gymnasium.md").read_text()
    code = next(block for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if word in block)
    exec(code, {})
    promised = re.search(r"print\(.*\)  # (.*)$", code, flags=re.MULTILINE).group(1)
    assert capsys.readouterr().out.strip() == promised


def test_an_episode_goes_on_after_a_capture():
    """The number of the request stays above 0: nothing is armed while the box is held, and velocities are still followed."""
    path, endless = scenarios_dir() / "gym" / "capture-planar.yaml", {"design": None, "success": None, "failure": None}
    env = ScenarioEnv(path, endless | {"forbidden_contacts": []}, NEAR | {"initial.joints.object/x": 4.095})
    observation, _ = env.reset(seed=0)
    held = False
    while not held:
        observation, *_, info = env.step(BASELINES["ffsm_mj/CapturePlanar-v0"](observation))
        held = bool(env.simulator.observation.grasps)
    for _ in range(10):
        observation, _, terminated, *_ = env.step(np.array([0.3, 0.2, 1.0]))
    assert not terminated
    assert 0.02 < observation[2] < 0.09  # the load is not in the law: slower than 4 1/s, towards 0.09 m/s
    assert info["time_s"] < 0.6
