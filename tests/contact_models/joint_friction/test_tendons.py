"""Dry friction of tendons: along a constant row, and along rows that move with the links."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ffsm_mj
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.dynamics.springs import tendon_rows
from tests.balance.test_tendon_springs import REACH, cord
from tests.contact_models.joint_friction.scenes import changes, heat, rubbing, run
from tests.scenes import HEAD

pytestmark = pytest.mark.usefixtures("example_contact_models")


def sliders(friction, joint=""):
    """F8: a base of 4 kg, masses of 1 and 2 kg on slides, and a tendon of the difference of their coordinates."""
    slides = "".join(
        f"""<body name="mass_{i}" pos="0 {i} 0"><joint name="s{i}" type="slide" axis="1 0 0" {joint}/>
        <inertial pos="0 {-i} 0" mass="{i}" diaginertia="0.01 0.01 0.01"/></body>"""
        for i in (1, 2)
    )
    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="4" diaginertia="0.2 0.3 0.35"/><geom size="0.1" mass="0"/>{slides}</body></worldbody>
      <tendon><fixed name="t" frictionloss="{friction}"><joint joint="s1" coef="1"/><joint joint="s2" coef="-1"/></fixed>
      </tendon></mujoco>"""


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("step_s", [0.02, 1e-3])
def test_a_fixed_tendon_stops_two_sliders(tmp_path, step_s):
    """0.6 N on 2/3 kg: 1 m/s end after 10/9 s, and both go on together with 1/3 m/s; the base never moves."""
    made = run(tmp_path, sliders(0.6), step_s, duration_s=2.0, initial={"rates": {"s1": 1.0}})
    ((name, time_s, *senses),) = changes(made)
    assert (name, *senses) == ("t", 1, 0)
    assert time_s == pytest.approx(10.0 / 9.0, abs=2e-13)
    assert [made[f"state.v_robot_s{i}_m_s"][-1] for i in (1, 2)] == pytest.approx([1.0 / 3.0] * 2, abs=1e-14)
    assert heat(made)[-1] == pytest.approx(1.0 / 3.0, abs=1e-13)  # a sum over steps
    assert abs(made["state.q_robot_free_x_m"]).max() < 1e-14
    record = made.records["stick_slips"][0]
    assert (record.unit, record.value) == ("m", pytest.approx(5.0 / 9.0, abs=1e-13))
    assert set(made["contact.robot_t_sliding"]) == {0.0, 1.0}


INITIAL = {
    "joints": {"a": 0.3, "b": -0.4},
    "rates": {"robot/free": [0.1, -0.2, 0.05, 0.2, -0.1, 0.3], "a": 0.8, "b": -1.2},
}
CORD = cord('frictionloss="4"')
DRUM = '<spatial name="cord" frictionloss="4"><site site="anchor"/><geom geom="drum"/><site site="tip"/></spatial>'
MOTORS = '<motor name="a" joint="a"/><motor name="b" joint="b"/>'
SWUNG = {
    "initial": INITIAL,
    "contact_models": [{"kind": "drive", "joint": "b", "amplitude": 1.0, "rate_rad_s": 5.0}],
    "duration_s": 1.6,
}
"""A floating arm whose cord, from its tip to the base, rubs, under a torque that swings."""
EVENTS = [(-1, 0), (0, 1), (1, -1), (-1, 0), (0, 1), (1, 0), (0, -1)]


def test_a_cord_slides_and_sticks_to_fourth_order(tmp_path):
    """Through stops, breakaways and reversals of a length that is no coordinate."""
    ends, times = [], []
    for step_s in (8e-3, 4e-3, 2e-3):
        made = ffsm_mj.run(rubbing(tmp_path, REACH.format(CORD, MOTORS), step_s, **SWUNG))
        assert [each[2:] for each in changes(made)] == EVENTS
        ends.append(np.array([made[f"state.q_robot_{joint}_rad"][-1] for joint in "ab"]))
        times.append(np.array([each[1] for each in changes(made)]))
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(ends))
    assert coarse / fine == pytest.approx(16.0, rel=0.1)
    assert fine < 2e-8
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(times))
    assert coarse / fine == pytest.approx(16.0, rel=0.1)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("tendon", [CORD, DRUM])
