"""Uniform gravity in the balance: an outside force on each subsystem, with every check on."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.external import Gravity
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.balance.test_balance import BASES, LINK, fly, residuals
from tests.contact_models.grasp.scenes import ARM, TARGET
from tests.model.test_own_robot import FILES
from tests.scenes import HEAD, compile_paths, scene, two_balls

G = (1.0, -2.0, -9.0)
FALLS = f'<option gravity="{G[0]:g} {G[1]:g} {G[2]:g}"/>'


def fallen(folder, base, step):
    """Residuals of a base of some kind with a link that is partly held up, falling for 0.2 s."""
    link = LINK.replace('<body name="link"', '<body name="link" gravcomp="0.4"')
    (folder / "robot.xml").write_text(f"""<mujoco>{FALLS}<worldbody><body name="bus">
      <inertial pos="0.05 -0.02 0.01" mass="3" diaginertia="0.2 0.3 0.35"/>{BASES[base]}<geom size="0.1" mass="0"/>
      {link}</body></worldbody></mujoco>""")
    system = compile_paths(folder / "robot.xml", time_step_s=step, conservative=False)
    data = mujoco.MjData(system.mj)
    data.qvel[:] = np.array((0.2, -0.1, 0.3, 1.5, -3.0, 2.0, 1.0))[-system.mj.nv :]
    mujoco.mj_forward(system.mj, data)
    balance = Balance(system, data, np.empty(system.mj.nv))
    fly(system, data, balance, step, seconds=0.2)
    assert not system.faults
    return np.concatenate([np.ravel(each) for each in residuals(balance, system, data)])


@pytest.mark.parametrize("base", BASES)
def test_gravity_enters_the_balance_to_fourth_order(tmp_path, base):
    """Whatever the base leaves free: 16 times less per halving, or rounding."""
    coarse, fine = (np.abs(fallen(tmp_path, base, step)).max() for step in (0.02, 0.01))
    assert coarse / fine > 2**3.5 or coarse < 1e-12
    assert fine < 1e-5


def falling(folder, **changes):
    """All falls askew: an arm under efforts catches a tumbling body, and both hit a fixed slab."""
    slab = f'<mujoco>{FALLS}<worldbody><geom name="slab" type="box" size="9 9 0.1"/></worldbody></mujoco>'
    touch = {"robot_site": "grip", "object_site": "handle", "when": {"touch": ["hand-target/target"]}}
    pd = {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}
    return scene(
        folder,
        ARM.replace(HEAD, FALLS).replace('<body name="upper"', '<body name="upper" gravcomp="0.3"'),
        {"target": TARGET.replace(HEAD, FALLS), "slab": slab},
        fixed={"slab": {"position_m": [0.0, 0.0, -3.0]}},
        conservative=False,
        duration_s=0.85,
        initial={
            "joints": {"target/free": [1.1, 0.03, 0.02, 1, 0, 0, 0]},
            "rates": {"robot/free": [0, 0, 0, 0.02, -0.03, 0.05], "target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3]},
        },
        contacts={
            "rules": [
                {"between": ["hand", "target/target"], "restitution": 0.5},
                {"between": ["target/target", "slab/slab"], "restitution": 0.3},
                {"between": ["hull", "slab/slab"], "restitution": 0.3},
            ]
        },
        grasps={"grasp": touch},
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": {"kind": "off"}},
            {"name": "hold", "until": "end", "controller": pd},
        ],
        **changes,
    )


def violated(laws):
    """Names of checks that fail, by subsystem."""
    return {(law.name, law.subsystem) for law in laws if not law.passes}


@pytest.mark.long
def test_a_capture_and_blows_of_a_fixed_body_under_gravity_pass_every_check(tmp_path):
    run = ffsm_mj.run(falling(tmp_path))
    assert run.records["grasp_impulses"]
    assert any("slab/slab" in impact.geoms for impact in run.impacts)
    assert {check.name for check in all_checks(run)} >= {
        "energy",
        "linear momentum",
        "angular momentum",
        "momentum two ways",
    }
    assert not violated(all_checks(run))
    again = replay_log(run.log)
    assert again.agrees
    assert not violated(again.checks())
    # All of it, from outside: weights less what holds up a part of the arm.
    weight = np.array(G) * (8.0 + 0.7 * 1.0 + 0.7)
    told = [run[f"balance.gravity_on_robot_P_{axis}_N_s"][-1] for axis in "xyz"]
    np.testing.assert_allclose(told, weight * 0.85, rtol=1e-12)
    # A log that says another work of gravity does not agree with its states.
    column = run.log.header.layout.index["balance.objects_gravity_work_J"]
    run.log.rows[300, column] += 1e-6
    assert not replay_log(run.log).agrees


MISTAKES = {
    "moment": (slice(4, 7), {("angular momentum", "robot"), ("angular momentum", "objects"), ("angular momentum", "total")}),
    "work": (slice(0, 1), {("energy", "robot"), ("energy", "objects"), ("energy", "total")}),
    "impulse": (slice(1, 4), {("linear momentum", "robot"), ("linear momentum", "objects"), ("linear momentum", "total")}),
}


@pytest.mark.long
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_share_of_1e_6_too_much_is_noticed(tmp_path, monkeypatch, mistake):
    part, noticed = MISTAKES[mistake]
    close = Gravity.close

    def wrong(self, duration_s):
        before = self._accounts.copy()
        close(self, duration_s)
        self._accounts[:, part] += 1e-6 * (self._accounts - before)[:, part]

    monkeypatch.setattr(Gravity, "close", wrong)
    assert violated(all_checks(ffsm_mj.run(falling(tmp_path)))) == noticed


def test_what_else_is_not_conservative_is_named_and_gravity_is_not(tmp_path):
    path = two_balls(tmp_path, conservative=False, duration_s=0.01)
    robot = tmp_path / "robot.xml"
    plain = robot.read_text().replace(HEAD, FALLS)
    robot.write_text(plain)
    run = ffsm_mj.run(path)
    assert run.conservative
    assert not violated(all_checks(run))
    robot.write_text(plain.replace('axis="1 0 0"', 'axis="1 0 0" damping="0.3"'))
    run = ffsm_mj.run(path)
    assert "damping 0.3" in run.why_not_conservative
    assert "gravity" not in run.why_not_conservative


def test_one_gravity_acts_on_a_scene(tmp_path):
    """Two that differ are refused with both files; a model without any, and a URDF that says nothing, go with the others."""
    path = two_balls(tmp_path, conservative=False, duration_s=0.01)
    robot, target = tmp_path / "robot.xml", tmp_path / "target.xml"
    robot.write_text(robot.read_text().replace(HEAD, FALLS))
    target.write_text(target.read_text().replace(HEAD, '<option gravity="0 0 -1.62"/>'))
    with pytest.raises(InputError) as refused:
        prepare(path)
    (line,) = refused.value.lines
    assert line == f"{target}: gravity is 0 0 -1.62, and 1 -2 -9 in {robot}; all models of a scene have one gravity"
    silent = FILES["otto.urdf"]
    (tmp_path / "otto.urdf").write_text(silent)
    assert not compile_paths(tmp_path / "otto.urdf", conservative=False).mj.opt.gravity.any()
    assert compile_paths(tmp_path / "otto.urdf", {"ball": robot}, conservative=False).mj.opt.gravity.tolist() == list(G)
