"""Springs, dampers and drives of tendons: closed forms, order, dead bands, heat, wraps, and what is refused."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.balance.springs import SpringBalance
from ffsm_mj.dynamics.springs import JointSprings, TendonSprings
from ffsm_mj.errors import InputError
from tests.balance.test_springs import violated
from tests.replays import proved
from tests.scenes import HEAD, scene

K, MASSES = 200.0, (1.0, 0.6)
REDUCED = MASSES[0] * MASSES[1] / sum(MASSES)
W = math.sqrt(K / REDUCED)


def masses(tendon, actuator=""):
    """A free body of 3 kg with masses of 1 and 0.6 kg on slides along x, and a tendon of their difference."""
    slides = "".join(
        f"""<body name="mass_{i}" pos="{i} 0.1 0"><joint name="s_{i}" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="{mass}" diaginertia="0.01 0.01 0.01"/></body>"""
        for i, mass in enumerate(MASSES, start=1)
    )
    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="3" diaginertia="0.2 0.3 0.35"/><geom size="0.1" mass="0"/>{slides}</body></worldbody>
      <tendon><fixed name="cord" {tendon}><joint joint="s_1" coef="1"/><joint joint="s_2" coef="-1"/></fixed></tendon>
      <actuator>{actuator}</actuator></mujoco>"""


