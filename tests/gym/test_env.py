"""Environments: their interface, the physics of an episode, its ends, and what is refused."""

from __future__ import annotations

import importlib
import math
import pickle
import sys
import threading
from importlib.metadata import EntryPoint

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ffsm_mj
import ffsm_mj.gym
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.errors import InputError, MissingPackageError
from ffsm_mj.gym import EnvError, ScenarioEnv, rewards
from ffsm_mj.records.events import ImpactRecord
from tests.gym.scenes import PUSH, pushed_ball

ONE = np.ones(1, dtype=np.float32)
FAST = {"initial.rates": {"robot/x": 1.0}}
"""The balls meet at t = 10 ms."""


def episode(env, action=ONE, seed=0, **reset):
    """Observations, rewards and information of an episode under one action."""
    steps = [(*env.reset(seed=seed, **reset),)]
    done = False
    while not done:
        observation, reward, terminated, truncated, info = env.step(action)
        steps.append((observation, reward, terminated, truncated, info))
        done = terminated or truncated
    return steps


def test_the_checker_of_gymnasium_has_nothing_to_say(tmp_path):
    """Every warning is an error here; rendering is tested elsewhere."""
    env = ffsm_mj.gym.make(pushed_ball(tmp_path, duration_s=0.03))  # with the passive checker around it
    check_env(env.unwrapped, skip_render_check=True)
    episode(env)


def test_motion_under_an_action_is_that_of_the_force(tmp_path):
    """Half of 4 N on 2 kg from rest: x = t^2 / 2, v = t, to rounding; contact only after 0.14 s."""
    env = ScenarioEnv(pushed_ball(tmp_path))
    steps = episode(env, 0.5 * ONE)
    assert len(steps) == 11
    for k, step in enumerate(steps):
        np.testing.assert_allclose(step[0], [(0.01 * k) ** 2 / 2, 0.01 * k, 0.21, 0.0, 0.0], atol=1e-14)
    assert steps[-1][2:4] == (False, True)
    assert steps[-1][4]["ending"] == "duration"


def test_a_scenario_of_a_program_is_one_too(tmp_path):
    """The same episode as of its file."""
    path = pushed_ball(tmp_path)
    files = episode(ffsm_mj.gym.make(path))
    for scenario in (ffsm_mj.Scenario.load(path), ffsm_mj.Scenario.load(path).with_overrides({"description": "again"})):
        for one, other in zip(episode(ffsm_mj.gym.make(scenario)), files, strict=True):
            np.testing.assert_array_equal(one[0], other[0])


def test_contact_force_and_records(tmp_path):
    """E = 0 at 1 m/s on 3 kg: impulse 1.2 N s, then 4 N on both of 5 kg presses with 4 N * 3/5."""
    env = ScenarioEnv(pushed_ball(tmp_path), overrides=FAST | {"duration_s": 0.05})
    steps = episode(env, 0.0 * ONE)
    impacts = [record for step in steps[1:] for record in step[4]["events"] if isinstance(record, ImpactRecord)]
    assert len(impacts) == 1
    assert impacts[0].impulse_N_s == pytest.approx(1.2, abs=1e-12)
    env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(ONE)
    assert observation[3:].tolist() == pytest.approx([1.0, 2.4], abs=1e-9)


def test_a_reset_in_the_middle_of_a_contact_leaves_nothing(tmp_path):
    """Bit for bit the episode of an environment that has done nothing before; seeds and rows count on."""
    scenario = pushed_ball(tmp_path)
    env, other = (ScenarioEnv(scenario, overrides=FAST | {"duration_s": 0.04}) for _ in range(2))
    env.reset(seed=4)
    for _ in range(3):
        observation, *_ = env.step(ONE)
    assert observation[3] == 1.0
    for before, after in zip(episode(other, seed=0), episode(env, seed=0), strict=True):
        assert before[0].tobytes() == after[0].tobytes()
    assert env.reset()[1]["seed"] == 1


