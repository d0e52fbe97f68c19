"""Series of cases: no traceback, no hang, no stray write, a documented exit code, every fault with its place.

``uv run --group dev python -m tests.hostile --cases 20000`` runs a long one by hand, ``--seed 27`` that of strangers' files;
``--only N --keep DIR`` one case, its files kept.
"""

from __future__ import annotations

import pytest

import ffsm_mj
from tests.hostile.friction import FRICTION
from tests.hostile.grasps import GRASPS
from tests.hostile.mjcf_mutations import model, xml
from tests.hostile.series import complaints, parts, run_series, takes_some
from tests.hostile.strangers import STRANGERS


def answered(seed, part, folder, *kinds):
    """Exit codes of the last commands of cases that are all answered as they should be; of some kinds some are taken."""
    results = run_series(seed, part.start, len(part), folder, workers=1)
    assert complaints(results) == []
    assert all(takes_some(results, kind) for kind in kinds)
    return [result.codes[-1] for result in results]


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(40, 2500), ids=str)
def test_own_files_with_mistakes(part, tmp_path):
    """The cases must reach every end, or they would show nothing: most are refused, many run."""
    codes = answered(1, part, tmp_path)
    assert codes.count(0) > len(part) // 20
    assert codes.count(2) > len(part) // 2


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(12, 250), ids=str)
def test_possibly_hostile_files_for_every_command(part, tmp_path):
    codes = answered(STRANGERS, part, tmp_path)
    assert codes.count(0) > len(part) // 20
    assert codes.count(2) > len(part) // 4


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(16, 300), ids=str)
def test_scenarios_and_logs_of_friction(part, tmp_path):
    answered(FRICTION, part, tmp_path, "friction", "log")


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(24, 600), ids=str)
def test_scenarios_and_logs_of_grasps(part, tmp_path):
    answered(GRASPS, part, tmp_path, "grasp", "log")


@pytest.mark.long
def test_an_arm_that_spins_too_fast_to_follow(tmp_path):
    """21 000 rad/s turn a link three times within a step: halving the step looked for a touch in noise without end."""
    robot = model("ffsm_3dof.xml")
    inertial = robot.find(".//body[@name='link_1']/inertial")
    assert inertial is not None
    inertial.set("pos", "0.01 0 0")
    (tmp_path / "robot.xml").write_bytes(xml(robot))
    fast = {"initial.rates.joint_2": -21139.442972200002, "initial.rates.base_yaw": 4.540521756}
    short = {"duration_s": 0.06, "control_period_s": 0.02, "conservative": False}
    run = ffsm_mj.run("coasting", {**short, **fast, "robot.mjcf": str(tmp_path / "robot.xml")})
    assert run.outcome == "diverged"
    assert "robot/gripper - object/box changes too often within a step to be followed" in run.message
