"""Dry friction with a servo so fast that steps are implicit: stops, turns and sticking against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.contact_models.joint_friction.scenes import changes, heat, run
from tests.servos.scenes import INERTIA, START, link
from tests.servos.test_servos import HOLD


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