def test_two_environments_in_turn_and_in_threads_do_not_meet(tmp_path):
    scenario = pushed_ball(tmp_path)
    fast = FAST | {"duration_s": 0.03}
    alone = [step[0] for step in episode(ScenarioEnv(scenario, overrides=fast))]
    a, b = ScenarioEnv(scenario, overrides=fast), ScenarioEnv(scenario)
    turns = [(a.reset(seed=0)[0], b.reset(seed=0)[0])]
    turns += [(a.step(ONE)[0], b.step(-ONE)[0]) for _ in alone[1:]]
    np.testing.assert_array_equal([each for each, _ in turns], alone)
    a.close()
    b.step(ONE)  # closing one does not end the other
    found = {}

    def run(name):
        found[name] = [step[0] for step in episode(ScenarioEnv(scenario, overrides=fast))]

    threads = [threading.Thread(target=run, args=(name,)) for name in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for each in found.values():
        np.testing.assert_array_equal(each, alone)


def test_ends_of_an_episode(tmp_path):
    """Success and failure, a forbidden contact, a bound: each at the control tick at which it holds, failure first."""
    moved = {"success": "q_robot_x_m > 0.005 and time_s > 0.001"}
    cases = [
        (moved, True, "success", 0.006),
        (moved | {"failure": "v_robot_x_m_s > 0"}, False, "failure", 0.002),
        ({"forbidden_contacts": ["touch"]}, False, "forbidden contact touch", 0.010),
        ({"bounds": {"q_robot_x_m": [-1.0, 0.003]}}, False, "bound of q_robot_x_m", 0.004),
        ({"success": "impacts.count == 1 and impacts.0.impulse_N_s < 1.3"}, True, "success", 0.010),
        ({"success": "contacts.count == 1 and contacts.0.start_s < 0.02"}, True, "success", 0.012),
    ]
    scenario = pushed_ball(tmp_path)
    for env, success, ending, time_s in cases:
        steps = episode(ScenarioEnv(scenario, env, FAST), 0.0 * ONE)
        _, reward, terminated, truncated, info = steps[-1]
        assert (terminated, truncated, info["success"], info["ending"]) == (True, False, success, ending)
        assert info["time_s"] == pytest.approx(time_s, abs=0.0021)
        assert reward == (1.0 if success else -1.0)


def test_overlaps_that_no_rule_covers_are_forbidden_by_name(tmp_path):
    """Without a rule the balls pass through each other from 0.01 s on: seen one tick later, when its row is written."""
    rules = {"contacts.rules": [], "duration_s": 0.05, "env.observations": ["q_robot_x_m"]}
    scenario = pushed_ball(tmp_path)
    assert episode(ScenarioEnv(scenario, overrides=FAST | rules), 0.0 * ONE)[-1][3]
    steps = episode(ScenarioEnv(scenario, {"forbidden_contacts": ["unhandled"]}, FAST | rules), 0.0 * ONE)
    assert steps[-1][4]["ending"] == "forbidden contact robot/ball and target/target"
    assert steps[-1][4]["time_s"] == pytest.approx(0.014, abs=1e-9)


def test_metrics_are_those_of_the_finished_run(tmp_path):
    """Names and numbers of a campaign: the lists of ``summary.json`` when the episode is over."""
    env = ScenarioEnv(pushed_ball(tmp_path), {"success": "phases.count > 9 and contacts.count > 9"}, FAST)
    episode(env)
    metrics = {name: env._bound.episode.metric(name)() for name in ("impacts.0.impulse_N_s", "contacts.count", "duration_s")}
    summary = env.finish().summary()
    assert metrics["impacts.0.impulse_N_s"] == summary["impacts"][0]["impulse_N_s"]
    assert metrics["contacts.count"] == len(summary["contacts"]) == 1
    assert metrics["duration_s"] == summary["duration_s"]


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (np.zeros(2), r"action: shape \(2,\), but \(1,\) is needed"),
        ([math.nan], "action: must be finite, but is not at 0"),
        (["north"], "action: not numbers"),
        (None, r"action: shape|not finite|must be finite"),
    ],
)
def test_actions_that_are_refused(tmp_path, action, said):
    env = ScenarioEnv(pushed_ball(tmp_path))
    env.reset()
    with pytest.raises(EnvError, match=said):
        env.step(action)
    env.step(2.0 * ONE)  # is clipped, and the episode goes on


