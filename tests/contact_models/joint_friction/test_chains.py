"""Dry friction in a floating chain: events of one joint and of another, order 4 through all of them, and how runs go on.

The digits are those of an integration of the chain in relative coordinates (DOP853, 1e-13) with located events.
"""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.grasp.scenes import ARM, grasping
from tests.contact_models.joint_friction.scenes import arm, changes, heat, rubbing, run
from tests.replays import proved
from tests.simulation.restored import is_rest_of, rest, told

pytestmark = pytest.mark.usefixtures("example_contact_models")

INITIAL = {
    "joints": {"one": 0.4, "two": -0.7},
    "rates": {"free": [0.05, -0.02, 0, 0, 0, -0.3], "one": 1.5, "two": -2.2},
}
SWUNG = {
    "initial": INITIAL | {"rates": {"free": [0.05, -0.02, 0, 0, 0, -0.3], "two": -1.5}},
    "contact_models": [{"kind": "drive", "joint": "one", "amplitude": 0.4, "rate_rad_s": 3.0}],
}
EVENTS = [
    ("one", 0.226589953638, 0, 1),
    ("two", 0.748453487362, -1, 0),
    ("two", 1.123174093361, 0, 1),
    ("one", 1.320028081722, 1, -1),
    ("two", 2.080504998631, 1, 0),
    ("two", 2.224412240461, 0, -1),
    ("one", 2.393939114039, -1, 1),
    ("two", 2.870442768008, -1, 0),
]


def ends(made):
    names = ("one_rad", "two_rad", "free_x_m", "free_y_m")
    angle = 2.0 * np.arctan2(made["state.q_robot_free_qz"][-1], made["state.q_robot_free_qw"][-1])
    return np.array([*(made[f"state.q_robot_{name}"][-1] for name in names), angle])


def test_both_joints_come_to_rest(tmp_path):
    expected = (0.741272392785, -0.958137096155, 0.076957661150, 0.016378435327, 0.267621772760)
    errors = []
    for step_s in (1e-2, 5e-3, 1e-3):
        made = ffsm_mj.run(rubbing(tmp_path, arm(), step_s, duration_s=3.0, initial=INITIAL))
        errors.append(np.abs(ends(made) - expected).max())
        (two, first, *_), (one, second, *_) = changes(made)
        assert (two, one) == ("two", "one")
        assert (first, second) == pytest.approx((0.253371085170, 0.603889400468), abs=max(1e-12, step_s**4))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
    assert errors[2] < 2e-12
    assert heat(made)[-1] == pytest.approx(0.066679084687, abs=1e-12)
    rates = [made[f"state.v_robot_free_{name}"][-1] for name in ("vx_m_s", "vy_m_s", "wz_rad_s")]
    assert rates == pytest.approx([0.025951933568, 0.008943159431, 0.128642629752], abs=2e-11)
    assert max(abs(made[f"state.v_robot_{joint}_rad_s"][-1]) for joint in ("one", "two")) < 1e-15


def test_eight_events_under_a_swinging_load(tmp_path):
    """Breakaways, stops and reversals; some of them while the other joint sticks, some while it slides."""
    errors = []
    for step_s, tolerance in ((4e-3, 3e-10), (2e-3, 2e-11)):
        made = run(tmp_path, arm(), step_s, duration_s=3.0, **SWUNG)
        found = changes(made)
        assert [(joint, *senses) for joint, _, *senses in found] == [(joint, *senses) for joint, _, *senses in EVENTS]
        assert [each[1] for each in found] == pytest.approx([each[1] for each in EVENTS], abs=tolerance)
        q = ends(made)
        assert (q[0], q[1], q[4]) == pytest.approx((0.621108303453, -0.994739382904, -1.461865234592), abs=tolerance)
        assert heat(made)[-1] == pytest.approx(0.322419377084, abs=tolerance)
        errors.append(max(abs(each[1] - other[1]) for each, other in zip(found, EVENTS, strict=True)))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)


