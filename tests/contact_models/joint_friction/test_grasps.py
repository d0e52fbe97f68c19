"""Dry friction of an arm that catches an object, holds it and lets it go: of its joints, or of a cord from hand to base."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.grasp.scenes import ARM, grasping
from tests.contact_models.joint_friction.scenes import changes, heat
from tests.replays import proved
from tests.simulation.restored import is_rest_of, rest, told

JOINTS = ARM.replace('name="shoulder" type="hinge"', 'name="shoulder" type="hinge" frictionloss="0.05"').replace(
    'name="elbow" type="hinge"', 'name="elbow" type="hinge" frictionloss="0.03"'
)
CORD = ARM.replace('<geom name="hull"', '<site name="anchor" pos="0.1 0.3 0.2"/><geom name="hull"').replace(
    "<actuator>",
    '<tendon><spatial name="cord" frictionloss="0.3"><site site="anchor"/><site site="grip"/></spatial></tendon><actuator>',
)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("robot", [JOINTS, CORD])
def test_an_arm_with_friction_catches_and_lets_go(tmp_path, robot):
    """The friction goes on in the motion with the object, and back: all checks pass, a replay and restarts agree."""
    path = grasping(tmp_path / "scene", robot=robot)
    simulator = ffsm_mj.Simulator(path)
    simulator.reset()
    simulator.step(until=1.1)
    state = simulator.get_state().to_bytes()
    while not simulator.ended:
        simulator.step()
    made = simulator.close()
    proved(made)
    assert is_rest_of(told(made), rest(path, {}, state))
    caught, let_go = made.records["grasp_impulses"][0], made.records["releases"][0]
    assert any(caught.time_s < time_s < let_go.time_s for _, time_s, *_ in changes(made))
    assert np.all(np.diff(heat(made)) >= -1e-15)
    assert heat(made)[-1] > 1e-3