def test_steps_without_an_episode_and_closing_twice(tmp_path):
    env = ScenarioEnv(pushed_ball(tmp_path), overrides={"duration_s": 0.01})
    with pytest.raises(EnvError, match=r"there is no episode\): reset\(\) begins"):
        env.step(ONE)
    episode(env)
    with pytest.raises(EnvError, match=r"no step can be taken \(duration\)"):
        env.step(ONE)
    env.close()
    env.close()
    with pytest.raises(EnvError, match="there is no episode"):
        env.step(ONE)


@pytest.mark.parametrize(
    ("reward", "said"),
    [
        (lambda _: 1 / 0, r"reward '<lambda>' at t = 0.01 s: ZeroDivisionError: division by zero \(test_env.py:\d+\)"),
        (lambda _: math.nan, "reward '<lambda>' at t = 0.01 s: is nan, not a finite number"),
        (lambda _: "much", "reward '<lambda>' at t = 0.01 s: is 'much', not a finite number"),
    ],
)
def test_rewards_that_fail_are_named(tmp_path, reward, said):
    env = ScenarioEnv(pushed_ball(tmp_path), {"reward": reward})
    env.reset()
    with pytest.raises(EnvError, match=said):
        env.step(ONE)


def test_a_reward_of_a_script_and_one_with_arguments(tmp_path):
    scenario = pushed_ball(tmp_path)
    steps = episode(ScenarioEnv(scenario, {"reward": lambda step: step.after[1] - step.before[1]}), 0.5 * ONE)
    assert sum(step[1] for step in steps[1:]) == pytest.approx(0.1, abs=1e-14)
    reward = {"function": "nearer", "arguments": {"site": "robot/centre", "to": "target/centre", "distance_m": 0.001}}
    steps = episode(ScenarioEnv(scenario, {"reward": reward}, {"duration_s": 0.02}), 0.5 * ONE)
    assert [step[1] for step in steps[1:]] == pytest.approx([0.0, 0.15], abs=1e-10)  # 0.2 mm - 0.05 mm after the first step


def test_an_observation_that_is_not_finite_is_named(tmp_path):
    late = {"late": {"kind": "jointpos", "of": "robot/x", "delay_s": 0.05}}
    env = ScenarioEnv(pushed_ball(tmp_path, sensors=late), {"observations": ["measured.late"]})
    with pytest.raises(EnvError, match=r"not finite: measured.late; until a sample arrives, .*before: NUMBER"):
        env.reset()


def test_a_value_stands_in_for_a_sample_that_has_not_arrived(tmp_path):
    """A sensor with a delay of 50 ms: -7 until then, and afterwards the position of 50 ms before."""
    late = {"late": {"kind": "jointpos", "of": "robot/x", "interval_s": 0.002, "delay_s": 0.05}}
    seen = ["time_s", "q_robot_x_m", {"of": "measured.late", "before": -7.0}, {"of": "measured.late.0", "before": -8.0}]
    env = ScenarioEnv(pushed_ball(tmp_path, sensors=late), {"observations": seen, "ticks_per_step": 1})
    time_s, place, whole, number = np.array([step[0] for step in episode(env)]).T
    early = time_s < 0.05 - 1e-9
    assert 0 < early.sum() == 25  # ticks of 2 ms, the last of them at 48 ms
    assert set(whole[early]) == {-7.0}
    assert set(number[early]) == {-8.0}
    assert whole[~early].tolist() == number[~early].tolist() == place[: (~early).sum()].tolist()
    assert place[(~early).sum() - 1] > 0.0  # it has moved in what arrived
    with pytest.raises(InputError, match=r"'before' is of samples that arrive.*; time_s is known"):
        ScenarioEnv(pushed_ball(tmp_path), {"observations": [{"of": "time_s", "before": 0.0}]})