REACH = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0.02 -0.03 0.01" mass="6" diaginertia="0.5 0.6 0.7"/><geom name="base" size="0.1" mass="0"/>
  <site name="anchor" pos="0.1 0.3 0.2"/><geom name="drum" pos="0.35 0.2 0.12" size="0.15" mass="0"/>
  <body name="upper" pos="0.3 0.05 0"><inertial pos="0.25 0 0" mass="1" diaginertia="0.01 0.05 0.05"/>
    <joint name="a" axis="0 0.8 0.6"/>
    <body name="lower" pos="0.5 0 0"><inertial pos="0.2 0 0" mass="0.7" diaginertia="0.01 0.03 0.03"/>
      <joint name="b" axis="0 1 0"/><site name="tip" pos="0.3 0.1 0"/>
    </body></body></body></worldbody>
  <tendon>{{}}</tendon><actuator>{{}}</actuator></mujoco>"""
"""A base with an arm of two links; a cord may run from its tip to the base, around a drum or not."""


def cord(attributes):
    return f'<spatial name="cord" {attributes}><site site="anchor"/><site site="tip"/></spatial>'


def reaching(folder, tendon, actuator="", step=1e-3, **scenario):
    """The arm swings as the base turns."""
    folder.mkdir(exist_ok=True)
    return ffsm_mj.run(
        scene(
            folder,
            REACH.format(tendon, actuator),
            {},
            **{
                "duration_s": 0.96,
                "time_step_s": step,
                "control_period_s": 0.008,
                "initial": {
                    "joints": {"a": 0.3, "b": -0.4},
                    "rates": {"robot/free": [0.1, -0.2, 0.05, 0.2, -0.1, 0.3], "a": 0.8, "b": -1.2},
                },
            }
            | scenario,
        )
    )


def last(run):
    """Coordinates and rates of the arm at the end."""
    return np.array([run[f"state.{c}_robot_{j}_{u}"][-1] for c, u in (("q", "rad"), ("v", "rad_s")) for j in "ab"])


def test_two_masses_ring_at_their_frequency(tmp_path):
    """q_1 - q_2 = x_0 cos(w t) with the reduced mass of the two: the cord is internal. Order 4; nothing drifts."""
    errors = []
    for step in (0.008, 0.004):
        run = proved(
            ffsm_mj.run(
                scene(
                    tmp_path,
                    masses(f'stiffness="{K}"'),
                    {},
                    time_step_s=step,
                    control_period_s=0.008,
                    initial={"joints": {"s_1": 0.05}},
                    duration_s=0.8,
                )
            )
        )
        x = run["state.q_robot_s_1_m"] - run["state.q_robot_s_2_m"]
        errors.append(np.abs(x - 0.05 * np.cos(W * run.time)).max())
        assert run["energy.total_elastic_J"][0] == pytest.approx(0.5 * K * 0.05**2, rel=1e-12)
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.06)


def test_a_damper_turns_all_into_heat(tmp_path):
    """The masses of a damped cord come to rest against each other: heat = mu v^2 / 2, by e^(-d t / mu)."""
    path = scene(tmp_path, masses('damping="4"'), {}, initial={"rates": {"s_1": 1.0}}, duration_s=1.0)
    run = proved(ffsm_mj.run(path))
    left = math.exp(-2.0 * 4.0 * 1.0 / REDUCED)
    assert run["balance.total_damper_heat_J"][-1] == pytest.approx(0.5 * REDUCED * (1.0 - left), rel=1e-9)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("law", ['stiffness="40 15 200"', 'stiffness="40" damping="0.5 0.2 0.3"'])
@pytest.mark.parametrize("drum", ["", '<geom geom="drum"/>'])
def test_a_cord_of_an_arm_is_entered_to_fourth_order(tmp_path, law, drum):
    """Polynomials along a spatial tendon of a floating arm: all balances hold, the end converges with order 4."""
    tendon = cord(law).replace('<site site="tip"/>', f'{drum}<site site="tip"/>')
    runs = [reaching(tmp_path / str(k), tendon, step=4e-3 / 2**k) for k in range(3)]
    proved(runs[-1])
    coarse, fine = (np.abs(last(run) - last(runs[-1])).max() for run in runs[:2])
    assert coarse / fine > 2**3.5  # (1 - 1/256) / (1/16 - 1/256) = 17
    assert np.ptp(runs[-1]["energy.total_elastic_J"]) > 1e-3


def test_values_are_those_of_mujoco():
    """Energy, forces and heat of polynomials with a dead band on both sides, at random states."""
    band = 'name="band" stiffness="3 2 1" damping=".3 .2 .1" springlength="-.1 .2"'
    bands = f'<fixed {band}><joint joint="a" coef="2"/><joint joint="b" coef="-1"/></fixed>'
    text = REACH.format(bands + cord('stiffness="30 5 2" damping="1"'), "").replace(
        "<option", '<option><flag energy="enable"/></option><option'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data, springs, random = mujoco.MjData(model), TendonSprings(model), np.random.default_rng(52)
    for _ in range(20):
        data.qpos[7:], data.qvel[:] = random.normal(size=2), random.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        assert springs.energy(data).sum() == pytest.approx(data.energy[0], rel=1e-12)
        np.testing.assert_allclose(springs.rows(data) @ data.qvel, springs.rates(data), atol=1e-14)
        assert springs.dissipation(springs.rates(data)).sum() == pytest.approx(-data.qfrc_damper @ data.qvel, rel=1e-12)


def test_the_fastest_mode_is_that_of_the_cord(tmp_path):
    """sqrt(k / mu) of the two masses; a step that does not resolve it is refused."""
    (tmp_path / "robot.xml").write_text(masses(f'stiffness="{K}" damping="3"'))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mode, decay = JointSprings(model).fastest(model, data)
    assert mode.rate == pytest.approx(W, rel=1e-12)
    assert decay.rate == pytest.approx(3.0 / REDUCED, rel=1e-12)
    with pytest.raises(InputError, match="has a mode of"):
        prepare(scene(tmp_path, masses('stiffness="1e6"'), {}))


@pytest.mark.parametrize("name", ["_heat_of_tendons", "energy"])
def test_what_is_entered_wrong_fails(tmp_path, monkeypatch, name):
    """A tenth too much heat or energy violates the check of energy."""
    owner = SpringBalance if name.startswith("_") else TendonSprings
    right = getattr(owner, name)
    monkeypatch.setattr(owner, name, lambda self, given: 1.1 * right(self, given))
    run = reaching(tmp_path, cord('stiffness="40" damping="0.5"'), duration_s=0.2)
    assert ("energy", "total") in violated(run)


MOTOR = '<motor name="pull" tendon="cord" ctrlrange="-5 5"/>'
WRAP = '<spatial name="cord"><site site="anchor"/><geom geom="drum"/><site site="tip"/></spatial>'
"""A cord around a drum on the base."""


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("tendon", [cord(""), WRAP])
def test_a_motor_pulls_a_cord(tmp_path, tendon):
    """Constant forces on the length: work = sum of force times change of length, and no momentum."""
    (tmp_path / "pull.csv").write_text("time_s,pull_N\n0,-2\n0.5,1.5\n")
    law = [{"name": "p", "until": "end", "controller": {"kind": "playback", "file": str(tmp_path / "pull.csv")}}]
    run = proved(reaching(tmp_path / "scene", tendon, MOTOR, phases=law))
    assert abs(run["balance.work_J"]).max() > 0.05


def test_a_force_along_a_cord_of_two_masses(tmp_path):
    """U on the difference: x = u t^2 / (2 mu), work = u x; the base does not move."""
    (tmp_path / "pull.csv").write_text("time_s,pull_N\n0,0.3\n")
    law = [{"name": "p", "until": "end", "controller": {"kind": "playback", "file": "pull.csv", "after": "hold"}}]
    run = proved(ffsm_mj.run(scene(tmp_path, masses("", MOTOR), {}, phases=law)))
    x = run["state.q_robot_s_1_m"] - run["state.q_robot_s_2_m"]
    np.testing.assert_allclose(x, 0.5 * 0.3 / REDUCED * run.time**2, atol=1e-12)
    np.testing.assert_allclose(run["balance.work_J"], 0.3 * x, atol=1e-12)
    assert abs(run["state.q_robot_free_x_m"]).max() < 1e-14


BASE = """<mujoco><option gravity="0 0 0"/><worldbody><site name="world"/><body name="sled">
  <joint name="x" type="slide" axis="1 0 0" {base}/><site name="hook" pos="0.1 0 0"/><geom size="0.1" mass="2"/>
  <body name="one" pos="0.2 0 0"><joint name="one" axis="0 0 1"/><geom size="0.1" mass="1"/><site name="tip" pos="0.2 0 0"/>
  </body><body name="two" pos="-0.2 0 0"><joint name="two" axis="0 0 1"/><geom size="0.1" mass="1"/>
  </body></body></worldbody>
  <tendon>{tendon}</tendon><actuator>{actuator}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"base": 'armature="2"'}, r"robot\.xml:2: joint 'x' has armature 2, and joins the base to the world"),
        ({"actuator": '<motor joint="x" armature="2"/>'}, "has armature 2 on a joint of the base"),
        (
            {"tendon": '<fixed name="t" armature="2"><joint joint="x" coef="1"/></fixed>'},
            "has armature 2, and acts on the world",
        ),
        (
            {"tendon": '<spatial name="t" armature="2"><site site="world"/><site site="tip"/></spatial>'},
            "has armature 2, and acts on the world",
        ),
        (
            {"tendon": '<fixed name="t" armature="2"><joint joint="one" coef="1"/><joint joint="two" coef="1"/></fixed>'},
            "has armature 2, and couples joints of two branches",
        ),
        (
            {
                "tendon": '<fixed name="t"><joint joint="one" coef="1"/><joint joint="two" coef="1"/></fixed>',
                "actuator": '<motor tendon="t" armature="2"/>',
            },
            "has armature 2 on tendon 't', which couples joints of two branches",
        ),
        (
            {"tendon": '<fixed name="t" stiffness="2"><joint joint="x" coef="1"/></fixed>'},
            "has stiffness that acts on the world",
        ),
        (
            {"tendon": '<spatial name="t" damping="2"><site site="world"/><site site="tip"/></spatial>'},
            "has damping that acts on the world",
        ),
        ({"tendon": '<fixed name="t" damping="-1"><joint joint="one" coef="1"/></fixed>'}, "damping that drives the tendon"),
    ],
)
def test_what_is_refused(tmp_path, parts, message):
    """Inertia, springs and dampers against the world, and armature across branches, each with file and line."""
    text = BASE.format(**{"base": "", "tendon": "", "actuator": ""} | parts)
    with pytest.raises(InputError, match=message):
        prepare(scene(tmp_path, text, {}))


def test_armature_on_one_branch_is_right(tmp_path):
    """Of a cord within a chain it is kinetic energy of its own: balances hold, and P and L are those of the bodies."""
    run = proved(reaching(tmp_path, cord('armature="0.4" stiffness="20"')))
    assert not [check for check in all_checks(run) if not check.passes]
