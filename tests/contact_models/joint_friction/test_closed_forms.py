"""Dry friction of one joint against closed forms: times, ways and heat, to rounding where rates are linear in time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.contact_models.joint_friction.scenes import changes, heat, run, slider
from tests.scenes import ball
from tests.servos.scenes import INERTIA, START, link
from tests.servos.test_servos import HOLD

pytestmark = pytest.mark.usefixtures("example_contact_models")

REDUCED = 10.0 / 7.0
ROUNDING = 2e-13
"""Events are located to 1e-13 s, and then rounded up until they are passed."""


@pytest.mark.parametrize("step_s", [0.02, 2e-3])
def test_a_slider_stops_and_stays(tmp_path, step_s):
    """1.2 m/s against 3 N: it stops after v m / f, and never moves again."""
    made = run(tmp_path, slider(3.0), step_s, initial={"rates": {"s": 1.2}})
    ((_, time_s, *senses),) = changes(made)
    assert time_s == pytest.approx(4.0 / 7.0, abs=ROUNDING)
    assert senses == [1, 0]
    assert made["state.q_robot_s_m"][-1] == pytest.approx(12.0 / 35.0, abs=1e-14)
    assert heat(made)[-1] == pytest.approx(36.0 / 35.0, abs=1e-13)
    after = made.time > 4.0 / 7.0
    assert np.ptp(made["state.q_robot_s_m"][after]) < 1e-15
    assert np.abs(made["state.v_robot_s_m_s"][after]).max() < 1e-16
    assert np.abs(made["state.v_robot_free_vx_m_s"][after] - 2.4 / 7.0).max() < 1e-15
    assert set(made["contact.robot_s_sliding"]) == {0.0, 1.0}
    assert set(made["contact.robot_s_friction_force_N"][~after]) == {-3.0}


def test_a_spring_loses_the_same_with_every_half_swing(tmp_path):
    """Extremes fall by 2 f / k at each; it sticks where the spring holds less than the friction. Order 4."""
    errors = []
    for step_s in (4e-3, 2e-3, 1e-3):
        made = run(tmp_path, slider(1.5, 'stiffness="40"'), step_s, duration_s=4.5, initial={"joints": {"s": 0.5}})
        found = changes(made)
        times = np.array([time_s for _, time_s, *_ in found])
        assert [after for *_, after in found] == [1, -1, 1, -1, 1, -1, 0]
        errors.append(np.abs(times - np.arange(1, 8) * math.pi / math.sqrt(40.0 / REDUCED)).max())
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.1)
    assert made["state.q_robot_s_m"][-1] == pytest.approx(0.025, abs=1e-11)
    assert made["contact.robot_s_friction_force_N"][-1] == pytest.approx(1.0, abs=1e-9)
    assert heat(made)[-1] == pytest.approx(4.9875, abs=1e-11)


def test_below_its_limit_it_does_not_creep(tmp_path):
    """10 s at half the limit: no way at all, where a soft constraint creeps."""
    push = [{"kind": "drive", "joint": "s", "slope": 0.05}]
    made = run(tmp_path, slider(1.0), 0.01, duration_s=10.0, contact_models=push)
    assert np.abs(made["state.q_robot_s_m"]).max() < 1e-14
    assert np.abs(made["state.v_robot_s_m_s"]).max() < 1e-15
    np.testing.assert_allclose(made["contact.robot_s_friction_force_N"], -0.05 * made.time, atol=1e-14)
    assert changes(made) == []
    assert not heat(made).any()


def test_a_motor_at_half_the_limit_moves_nothing(tmp_path):
    """0.5 N against 1 N: not by rounding in 10 s, where MuJoCo's soft constraint creeps at 3.7e-4 m/s."""
    (tmp_path / "push.csv").write_text("time_s,actuators.robot_m_applied_N\n0,0.5\n10,0.5\n")
    law = [{"name": "push", "until": "end", "controller": {"kind": "playback", "file": "push.csv"}}]
    made = run(tmp_path, slider(1.0), 0.01, duration_s=10.0, phases=law)
    # Below 1e-15 a rate is rounding, and is left.
    assert np.abs(made["state.v_robot_s_m_s"]).max() <= 1e-15
    assert np.abs(made["state.q_robot_s_m"]).max() < 1e-14
    np.testing.assert_allclose(made["contact.robot_s_friction_force_N"][1:], -0.5, atol=1e-15)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("step_s", [0.01, 1e-3])
def test_it_breaks_away_where_the_load_reaches_the_limit(tmp_path, step_s):
    """A load of 0.4 N/s t against 1 N, from 2.5 s on; with the shorter step at a tick of the grid."""
    made = run(tmp_path, slider(1.0), step_s, duration_s=4.0, contact_models=[{"kind": "drive", "joint": "s", "slope": 0.4}])
    ((_, time_s, *senses),) = changes(made)
    assert (time_s, *senses) == (pytest.approx(2.5, abs=ROUNDING), 0, 1)
    assert made["state.v_robot_s_m_s"][-1] == pytest.approx(0.315, abs=1e-14)
    assert made["state.q_robot_s_m"][-1] == pytest.approx(0.1575, abs=1e-14)
    assert heat(made)[-1] == pytest.approx(0.1575, abs=1e-14)


def test_it_breaks_away_at_a_peak_inside_a_step(tmp_path):
    """1.005 N sin w t against 1 N with its peak in the middle of a step of h w = 0.29: 0.9948 N at both ends of it."""
    rate = math.pi / 0.11
    swing = [{"kind": "drive", "joint": "s", "amplitude": 1.005, "rate_rad_s": rate}]
    made = run(tmp_path, slider(1.0), 0.01, duration_s=0.06, contact_models=swing)
    (_, time_s, *senses), *_ = changes(made)
    assert (time_s, *senses) == (pytest.approx(math.asin(1.0 / 1.005) / rate, abs=ROUNDING), 0, 1)