def test_a_record_is_a_log_that_verifies(tmp_path):
    """Each episode has a folder; its run passes its checks, and begins like one that the phases command."""
    env = ScenarioEnv(pushed_ball(tmp_path), overrides=FAST | {"duration_s": 0.02}, record=tmp_path / "log")
    episode(env)
    episode(env)
    run = env.finish()
    assert all(check.passes for check in all_checks(run))
    for name in ("log", "log-2"):
        logged = ffsm_mj.load_run(tmp_path / name)
        assert logged.outcome == "completed"
        assert logged.log.column("actuators.robot_push_x_applied_N")[3] == 4.0


def test_seeds_are_those_of_noise(tmp_path):
    """reset(seed=k) has the noise of the scenario's seed plus k, as run k of a campaign has."""
    noisy = {"x": {"kind": "jointpos", "of": "robot/x", "noise": 0.01}}
    scenario = pushed_ball(tmp_path, sensors=noisy, seed=7)
    env = ScenarioEnv(scenario, {"observations": ["measured.x"]})
    run = ffsm_mj.run(scenario, {"seed": 9})
    observation, info = env.reset(seed=2)
    measured = next(key for key in run.log.header.layout.keys if key.startswith("sensor."))
    assert observation[0] == run.log.column(measured)[0]
    assert info["seed"] == 9
    assert env.reset()[1]["seed"] == 10


def test_faults_name_file_line_key_and_what_is_allowed(tmp_path, capsys):
    env = {
        "actions": [{"kind": "effort", "actuators": ["push_z"]}, {"kind": "request", "request": "grasp.arm"}],
        "observations": ["q_robot_y_m", "energy.total_J", {"of": "data.site.nowhere.xpos"}],
        "success": "grasps.0.peak_force_N < 1",
        "bounds": {"data.qpos": [0, 1]},
        "forbidden_contacts": ["wall"],
    }
    path = pushed_ball(tmp_path, env=env)
    with pytest.raises(InputError) as caught:
        ScenarioEnv(path)
    said = {line.split(": ")[1]: line for line in caught.value.lines}
    assert all(line.startswith(f"{path}:1:") for line in caught.value.lines)
    assert "unknown actuator 'push_z'" in said["env.actions.0.actuators.0"]
    assert "robot/push_x" in said["env.actions.0.actuators.0"]
    assert "unknown request 'grasp.arm'" in said["env.actions.1.request"]
    assert "did you mean 'state.q_robot_x_m'" in said["env.observations.0"]
    assert "is computed for rows of the log only" in said["env.observations.1"]
    assert "unknown site 'nowhere'" in said["env.observations.2.of"]
    assert "known at the end of a run only" in said["env.success"]
    assert "is 2 numbers" in said["env.bounds.data.qpos"]
    assert "touch" in said["env.forbidden_contacts.0"]
    assert main(["run", str(path), "-s", "duration_s=0.01", "--out", str(tmp_path / "out"), "--no-rerun"]) == 0  # ignores it
    capsys.readouterr()