def test_a_cord_that_sticks_keeps_its_length(tmp_path, tendon):
    """To the order of the steps, straight or around a drum; all checks pass, and a replay agrees."""
    made = run(tmp_path, REACH.format(tendon, MOTORS), 2e-3, **SWUNG)
    assert [each[2:] for each in changes(made)] == EVENTS
    model = mujoco.MjModel.from_xml_string(REACH.format(tendon, MOTORS))
    data, lengths = mujoco.MjData(model), []
    for a, b in zip(made["state.q_robot_a_rad"], made["state.q_robot_b_rad"], strict=True):
        data.qpos[7:] = a, b
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length[0])
    sticks = made["contact.robot_cord_sliding"] == 0.0
    parts = np.split(np.array(lengths)[sticks], np.flatnonzero(np.diff(made.time[sticks]) > 3e-3) + 1)
    assert len(parts) == 3
    assert max(np.ptp(part) for part in parts) < 1e-10
    assert np.all(np.abs(made["contact.robot_cord_friction_force_N"]) <= 4.0)


class Oracle:
    """The arm with the friction of its cord as a force along the gradient of its length, or with this length held."""

    def __init__(self):
        self.model = mujoco.MjModel.from_xml_string(REACH.format(CORD, MOTORS))
        self.data = mujoco.MjData(self.model)

    def at(self, t, y):
        """Mass matrix, smooth forces, and gradient of the length."""
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:], data.ctrl[1] = y[: model.nq], y[model.nq :], np.sin(5.0 * t)
        mujoco.mj_forward(model, data)
        return mass_matrix(model, data), data.qfrc_actuator - data.qfrc_bias, tendon_rows(model, data)[0]

    def moves(self, y):
        """Derivative of the coordinates."""
        v, (w, i, j, k) = y[self.model.nq :], y[3:7]
        turn = np.array([[-i, -j, -k], [w, -k, j], [k, w, -i], [-j, i, w]])
        return np.concatenate((v[:3], 0.5 * turn @ v[3:6], v[6:]))

    def speed(self, t, y):
        return self.at(t, y)[2] @ y[self.model.nq :]

    def hold(self, t, y):
        """Friction that keeps the rate of the length, with the change of its gradient by central differences."""
        q, v = y[: self.model.nq], y[self.model.nq :]
        ends = [self.at(t, np.append(q + e * self.moves(y), v))[2] @ v for e in (1e-3, -1e-3, 5e-4, -5e-4)]
        coarse, fine = (ends[0] - ends[1]) / 2e-3, (ends[2] - ends[3]) / 1e-3
        M, force, R = self.at(t, y)
        return -(R @ np.linalg.solve(M, force) + (4.0 * fine - coarse) / 3.0) / (R @ np.linalg.solve(M, R))

    def until(self, t, y, event, friction):
        """Integrate under a friction to the root of an event, both functions of time and state."""

        def change(t, y):
            tau = friction(t, y)
            M, force, R = self.at(t, y)
            return np.append(self.moves(y), np.linalg.solve(M, force + tau * R))

        def due(t, y):
            return event(t, y)

        due.terminal = True
        found = solve_ivp(change, (t, 1.6), y, "DOP853", events=due, rtol=1e-11, atol=1e-12)
        return found.t_events[0][0], found.y_events[0][0]


def test_events_are_those_of_an_independent_integration(tmp_path):
    """DOP853 with located events: the cord stops, breaks away, and turns back."""
    oracle = Oracle()
    start = np.array([0, 0, 0, 1, 0, 0, 0, 0.3, -0.4, 0.1, -0.2, 0.05, 0.2, -0.1, 0.3, 0.8, -1.2])
    stops, y = oracle.until(0.0, start, oracle.speed, lambda *_: 4.0)
    breaks, y = oracle.until(stops, y, lambda t, y: abs(oracle.hold(t, y)) - 4.0, oracle.hold)
    assert oracle.hold(breaks, y) < 0.0
    # It starts at rest, where the rate has a root of order two: the next one is the turn.
    turns, _ = oracle.until(breaks, y, lambda t, y: oracle.speed(t, y) if t > breaks + 0.01 else 1.0, lambda *_: -4.0)
    made = ffsm_mj.run(rubbing(tmp_path, REACH.format(CORD, MOTORS), 1e-3, **SWUNG | {"duration_s": 0.5}))
    assert [each[1] for each in changes(made)] == pytest.approx([stops, breaks, turns], abs=1e-10)


