"""``controller_model``: control laws that take the models for other ones than they are, at the true state."""

from __future__ import annotations

import json
import pickle

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.model.properties import property_value
from ffsm_mj.pytest_plugin import assert_conserved
from tests.laws import Law
from tests.scenes import ARM, ball, scene, self_hit

REACH = {"kind": "osdre", "Q": [5.0, 5.0, 8.0, 8.0], "R": [1.0, 1.0], "null_space_damping": 0.1}
HEAVY = {"robot": {"lower": {"mass_kg": 1.3, "centre_of_mass_m": [0.3, 0.0, 0.0]}}}


def reaching(folder, controller=REACH, **more):
    """The arm brings its finger, 1.25 m away, to a point, and hits a ball on the way."""
    return scene(
        folder,
        ARM.replace('<body name="finger" pos="0.5 0 0">', '<body name="finger" pos="0.5 0 0"><site name="tip"/>'),
        {"rock": ball("rock", mass=0.5)},
        **{
            "duration_s": 0.6,
            "control_period_s": 0.002,
            "initial": {
                "joints": {"shoulder": 0.4, "elbow": 0.7, "rock/free": [0.816, 0.773, 0.0, 1, 0, 0, 0]},
                "rates": {"robot/free": [0.02, -0.01, 0.03, 0.05, 0.02, -0.1], "rock/free": [0.135, -0.148, 0, 0, 0, 0]},
            },
            "task": {"tip": "tip", "axes": ["x", "y"], "target_m": [0.7, 0.9]},
            "contacts": {"rules": [{"between": ["tip", "rock/rock"], "restitution": 0.6}]},
            "phases": [{"name": "reach", "until": "end", "controller": controller}],
            **more,
        },
    )


def assert_same_rows(run, other):
    np.testing.assert_array_equal(run.log.rows, other.log.rows)


def test_a_belief_that_is_true_changes_no_bit(tmp_path):
    """Of an arm in free flight that is steered and hits something: asked at ticks and at the impact."""
    path = reaching(tmp_path)
    true = ffsm_mj.run(path)
    assert len(true.impacts) > 0
    model = {"robot": {"lower": {"mass_kg": 0.8}, "upper": {}}, "rock": {"rock": {"geoms": {"rock": {"size_m": [0.1]}}}}}
    assert_same_rows(ffsm_mj.run(path, {"controller_model": model}), true)


@pytest.mark.parametrize(
    ("scenario", "base", "duration"), [("push", "base", 3.0), ("free-flying-hardware", "base", 0.5), ("spatial", "bus", 0.5)]
)
def test_nor_in_shipped_scenarios(scenario, base, duration):
    """Contact that lasts, thrusters and wheels, eight joints."""
    short = {"duration_s": duration}
    true = ffsm_mj.run(scenario, short)
    mass = property_value(prepare(scenario).system.mj, key := f"controller_model.robot.{base}.mass_kg")
    assert_same_rows(true, ffsm_mj.run(scenario, short | {key: mass}))


def test_a_law_that_knows_no_masses_does_the_same_whatever_it_believes(tmp_path):
    path = reaching(tmp_path, {"kind": "pd", "kp": 5.0, "kd": 0.05})
    assert_same_rows(ffsm_mj.run(path), ffsm_mj.run(path, {"controller_model": HEAVY}))


def test_a_law_decides_by_what_it_believes_and_only_that_differs(tmp_path):
    """At the same state it asks for what it would ask for if that were so; what follows obeys the true model."""
    path = reaching(tmp_path)
    true, wrong, so = ffsm_mj.run(path), ffsm_mj.run(path, {"controller_model": HEAVY}), ffsm_mj.run(path, {"model": HEAVY})
    efforts = [key for key in true.keys if key.endswith("_applied_N_m")]
    states = [key for key in true.keys if key.startswith("state.")]
    assert len(efforts) == 2
    for key in efforts:
        assert wrong[key][0] == so[key][0] != true[key][0]
    for key in (*states, "energy.total_J"):
        assert wrong[key][0] == true[key][0]
    assert not np.array_equal(wrong.qpos[50], true.qpos[50])
    assert_conserved(wrong)


def test_a_law_sees_the_true_state_and_the_model_it_believes_in(tmp_path):
    seen = []

    class Look(Law):
        def __init__(self, config, context):
            self.model = context.system.mj

        def start(self, observation):
            self.data = observation.data

        def control(self, observation, command):
            assert observation.data is self.data
            M = mass_matrix(self.model, observation.data)
            seen.append(
                (observation.time_s, observation.data.time, observation.data.qpos.copy(), observation.data.qvel.copy(), M)
            )
            command.drive(np.array([0, 1]), np.array([0.3, -0.2]))

    path = reaching(tmp_path, {"kind": "look"}, duration_s=0.1)
    run = ffsm_mj.run(path, {"controller_model": HEAVY}, controllers={"look": Look})
    heavy = prepare(path, {"model": HEAVY}, controllers={"look": Look}).system.mj
    data = mujoco.MjData(heavy)
    assert len(seen) == 50
    for i, (time_s, clock_s, qpos, qvel, M) in enumerate(seen):
        np.testing.assert_array_equal(qpos, run.qpos[i])
        np.testing.assert_array_equal(qvel, run.qvel[i])
        assert time_s == clock_s == run.time[i]
        data.qpos, data.qvel = qpos, qvel
        mujoco.mj_forward(heavy, data)
        np.testing.assert_array_equal(M, mass_matrix(heavy, data))


def test_a_belief_starts_from_the_true_model(tmp_path):
    """A mass of the controller model scales the inertia that the scenario gives."""
    path = self_hit(tmp_path)
    given = {"model.robot.base.inertia_kg_m2": [0.4, 0.5, 0.6], "controller_model.robot.base.mass_kg": 10.0}
    prepared = prepare(path, given)
    base = prepared.system.mj.body("robot/base").id
    assert prepared.system.mj.body_mass[base] == 5.0
    assert prepared.controller_system.mj.body_mass[base] == 10.0
    assert prepared.controller_system.mj.body_inertia[base].tolist() == [0.8, 1.0, 1.2]
    assert [change.path[0] for change in prepared.changes] == ["model", "controller_model"]


def test_log_analysis_and_rerun_have_it_too(tmp_path, capfd):
    out = tmp_path / "run"
    run = ffsm_mj.run(reaching(tmp_path), {"controller_model": HEAVY}, out=out, rerun=False)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["controller_model"] == HEAVY
    assert "model" not in summary
    assert main(["analyze", str(out)]) == 0
    assert "columns agree with states" in capfd.readouterr().out
    assert_same_rows(ffsm_mj.run(out), run)


def test_a_recipe_with_a_belief_runs_again_and_elsewhere_the_same(tmp_path):
    recipe = prepare(reaching(tmp_path, duration_s=0.2), {"controller_model": HEAVY})
    first = recipe.run()
    assert_same_rows(recipe.run(), first)
    assert_same_rows(pickle.loads(pickle.dumps(recipe)).run(), first)


def test_check_judges_the_damping_that_the_law_believes_in(tmp_path, capfd):
    """Where ``check`` asks the law at a state, it is that of the model that the law was made for."""
    assert main(["check", str(reaching(tmp_path)), "-s", "controller_model.robot.lower.mass_kg=1.3"]) == 0
    assert "    controller_model.robot.lower.mass_kg is 1.3; without it 0.8" in capfd.readouterr().out