@pytest.mark.parametrize(
    ("env", "key", "said"),
    [
        ({"actions": [{"kind": "fly"}]}, "actions.0.kind", "allowed: effort, request, tip_velocity, tip_wrench"),
        ({"actions": [{"kind": "effort", "actuator": ["push_x"]}]}, "actions.0.actuator", "did you mean 'actuators'"),
        (
            {"actions": [{"kind": "effort", "actuators": ["robot/push_x"]}]},
            "actions.0.max_effort",
            "no limit is known of robot/push_x",
        ),
        ({"success": "tip is near"}, "success", "is not a condition"),
        ({"observation": []}, "observation", "did you mean 'observations'"),
        ({"bounds": {"q_robot_x_m": [1, 0]}}, "bounds", "must be less than"),
        ({"reward": "most"}, "reward", "sparse"),
        ({"design": "nowhere"}, "design", "unknown shipped campaign 'nowhere'"),
    ],
)
def test_wrong_keys(tmp_path, env, key, said):
    path = pushed_ball(tmp_path, env=env)
    with pytest.raises(InputError) as caught:
        ScenarioEnv(path)
    assert f"env.{key}" in caught.value.lines[0]
    assert any(said in line for line in caught.value.lines), caught.value.lines


def test_a_scenario_without_the_section(tmp_path):
    path = pushed_ball(tmp_path)
    path.write_text(path.read_text().replace('"env"', '"log": {}, "env"').split(', "env"')[0] + "}")
    with pytest.raises(InputError, match="env: is missing"):
        ScenarioEnv(path)
    env = ScenarioEnv(path, PUSH)
    assert env.reset()[0].shape == (5,)
    with pytest.raises(InputError, match="render_mode"):
        ScenarioEnv(path, PUSH, render_mode="human")


def test_options_override_and_information_is_picklable(tmp_path):
    env = ScenarioEnv(pushed_ball(tmp_path))
    with pytest.raises(InputError, match="unknown key"):
        env.reset(options={"overrides": {"wind": 1.0}})
    assert env.reset()[1]["seed"] == 0  # a reset that fails is not counted
    observation, _ = env.reset(options={"overrides": {"initial.joints.target/x": 0.5}})
    assert observation[2] == 0.5
    info = env.step(ONE)[-1]
    assert pickle.loads(pickle.dumps(info)).keys() == info.keys()


def test_registered_names():
    ids = [name for name in gymnasium.registry if name.startswith("ffsm_mj/")]
    assert ids == ["ffsm_mj/Scenario-v0", "ffsm_mj/Touch-v0", "ffsm_mj/CapturePlanar-v0", "ffsm_mj/Capture-v0"]


def test_reward_functions_of_packages(tmp_path, monkeypatch):
    """By entry point; one that cannot be loaded says why."""
    points = [
        EntryPoint("steps", "tests.gym.scenes:steps_reward", rewards.GROUP),
        EntryPoint("lost", "tests.gym.nowhere:reward", rewards.GROUP),
    ]
    monkeypatch.setattr(rewards, "entry_points", lambda group: [point for point in points if point.group == group])
    rewards.reward_named.cache_clear()
    scenario = pushed_ball(tmp_path)
    env = ScenarioEnv(scenario, {"reward": {"function": "steps", "arguments": {"factor": 2.0}}})
    env.reset()
    assert env.step(ONE)[1] == 2.0
    with pytest.raises(InputError, match=r"env\.reward: reward function 'lost' .* cannot be loaded \(ModuleNotFoundError"):
        ScenarioEnv(scenario, {"reward": "lost"})


def test_a_contact_model_that_raises_is_an_error_not_an_end(tmp_path, monkeypatch):
    """Its exception is the cause; the episode is over."""
    env = ScenarioEnv(pushed_ball(tmp_path), overrides=FAST)
    env.reset()

    def fail(*_):
        raise ZeroDivisionError("no impulse")

    monkeypatch.setattr(ImpactModel, "act", fail)
    with pytest.raises(EnvError, match=r"the episode has ended \(internal_error\): .*no impulse") as caught:
        episode(env)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    with pytest.raises(EnvError, match=r"no step can be taken \(internal_error\)"):
        env.step(ONE)


def test_without_gymnasium(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(MissingPackageError, match="needs the package gymnasium"):
        importlib.reload(ffsm_mj.gym)
