"""Elements removed from a vendor's model: listed, the same in run, log and rerun, with the file unchanged."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from tests.scenes import ARM, ball, scene

ALL = ["damping", "frictionloss", "stiffness", "limits", "equalities", "tendons", "servos"]
JOINT = 'damping="2" frictionloss="0.1" stiffness="3" range="-1 1" limited="true"'
TENDON = """<tendon><fixed name="strap" damping="3" stiffness="1" frictionloss="0.2" range="-1 1" limited="true">
  <joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed></tendon>
  <equality><joint name="tied" joint1="shoulder" joint2="elbow"/><tendon name="taut" tendon1="strap"/></equality>
  <sensor><tendonpos tendon="strap"/><actuatorfrc actuator="aim"/><jointpos joint="elbow"/></sensor>
  <keyframe><key name="home" ctrl="1 2 3 4 5" act="6"/></keyframe></mujoco>"""
SERVOS = '<position name="aim" joint="elbow" kp="9"/><general name="lag" joint="shoulder" dyntype="filter" dynprm="1"/>'


def vendor():
    """The arm with all non-conservative elements, a motor on a tendon, servos and a keyframe."""
    text = ARM.replace('name="shoulder" axis', f'name="shoulder" {JOINT} axis').replace(
        'name="elbow" axis', 'name="elbow" springdamper="0.1 0.5" axis'
    )
    return text.replace("</actuator></mujoco>", f'<motor name="pull" tendon="strap"/>{SERVOS}</actuator>{TENDON}')


def moving(folder, strip, **changes):
    path = scene(folder, vendor(), {"target": ball("target")}, **changes)
    return path, {
        "robot.strip": strip,
        "initial.joints": {"target/free": [9.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]},
        "initial.rates": {"elbow": 0.5, "shoulder": -0.3},
        "duration_s": 0.2,
    }


def test_a_completely_stripped_arm_moves_as_the_bare_arm(tmp_path):
    """Bit by bit: the removed elements have no effect."""
    path, changes = moving(tmp_path, ALL)
    run = ffsm_mj.run(path, changes)
    (tmp_path / "robot.xml").write_text(ARM)
    bare = ffsm_mj.run(path, changes | {"robot.strip": []})
    np.testing.assert_array_equal(run.qpos, bare.qpos)
    assert all(check.passes for check in all_checks(run))
    assert prepare(path, changes).system.mj.nsensor == 0


def test_check_lists_the_removed_elements(tmp_path, capfd):
    path, changes = moving(tmp_path, ALL)
    notes = prepare(path, changes).system.notes
    assert notes == (
        "removed from robot: damping of 2 joints (shoulder, elbow)",
        "removed from robot: damping of 1 tendon (strap)",
        "removed from robot: frictionloss of 1 joint (shoulder)",
        "removed from robot: frictionloss of 1 tendon (strap)",
        "removed from robot: stiffness of 1 joint (shoulder)",
        "removed from robot: stiffness of 1 tendon (strap)",
        "removed from robot: limits of 1 joint (shoulder)",
        "removed from robot: limits of 1 tendon (strap)",
        "removed from robot: 2 equality constraints (tied, taut)",
        "removed from robot: 1 sensor (strap_tendonpos)",
        "removed from robot: 1 actuator (pull)",
        "removed from robot: 1 tendon (strap)",
        "removed from robot: 1 sensor (aim_actuatorfrc)",
        "removed from robot: 2 actuators (aim, lag)",
    )
    capfd.readouterr()
    assert main(["check", str(path), "-s", f"robot.strip={ALL}"]) == 0
    assert f"note: {notes[0]}\n" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("left", "attribute"),
    [("damping", "dof_damping"), ("stiffness", "jnt_stiffness"), ("frictionloss", "dof_frictionloss")],
)
def test_springs_dampers_and_friction_of_joints_are_kept(tmp_path, left, attribute):
    """Unless they are stripped: they enter the balance."""
    path, changes = moving(tmp_path, [word for word in ALL if word != left])
    assert getattr(prepare(path, changes).system.mj, attribute).any()


def test_servos_are_kept(tmp_path):
    """Unless they are stripped."""
    path, changes = moving(tmp_path, ALL[:-1])
    assert {"robot/aim", "robot/lag"} <= set(prepare(path, changes).system.names("actuator"))


def test_log_and_rerun_strip_alike(tmp_path, capfd):
    """The copied file is the original; log replay and rerun remove the same elements."""
    path, changes = moving(tmp_path, ALL)
    changes["objects.target.strip"] = ["damping"]
    (tmp_path / "target.xml").write_text(
        ball("target").replace('<freejoint name="free"/>', '<joint name="free" type="free" damping="1"/>')
    )
    out = tmp_path / "run"
    run = ffsm_mj.run(path, changes, out=out, rerun=False)
    assert (out / "mjcf" / "robot" / "robot.xml").read_text() == vendor()
    for name in ("robot.xml", "target.xml", "scene.yaml"):
        (tmp_path / name).unlink()
    assert main(["analyze", str(out)]) == 0
    assert "columns agree with states" in capfd.readouterr().out
    np.testing.assert_array_equal(ffsm_mj.run(out).log.rows, run.log.rows)


def test_unknown_entries_of_strip_are_refused_with_the_allowed_ones(tmp_path):
    path, changes = moving(tmp_path, ["damping", "gravity"])
    with pytest.raises(InputError, match=r"robot\.strip.*'damping'.*'tendons'.*gravity"):
        prepare(path, changes)


def test_gravcomp_is_removed(tmp_path):
    """It has no effect without gravity; with ``strip`` the body has no weight either."""
    path, changes = moving(tmp_path, [])
    held = ARM.replace('<body name="lower"', '<body name="lower" gravcomp="1"')
    (tmp_path / "robot.xml").write_text(held)
    (note,) = prepare(path, changes).system.notes
    assert "left out, " in note
    assert note.endswith(": gravcomp")
    system = prepare(path, changes | {"robot.strip": ["gravcomp"]}).system
    assert system.notes == ("removed from robot: gravcomp of 1 link (lower)",)
    assert not system.mj.body_gravcomp.any()
