"""Painleve's rod: a run ends by name where Coulomb's law has no solution, and its log stands until there."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from tests.contact_models.impact.test_fixed import slab
from tests.contact_models.persistent.friction.scenes import steps
from tests.replays import assert_replayed, proved
from tests.scenes import HEAD, scene

ACROSS, DOWN = 1.0 / math.sqrt(5.0), 2.0 / math.sqrt(5.0)
TIP_M = 1e-3
"""Radius of the sphere at the tip of the rod."""
FAR_M = 1e9
"""A spring towards a target so far away is a constant force."""


def rod(folder, *, mu, slip, free_s=0.0, duration=0.03, gravity=0.0):
    """A rod of 1 kg with l^2 / I = 3, inclined at arctan 2, whose tip slides along x, pressed by 1 N at its centre.

    Its tip has G_nn = 1.6 and G_nt = 1.2 (1/kg), so that D = 1.6 - 1.2 mu if it slides to the right, 1.6 + 1.2 mu if to the
    left. The force begins after ``free_s``; ``gravity`` presses from the start.
    """
    head = f'<option gravity="0 0 {-gravity}"/>'
    robot = f"""<mujoco>{head}<worldbody><body name="rod"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/><joint name="turn" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{1 / 3} {1 / 3} {1 / 3}"/>
      <geom name="tip" type="sphere" size="{TIP_M}" pos="{ACROSS} 0 {TIP_M - DOWN}" mass="0"/></body></worldbody>
      <actuator><motor name="press" joint="z"/></actuator></mujoco>"""
    press = {"kind": "pd", "joints": ["z"], "kp": 1.0 / FAR_M, "kd": 0.0, "target": [-FAR_M]}
    wait = [{"name": "wait", "for_s": free_s, "controller": {"kind": "off"}}] if free_s else []
    return scene(
        folder,
        robot,
        {"slab": slab("slab", "20 20 0.5").replace(HEAD, head)},
        fixed={"slab": {"position_m": [0, 0, -0.5]}},
        contacts={"rules": [{"name": "foot", "between": ["tip", "slab/slab"], "restitution": 0.0, "mu": mu}]},
        initial={"joints": {"robot/z": DOWN}, "rates": {"robot/x": slip}},
        conservative=gravity == 0.0,
        phases=[*wait, {"name": "press", "until": "end", "controller": press}],
        **steps(1e-3, duration),
    )


@pytest.mark.parametrize(("mu", "slip"), [(1.2, 0.5), (1.2, -0.5), (1.5, -0.5)])
def test_a_rod_slides_where_it_can(tmp_path, mu, slip):
    """The force at the start is 1 / D; D = 0.16 presses hard enough to rotate the rod and to stop it."""
    run = proved(ffsm_mj.run(rod(tmp_path, mu=mu, slip=slip)))
    assert run["contact.foot_force_z_N"][0] == pytest.approx(-1.0 / (1.6 - math.copysign(1.2, slip) * mu), rel=1e-6)


def test_without_a_solution_the_run_ends_by_name(tmp_path, capsys):
    """D = 1.6 - 1.8 from the start."""
    path, out = rod(tmp_path, mu=1.5, slip=0.5), tmp_path / "run"
    assert main(["run", str(path), "--out", str(out), "--no-rerun"]) == 3
    assert "painleve" in capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["outcome"] == "unsupported_contact"
    assert summary["message"].startswith("painleve: ")
    assert "robot/tip - slab/slab" in summary["message"]
    assert "G_nn - mu G_nt = -0.2 1/kg" in summary["message"]
    assert "-1 m/s^2" in summary["message"]


def test_a_start_without_a_solution_is_refused(tmp_path, capsys):
    """Gravity presses before any effort: no force of the contact holds the tip, at t = 0 already."""
    path = rod(tmp_path, mu=1.5, slip=0.5, gravity=1.0)
    for command in ("run", "check"):
        assert main([command, str(path)]) == 2
        said = capsys.readouterr().err
        assert "initial: no run begins in this state: painleve: " in said
        assert "robot/tip - slab/slab" in said


def test_the_log_stands_until_there(tmp_path, capsys):
    """The tip slides without force, until the rod is pressed after 20 ms."""
    path, out = rod(tmp_path, mu=1.5, slip=0.5, free_s=0.02), tmp_path / "run"
    assert main(["run", str(path), "--out", str(out), "--no-rerun"]) == 3
    run = ffsm_mj.load_run(out)
    assert run.message.startswith("painleve: ")
    assert run.time[-1] >= 0.019
    np.testing.assert_allclose(run["state.q_robot_x_m"], 0.5 * run.time, atol=1e-15)
    assert all(check.passes for check in all_checks(run))
    assert_replayed(run)
    capsys.readouterr()
    assert main(["analyze", str(out)]) == 0
    assert "painleve" in capsys.readouterr().out


def test_a_ball_that_a_hinge_rolls_in_place_is_no_paradox(tmp_path):
    """The axis (1, 1, 0) passes through the contact point, so no force along the normal y moves the ball and the box.

    Turned at w, the normal tilts at w / sqrt(2), and the face falls towards the centre of the ball: gap'' = -R w^2 / 2.
    It turns about the axis before already, so the latch takes no impulse.
    """
    inertial = '<inertial pos="0 0 0" mass="2" diaginertia="0.01 0.011 0.012"/>'
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="base"/>{inertial}
      <geom name="pad" type="sphere" size="0.02" mass="0"/><site name="tip" pos="0 0.02 0"/></body></worldbody></mujoco>"""
    box = f"""<mujoco>{HEAD}<worldbody><body name="box"><freejoint name="free"/>{inertial}
      <geom name="box" type="box" size="0.1 0.05 0.1" mass="0"/>
      <site name="handle" pos="0 -0.05 0"/></body></worldbody></mujoco>"""
    hinge = {"robot_site": "tip", "object_site": "box/handle", "joint": "hinge", "axis": [1, 1, 0]}
    path = scene(
        tmp_path,
        robot,
        {"box": box},
        initial={"joints": {"box/free": [0, 0.07, 0, 1, 0, 0, 0]}, "rates": {"box/free": [0, 0, 0.005, 0.1, 0.1, 0]}},
        contacts={"rules": [{"between": ["pad", "box/box"], "restitution": 0, "mu": 0.3}]},
        grasps={"c": hinge | {"when": {"within": {"position_m": 0.01}}}},
        phases=[{"name": "hold", "until": "end", "arm": ["c"], "controller": {"kind": "off"}}],
    )
    run = ffsm_mj.run(path)
    assert run.outcome == "unsupported_contact"
    assert run.message.startswith("locked: robot/pad - box/box closes, gap'' = -0.0002 m/s^2")