def test_a_limit_returns_it_into_the_friction(tmp_path):
    joint = 'range="-9 0.2" limited="true"'
    made = run(tmp_path, slider(3.0, joint), initial={"rates": {"s": 1.2}}, joint_limits={"s": {"restitution": 0.5}})
    (hit,) = made.records["limit_impacts"]
    assert hit.time_s == pytest.approx(0.202573014647, abs=1e-12)
    assert hit.approach_rate == pytest.approx(0.774596669241, abs=1e-12)
    ((_, time_s, *senses),) = changes(made)
    assert (time_s, *senses) == (pytest.approx(0.387000793038, abs=1e-12), -1, 0)
    assert made["state.q_robot_s_m"][-1] == pytest.approx(0.2 - 1.0 / 28.0, abs=1e-14)
    assert heat(made)[-1] == pytest.approx(0.707142857143, abs=1e-12)
    assert hit.energy_change_J == pytest.approx(-0.321428571429, abs=1e-12)


def test_an_impact_does_not_see_it(tmp_path):
    """A ball of 1 kg hits the slider, which sticks: the impulse is that on a free one, 4/3 N s; on a locked one 1.75."""
    made = run(
        tmp_path,
        slider(3.0, hull=False),
        objects={"ball": ball("ball")},
        duration_s=0.6,
        initial={"joints": {"ball/free": [0.3, 0, 0, 1, 0, 0, 0]}, "rates": {"ball/free": [-1, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["mass", "ball/ball"], "restitution": 1.0}]},
    )
    (hit,) = made.impacts
    assert hit.impulse_N_s == pytest.approx(4.0 / 3.0, abs=1e-15)
    assert hit.qvel_after["robot/s"] == pytest.approx((-2.0 / 3.0,), abs=1e-15)
    assert max(map(abs, hit.qvel_after["robot/free"])) < 1e-15
    assert hit.qvel_after["ball/free"][0] == pytest.approx(1.0 / 3.0, abs=1e-15)
    ((_, time_s, *senses),) = changes(made)
    assert (time_s, *senses) == (pytest.approx(0.1 + 20.0 / 63.0, abs=ROUNDING), -1, 0)


@pytest.mark.parametrize("friction", [1e9, 1e-12])
def test_absurd_frictions(tmp_path, friction):
    """A friction that stops the slider at once makes heat of all its energy; one that is nothing leaves it all."""
    made = run(tmp_path, slider(friction), 0.01, duration_s=0.2, initial={"rates": {"s": 1.0}})
    lost = 0.5 * REDUCED if friction > 1.0 else 0.0
    assert heat(made)[-1] == pytest.approx(lost, abs=1e-12)
    assert made["state.v_robot_s_m_s"][-1] == pytest.approx(0.0 if lost else 1.0, abs=1e-12)


def swings(kp, kv, friction, setpoint=0.7):
    """Times, places and senses of the stops of I q'' = kp (u - q) - kv q' - f sign(q') from :data:`START`, and the heat.

    Between two stops q is a damped oscillation about u - f sign(q') / kp: each half swing takes pi / w, and leaves
    exp(-d pi / w) of the amplitude. It sticks where the spring holds less than the friction.
    """
    d, w0 = 0.5 * kv / INERTIA, math.sqrt(kp / INERTIA)
    w = math.sqrt(w0**2 - d**2)
    q, rate, sense = START["joints"]["j"], START["rates"]["j"], -1
    y = q - (setpoint - friction * sense / kp)
    # The rate is that of y (cos + d/w sin) + rate/w sin, damped, and zero at the first root after the start.
    t = math.atan2(w * rate, d * rate + w0**2 * y) / w
    t += math.pi / w * (t < 0.0)
    end = math.exp(-d * t) * (y * math.cos(w * t) + (rate + d * y) / w * math.sin(w * t))
    times, way = [t], abs(end - y)
    q = end + setpoint - friction * sense / kp
    while abs(kp * (setpoint - q)) > friction:
        sense = 1 if q < setpoint else -1
        centre = setpoint - friction * sense / kp
        last, q = q, centre - (q - centre) * math.exp(-d * math.pi / w)
        times.append(times[-1] + math.pi / w)
        way += abs(q - last)
    return np.array(times), q, friction * way


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("step_s", [4e-3, 1e-3])
def test_a_stiff_servo_swings_and_sticks(tmp_path, step_s):
    """447 1/s: both steps are implicit."""
    kp, kv, friction = 8e4, 60.0, 2000.0
    servo = f'<position name="servo" joint="j" kp="{kp}" kv="{kv}"/>'
    phases = [{"name": "all", "until": "end", "controller": HOLD}]
    model = link(servo, joint=f'frictionloss="{friction}"')
    made = run(tmp_path, model, step_s, duration_s=0.08, initial=START, phases=phases)
    times, place, lost = swings(kp, kv, friction)
    found = changes(made)
    assert len(found) == len(times) >= 4
    assert [each[1] for each in found] == pytest.approx(times, abs=1e-9)
    assert found[-1][3] == 0
    assert made["state.q_robot_j_rad"][-1] == pytest.approx(place, abs=1e-9)
    assert made["contact.robot_j_friction_torque_N_m"][-1] == pytest.approx(-kp * (0.7 - place), abs=1e-4)
    assert heat(made)[-1] == pytest.approx(lost, rel=1e-9)
