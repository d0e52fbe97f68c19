"""Equality constraints between the models of one file: robot and objects that are joined from the start."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.mechanisms.test_motions import last
from tests.replays import proved

ROOM = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
 <body name="post" pos="0 2 0"><geom name="post" type="box" size=".1 .1 .1"/></body>
 <body name="arm"><freejoint name="float"/><inertial pos="0 0 0" mass="20" diaginertia="2 2.2 2.4"/>
  <body name="link" pos=".2 0 0"><joint name="elbow" axis="0 0 1"/>
   <inertial pos=".2 0 0" mass="2" diaginertia=".01 .03 .03"/>
   <site name="tip" pos=".4 0 0"/></body></body>
 <body name="box" pos=".7 0 0"><freejoint name="box"/><inertial pos=".02 .01 0" mass="3" diaginertia=".03 .04 .05"/>
  <site name="face" pos="-.1 0 0"/>
  <body name="lid" pos=".1 0 0"><joint name="lid" axis="0 0 1"/>
   <inertial pos=".1 0 0" mass=".4" diaginertia=".001 .002 .002"/>
  </body></body></worldbody>
<equality>{equality}</equality><actuator><motor name="elbow" joint="elbow"/></actuator></mujoco>"""


def room(folder, equality, joints=None, rates=None, **keys):
    (folder / "room.xml").write_text(ROOM.format(equality=equality))
    given = {
        "name": "room",
        "duration_s": 1.0,
        "control_period_s": 0.02,
        "scene": {"mjcf": "room.xml", "robot": "arm"},
        "contacts": {"rules": []},
        "initial": {"joints": joints or {}, "rates": rates or {}},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / "room.yaml"
    path.write_text(json.dumps(given | keys))
    return path


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("kind", ["weld", "connect"])
def test_an_object_in_the_hand_from_the_start(tmp_path, kind):
    """The object without a value comes to the hand, and its rates follow; what the robot loses, it gains."""
    path = room(
        tmp_path,
        f'<{kind} site1="tip" site2="face"/>',
        {"elbow": 0.4},
        {"float": [0.1, 0, 0, 0.2, -0.1, 0.3], "elbow": 0.8, "lid": -0.5},
    )
    data = prepare(path).assemble().data
    np.testing.assert_allclose(data.site("box/face").xpos, data.site("robot/tip").xpos, rtol=0, atol=1e-12)
    run = ffsm_mj.run(path)
    proved(run)
    energy = run["energy.objects_J"]
    assert np.abs(np.diff(energy)).max() > 1e-6
    given = np.linalg.norm([run[f"balance.contact_P_{axis}_N_s"] for axis in "xyz"], axis=0)
    assert given[-1] > 0.01


def test_a_hand_on_a_fixed_post(tmp_path):
    """A fixed body takes momentum, and no energy."""
    path = room(tmp_path, '<connect body1="link" body2="post" anchor=".4 0 0"/>', {}, {"elbow": 0.8, "lid": 0.1})
    run = ffsm_mj.run(path)
    proved(run)
    energy = run["energy.robot_J"]
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9 * (1 + energy[0]))


def test_joints_of_two_models_that_are_coupled(tmp_path):
    """A coupling passes power, and no momentum."""
    path = room(
        tmp_path, '<joint joint1="lid" joint2="elbow" polycoef="0 -2 .5 0 0"/>', {}, {"elbow": 0.8, "float": [0.1] * 6}
    )
    run = ffsm_mj.run(path)
    proved(run)
    elbow, lid = last(run, "q_robot_elbow_rad", "q_box_lid_rad")
    assert lid == pytest.approx(-2.0 * elbow + 0.5 * elbow**2, abs=1e-11)
    assert np.abs(np.diff(run["energy.objects_J"])).max() > 1e-6
    for axis in "xyz":
        assert np.abs(run[f"balance.contact_P_{axis}_N_s"]).max() == 0.0
