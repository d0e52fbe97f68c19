"""A model that is compiled again in the same process, as in every run of a campaign."""

from __future__ import annotations

import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.scenes import two_balls


def test_a_model_compiled_again_has_the_same_notes_and_properties(tmp_path):
    scenario = two_balls(tmp_path, model={"robot": {"ball": {"mass_kg": 5}}})
    first, second = (prepare(scenario) for _ in range(2))
    assert first.system.notes == second.system.notes
    assert first.changes == second.changes
    assert first.system.mj.body_mass.tolist() == second.system.mj.body_mass.tolist()


def test_other_overrides_of_the_same_files_do_not_see_the_first_ones(tmp_path):
    plain = two_balls(tmp_path)
    robot = tmp_path / "robot.xml"
    robot.write_text(robot.read_text().replace('mass="0"', 'mass="1"'))  # for mass_from_geoms
    before = prepare(plain).system.mj.body_inertia.tolist()
    prepare(plain, {"model.robot.ball.mass_kg": 7.0})
    prepare(plain, {"model.robot.ball.geoms.ball.size_m": [0.3], "model.robot.ball.mass_from_geoms": True})
    assert prepare(plain).system.mj.body_inertia.tolist() == before


def test_it_is_refused_each_time(tmp_path):
    scenario = two_balls(tmp_path)
    robot = tmp_path / "robot.xml"
    robot.write_text(robot.read_text().replace("</mujoco>", '<actuator><motor joint="none"/></actuator></mujoco>'))
    for _ in range(2):
        with pytest.raises(InputError, match="none"):
            prepare(scenario)