def test_a_cord_of_a_boosted_and_rotated_arm(tmp_path):
    """Drifting at 3 m/s and turned by 120 degrees about (1, 1, 1), it has the same events."""
    v, w = np.array(INITIAL["rates"]["robot/free"]).reshape(2, 3)
    boosted = [*np.add(np.roll(v, 1), (3.0, -1.0, 0.5)), *w]  # the axes of the body keep the spin
    joints = INITIAL["joints"] | {"robot/free": [1.0, 2.0, -0.5, 0.5, 0.5, 0.5, 0.5]}
    moved = {"joints": joints, "rates": INITIAL["rates"] | {"robot/free": boosted}}
    plain, other = (
        changes(ffsm_mj.run(rubbing(tmp_path, REACH.format(CORD, MOTORS), 2e-3, **SWUNG | {"initial": initial})))
        for initial in (INITIAL, moved)
    )
    assert [each[2:] for each in plain] == [each[2:] for each in other] == EVENTS
    assert [each[1] for each in other] == pytest.approx([each[1] for each in plain], abs=1e-11)


def swing(other=""):
    """An arm of 0.3 m on a bus, whose cord to a point beside it is longest where both are in line with the joint."""
    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/><joint name="turn" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.2 0.3 0.35"/><site name="anchor" pos="0 0.1 0"/>
      <body name="arm" pos="0.3 0 0"><joint name="a" axis="0 0 1"/>
      <inertial pos="0.2 0 0" mass="2" diaginertia="0.01 0.02 0.02"/><site name="tip" pos="0.3 0 0"/></body>{other}
      </body></worldbody>
      <tendon><spatial name="cord" frictionloss="0.5"><site site="anchor"/><site site="tip"/></spatial></tendon></mujoco>"""


STUCK = """<body name="fin" pos="-0.3 0 0"><joint name="f" axis="0 0 1" frictionloss="2"/>
  <inertial pos="-0.1 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/></body>"""
"""Another arm, which sticks."""


@pytest.mark.parametrize("other", ["", STUCK])
def test_a_length_passes_its_extreme(tmp_path, other):
    """Its row is zero there, and its rate turns back while the arm swings on; beside it another joint may stick.

    Momenta drift by rounding and by the truncation of RK4: 4e-12 of a swing at 3 rad/s in steps of 1 ms.
    """
    ends, line = [], np.arctan2(-0.1, 0.3)
    for step_s in (4e-3, 2e-3, 1e-3):
        made = run(tmp_path, swing(other), step_s, duration_s=0.4, initial={"rates": {"a": -3.0}, "joints": {"a": 0.2}})
        ((name, _, *senses),) = [each for each in changes(made) if each[0] == "cord"]
        assert (name, *senses) == ("cord", 1, -1)
        turn = next(each for each in made.records["stick_slips"] if each.joint == "robot/cord")
        assert turn.value == pytest.approx(0.3 + np.hypot(0.3, 0.1), abs=1e-15)
        assert turn.qpos[3] == pytest.approx(line, abs=1e-12)
        for joint, rate in turn.qvel_before.items():
            assert turn.qvel_after[joint] == pytest.approx(rate, abs=1e-12)
        momentum = made.momentum("total")
        assert np.abs(momentum - momentum[0])[:, [0, 1, 5]].max() < 1e-11 * (step_s / 1e-3) ** 4
        ends.append(np.array([made[f"state.q_robot_{joint}_rad"][-1] for joint in ("turn", "a")]))
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(ends))
    assert coarse / fine == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize("angle", [0.2, 2.5])
def test_an_absurd_friction_stops_the_cord_at_once(tmp_path, angle):
    """1e9 N: the rate of its length is taken as by a plastic impulse, and the length stays; RK4 alone would leave the world.

    It takes (R v)^2 / 2 R M^-1 R^T. The way in which 1e9 N stop it is some 1e-9 m.
    """
    robot = swing().replace('frictionloss="0.5"', 'frictionloss="1e9"')
    initial = {"rates": {"a": -3.0, "turn": 0.4}, "joints": {"a": angle}}
    made = run(tmp_path, robot, 2e-3, duration_s=0.1, initial=initial)
    assert set(made["contact.robot_cord_sliding"][1:]) == {0.0}
    model = mujoco.MjModel.from_xml_string(robot)
    data = mujoco.MjData(model)
    data.qpos[3], data.qvel[2:] = angle, (0.4, -3.0)
    mujoco.mj_forward(model, data)
    M, R = mass_matrix(model, data), tendon_rows(model, data)[0]
    loss = 0.5 * (R @ data.qvel) ** 2 / (R @ np.linalg.solve(M, R))
    energy = made["energy.total_J"]
    assert energy[0] - energy[-1] == pytest.approx(loss, abs=1e-7)
    assert heat(made)[-1] == pytest.approx(loss, abs=1e-7)