def test_a_boosted_and_rotated_chain(tmp_path):
    """Drifting at 3 m/s and tumbled in space, it has the same events."""
    turned = {"free": [1.0, 2.0, -0.5, 0.5, 0.5, 0.5, 0.5]}  # x to y, y to z: body axes keep the spin
    initial = {
        "joints": INITIAL["joints"] | turned,
        "rates": INITIAL["rates"] | {"free": [3.0, 0.05 - 1.0, -0.02 + 0.5, 0, 0, -0.3]},
    }
    plain = changes(run(tmp_path, arm(), 4e-3, duration_s=1.0, initial=INITIAL))
    moved = changes(run(tmp_path, arm(), 4e-3, duration_s=1.0, initial=initial))
    assert [each[1] for each in moved] == pytest.approx([each[1] for each in plain], abs=1e-12)


def test_momentum_is_kept_to_order_four(tmp_path):
    """As without friction: what holds and what rubs acts between two links."""
    lost = []
    for step_s in (0.02, 0.01):
        made = ffsm_mj.run(rubbing(tmp_path, arm(), step_s, duration_s=1.0, initial=INITIAL))
        lost.append(max(np.abs(made[f"balance.total_residual_{name}"]).max() for name in ("P_x_N_s", "L_z_N_m_s")))
    assert lost[1] < 1e-8
    assert lost[0] / lost[1] > 12.0


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("until_s", [0.9, 1.6])
def test_a_logged_run_goes_on_in_the_middle(tmp_path, until_s):
    """From its log alone, where a joint sticks and where both slide; bit for bit."""
    whole = ffsm_mj.run(rubbing(tmp_path, arm(), 4e-3, duration_s=2.0, **SWUNG), out=tmp_path / "run", rerun=False)
    again = ffsm_mj.resume(tmp_path / "run", until_s)
    assert np.array_equal(whole.log.rows[-len(again.log.rows) :], again.log.rows, equal_nan=True)


@pytest.mark.long
def test_a_run_goes_on_from_each_event(tmp_path):
    """At a breakaway rate and acceleration are zero: only the state says in which sense the joint begins to slide."""
    path = rubbing(tmp_path, arm(), 4e-3, duration_s=3.0, **SWUNG)
    whole = ffsm_mj.Simulator(path)
    whole.reset()
    states = []
    while not whole.ended:
        if whole.step(until="event").events:
            states.append(whole.get_state().to_bytes())
    expected = told(whole.close())
    assert len(states) >= len(EVENTS)
    assert all(is_rest_of(expected, rest(path, {}, state)) for state in states)


@pytest.mark.long
def test_steps_of_a_chosen_accuracy(tmp_path):
    made = run(tmp_path, arm(), 0.05, duration_s=3.0, accuracy=1e-9, **SWUNG)
    assert [(joint, *senses) for joint, _, *senses in changes(made)] == [(j, *senses) for j, _, *senses in EVENTS]
    assert [each[1] for each in changes(made)] == pytest.approx([each[1] for each in EVENTS], abs=1e-7)


ROUGH_JOINTS = ARM.replace('name="shoulder" type="hinge"', 'name="shoulder" type="hinge" frictionloss="0.05"').replace(
    'name="elbow" type="hinge"', 'name="elbow" type="hinge" frictionloss="0.03"'
)
CORD_OF_A_HAND = ARM.replace('<geom name="hull"', '<site name="anchor" pos="0.1 0.3 0.2"/><geom name="hull"').replace(
    "<actuator>",
    '<tendon><spatial name="cord" frictionloss="0.3"><site site="anchor"/><site site="grip"/></spatial></tendon><actuator>',
)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("robot", [ROUGH_JOINTS, CORD_OF_A_HAND])
def test_an_arm_with_friction_catches_and_lets_go(tmp_path, robot):
    """The friction goes on in the motion with the object, and back: all checks pass, and a replay agrees."""
    made = proved(ffsm_mj.run(grasping(tmp_path / "scene", robot=robot)))
    caught, let_go = made.records["grasp_impulses"][0], made.records["releases"][0]
    assert any(caught.time_s < time_s < let_go.time_s for _, time_s, *_ in changes(made))
    assert np.all(np.diff(heat(made)) >= -1e-15)
    assert heat(made)[-1] > 1e-3
