"""Friction of joints as a property that a scenario gives, and extremes of it."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.model.properties import property_value
from tests.contact_models.joint_friction.scenes import arm, changes, heat, rubbing, run, slider
from tests.contact_models.joint_friction.test_chains import INITIAL, SWUNG
from tests.experiments.files import campaign_file
from tests.scenes import ball, scene

pytestmark = pytest.mark.usefixtures("example_contact_models")


def state(made):
    """Columns of the motion, of efforts and energies."""
    keys = [key for key in made.keys if key.startswith(("state.", "energy.")) or key.endswith(("_P_x_N_s", "_work_J"))]
    return np.array([made[key] for key in keys])


@pytest.mark.long
def test_a_scenario_gives_the_friction(tmp_path):
    """As the file would."""
    keys = {
        "model": {
            "robot": {
                "upper": {"joints": {"one": {"frictionloss": 0.15}}},
                "lower": {"joints": {"two": {"frictionloss": 0.06}}},
            }
        }
    }
    path = rubbing(tmp_path, arm(0.5, 0.0), 4e-3, duration_s=1.0, initial=INITIAL, **keys)
    prepared = prepare(path)
    assert property_value(prepared.system.mj, "model.robot.upper.joints.one.frictionloss") == 0.15
    assert "model.robot.upper.joints.one.frictionloss is 0.15; without it 0.5" in [
        each.sentence for each in prepared.system.changes
    ]
    lines = prepared.describe()
    friction = lines.index("  dry friction")
    assert lines[friction + 1 : friction + 3] == ["    joint robot/one: 0.15 N m", "    joint robot/two: 0.06 N m"]
    made = ffsm_mj.run(path)
    same = run(tmp_path, arm(), 4e-3, duration_s=1.0, initial=INITIAL)
    np.testing.assert_array_equal(state(made), state(same))
    assert changes(made) == changes(same)


def test_a_campaign_over_the_friction(tmp_path):
    """A slider stops after v m / f in each run; a wildcard means all joints that have friction."""
    rubbing(tmp_path, slider(3.0), 0.01, duration_s=0.7, initial={"rates": {"s": 1.2}})
    for key in ("model.robot.mass.joints.s.frictionloss", "model.robot.*.joints.*.frictionloss"):
        design = load_campaign(campaign_file(tmp_path, {key: {"scale": {"uniform": [1.0, 2.0]}}})).design()
        for i, (factor,) in enumerate(design.rows[:2]):
            ((_, time_s, *_),) = changes(ffsm_mj.run(tmp_path / "scene.yaml", design.overrides(i)))
            assert time_s == pytest.approx(1.2 * 10.0 / 7.0 / (3.0 * factor), abs=1e-12)


def test_no_friction_costs_nothing(tmp_path):
    """Zero in the file or in the scenario: no columns, no contact model, bit for bit the run without the attribute."""
    zero = {"model": {"robot": {"mass": {"joints": {"s": {"frictionloss": 0.0}}}}}}
    initial = {"rates": {"s": 0.3}}
    plain = run(tmp_path, slider(0).replace('frictionloss="0"', ""), duration_s=0.1, initial=initial)
    for text, keys in ((slider(0), {}), (slider(3.0), zero)):
        made = run(tmp_path, text, duration_s=0.1, initial=initial, **keys)
        np.testing.assert_array_equal(state(made), state(plain))
        assert [*made.keys] == [*plain.keys]


def test_it_sticks_for_ever(tmp_path):
    """1e9 N m under a swinging load: no way, no heat, no event, and a run of rigid links."""
    made = run(tmp_path, arm(1e9, 1e9), 4e-3, duration_s=1.0, **SWUNG | {"initial": {"joints": INITIAL["joints"]}})
    assert changes(made) == []
    assert heat(made).max() < 1e-30  # of rates that are rounding
    for joint in ("one", "two"):
        assert np.ptp(made[f"state.q_robot_{joint}_rad"]) < 1e-15
    assert abs(made["contact.robot_one_friction_torque_N_m"] + 0.4 * np.sin(3.0 * made.time)).max() < 1e-12


def test_an_impact_on_what_sticks_for_ever(tmp_path):
    """4/3 N s as on a free slider (F9); then its energy is heat at once, and both move on as one body."""
    made = run(
        tmp_path,
        slider(1e9, hull=False),
        objects={"ball": ball("ball")},
        duration_s=0.3,
        initial={"joints": {"ball/free": [0.3, 0, 0, 1, 0, 0, 0]}, "rates": {"ball/free": [-1, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["mass", "ball/ball"], "restitution": 1.0}]},
    )
    (hit,) = made.impacts
    assert hit.impulse_N_s == pytest.approx(4.0 / 3.0, abs=1e-15)
    assert made["state.v_robot_free_vx_m_s"][-1] == pytest.approx(-4.0 / 21.0, abs=1e-14)
    assert heat(made)[-1] == pytest.approx(0.5 * 10.0 / 7.0 * 4.0 / 9.0, abs=1e-12)


@pytest.mark.parametrize(
    ("body", "joint", "value", "message"),
    [
        ("mass", "t", 1.0, "unknown joint of the body 't'"),
        ("bus", "free", 1.0, "dry friction is that of hinges and slides between links"),
        ("mass", "s", -1.0, "frictionloss"),
        ("mass", "s", float("nan"), "frictionloss"),
    ],
)
def test_a_wrong_key_is_refused(tmp_path, body, joint, value, message):
    keys = {"model": {"robot": {body: {"joints": {joint: {"frictionloss": value}}}}}}
    with pytest.raises(InputError, match=rf"scene\.yaml:1:\d+: model\.robot\.{body}\.joints\.{joint}.*{message}"):
        prepare(rubbing(tmp_path, slider(1.0), **json.loads(json.dumps(keys))))


ROBOT = """<mujoco><option gravity="0 0 0"/><worldbody><site name="world"/>
<body name="sled"><joint name="x" type="slide" axis="1 0 0" {base}/><geom size="0.1" mass="2"/>
<body name="link" pos="0.2 0 0">
<joint name="wrist" type="{kind}" {joint}/><geom size="0.1" mass="1"/><site name="tip" pos="0.2 0 0"/>
</body></body></worldbody>
<tendon>
{tendon}
</tendon></mujoco>"""
FIXED = '<fixed name="t" frictionloss="2"><joint joint="{}" coef="1"/></fixed>'
STRING = '<spatial name="t" frictionloss="2"><site site="world"/><site site="tip"/></spatial>'


def robot(**parts):
    return ROBOT.format(**{"base": "", "kind": "hinge", "joint": "", "tendon": ""} | parts)


@pytest.mark.parametrize("conservative", [True, False])
@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"kind": "ball", "joint": 'frictionloss="0.5"'},
            r"robot\.xml:4: joint 'wrist' has frictionloss 0\.5 on a ball joint, where limits by axis would depend on the "
            "frame; hinges and slides between links may have it",
        ),
        (
            {"base": 'frictionloss="3"'},
            r"robot\.xml:2: joint 'x' has frictionloss 3 on a joint of the base, which acts on the world",
        ),
        (
            {"tendon": FIXED.format("x")},
            r"robot\.xml:7: tendon 't' has frictionloss 2 and acts on the world; tendons between links may have it",
        ),
        ({"tendon": STRING}, r"robot\.xml:7: tendon 't' has frictionloss 2 and acts on the world"),
        ({"joint": 'frictionloss="inf"'}, r"robot\.xml:4: .*frictionloss"),
        ({"joint": 'frictionloss="-1"'}, r"robot\.xml:4: joint 'wrist' has frictionloss -1 below zero"),
        (
            {"tendon": FIXED.format("wrist").replace('"2"', '"-2"')},
            r"robot\.xml:7: tendon 't' has frictionloss -2 below zero",
        ),
    ],
)
def test_what_is_refused(tmp_path, parts, message, conservative):
    with pytest.raises(InputError, match=message):
        prepare(scene(tmp_path, robot(**parts), {}, conservative=conservative))


@pytest.mark.parametrize("parts", [{"joint": 'frictionloss="1"'}, {"tendon": FIXED.format("wrist")}])
def test_a_flag_that_switches_it_off_is_refused(tmp_path, parts):
    text = robot(**parts).replace('gravity="0 0 0"/>', 'gravity="0 0 0"><flag frictionloss="disable"/></option>')
    message = (
        r"robot\.xml:1: <flag frictionloss=\"disable\"> has no effect in a scene; remove the frictionloss of joints and"
    )
    with pytest.raises(InputError, match=message):
        prepare(scene(tmp_path, text, {}))


@pytest.mark.parametrize(
    "parts", [{"kind": "ball", "joint": 'frictionloss="0.5"'}, {"base": 'frictionloss="3"'}, {"tendon": STRING}]
)
def test_it_can_be_stripped(tmp_path, parts):
    model = prepare(scene(tmp_path, robot(**parts), {}), {"robot.strip": ["frictionloss"]}).system.mj
    assert not model.dof_frictionloss.any()
    assert not model.tendon_frictionloss.any()
