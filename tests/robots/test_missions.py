"""Missions around public arms: what ``ffsm new`` writes for each of them ends in a capture at rest, with all checks passing.

Five arms of MuJoCo Menagerie on a bus of 500 kg with four wheels and twelve thrusters, as their makers wrote them, meshes
aside (:mod:`tests.robots.menagerie`).
"""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from tests.robots.menagerie import FILES, FOLDER, write_robot

ARMS = ("kinova_gen3", "kuka_iiwa_14", "universal_robots_ur5e", "ufactory_xarm7", "franka_emika_panda")

pytestmark = [
    pytest.mark.robots,
    pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no robots in {FOLDER}; FFSM_MENAGERIE names their folder"),
]


@pytest.mark.parametrize("robot", ARMS)
def test_the_mission_around_a_public_arm_ends_in_a_capture_at_rest(robot, tmp_path):
    """At the first attempt, with the defaults: nothing collides, the grasp lasts, and no check fails."""
    write_robot(robot, tmp_path)
    file = tmp_path / robot / f"{FILES[robot]}.xml"
    out = tmp_path / "out"
    assert main(["new", "lab", "--robot", str(file), "--wheels", "4", "--thrusters", "12", "--out", str(out)]) == 0
    run = ffsm_mj.run(out / "lab.yaml", rerun=False)
    assert [check.name for check in all_checks(run) if not check.passes] == []
    assert run.outcome == "completed"
    assert not run.unhandled_contacts
    assert not any("target" in name for impact in run.impacts for name in impact.geoms)
    (grasp,) = run.grasps
    assert grasp.release_s is None
    assert run.phases[-1].name == "rest"
