"""Delays from command to effect, and late control ticks: events of the plant at their own times."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from tests.replays import assert_replayed
from tests.scenes import ball, scene
from tests.sensing.scenes import Listener, arm, column, pushing, run

KP, KD, MASS = 40.0, 4.0, 2.0


class SpringAndDamper(Listener):
    """PD of a ball on a line, about zero."""

    def control(self, observation, command):
        command.effort[0] = -KP * observation.data.qpos[0] - KD * observation.data.qvel[0]
        command.powered[:] = True
        type(self).shown.append(observation)


def critical_delay_s() -> float:
    """Delay at which the phase margin of (kp + i w kd) / (m w^2) is used up."""
    # |kp + i w kd| = m w^2 is quadratic in w^2.
    square = (KD**2 + math.sqrt(KD**4 + 4.0 * MASS**2 * KP**2)) / (2.0 * MASS**2)
    omega = math.sqrt(square)
    return math.atan(omega * KD / KP) / omega


def swinging(folder, **scenario):
    return ffsm_mj.run(
        scene(
            folder,
            ball("ball", mass=MASS, joints="x"),
            {},
            **{
                "duration_s": 5.0,
                "time_step_s": 0.005,
                "control_period_s": 0.005,
                "initial": {"joints": {"robot/x": 0.1}},
                "phases": [{"name": "pd", "until": "end", "controller": {"kind": "listen"}}],
                **scenario,
            },
        ),
        controllers={"listen": SpringAndDamper},
    )


@pytest.mark.long
@pytest.mark.parametrize(("share", "grows"), [(0.99, False), (1.01, True)])
def test_a_delayed_servo_turns_unstable_where_theory_says(tmp_path, share, grows):
    """Held commands delay by half a period more. A hundredth beside the limit, amplitudes change by 1 % per second."""
    made = swinging(tmp_path, actuation={"delay_s": share * critical_delay_s() - 0.0025})
    x = np.abs(column(made, "state.q_robot_x_m"))
    early, late = x[200:500].max(), x[-300:].max()  # 1.5 s each: a whole oscillation takes 1.3 s
    assert bool(late > early) is grows
    assert 0.9 < late / early < 1.1  # near the limit indeed


def test_the_time_of_arrival_is_exact(tmp_path):
    """A constant push of 6 N arrives after 3.7 ms, 1.7 ms into the second step: the momentum tells when."""
    made = run(
        pushing(
            tmp_path,
            law={"efforts": (0.0, 0.0, 6.0)},
            initial={},
            contacts={"rules": []},
            duration_s=0.05,
            actuation={"delay_s": 0.0037},
        )
    )
    times = column(made, "state.time_s")
    pushed = np.sqrt(sum(column(made, f"momentum.robot_P_{axis}_N_s") ** 2 for axis in "xyz"))
    # The base turns by 1e-5 rad only, as the push is 6 cm off its centre.
    assert np.allclose(pushed[1:], 6.0 * (times[1:] - 0.0037), rtol=1e-4)
    (change,) = made.log.records["effort_changes"]
    assert change.time_s == pytest.approx(0.0037, abs=1e-12)
    assert_replayed(made)


def test_delays_of_whole_periods_need_no_events(tmp_path):
    made = run(pushing(tmp_path, actuation={"delay_s": 0.03}, duration_s=0.1))
    assert not made.log.records.get("effort_changes")
    assert (column(made, "actuators.robot_m1_applied_N_m")[:3] == 0.0).all()
    assert (column(made, "actuators.robot_m1_applied_N_m")[3:] == 0.2).all()
    assert_replayed(made)


def test_each_actuator_has_its_delay_and_that_of_the_model_counts(tmp_path):
    robot = arm().replace('<motor name="m1" joint="j1"/>', '<motor name="m1" joint="j1" delay="0.02" nsample="11"/>')
    made = run(pushing(tmp_path, robot=robot, actuators={"m2": {"kind": "ideal", "delay_s": 0.013}}, duration_s=0.1))
    first = {
        name: int(np.argmax(column(made, f"actuators.robot_{name}_applied_N{unit}") != 0.0))
        for name, unit in (("m1", "_m"), ("m2", "_m"), ("push", ""))
    }
    assert first == {"m1": 2, "m2": 2, "push": 0}  # 0.02, 0.013 and 0 s in ticks of 0.01 s
    assert {round(change.time_s % 0.01, 9) for change in made.log.records["effort_changes"]} == {0.003}
    assert_replayed(made)


def test_late_ticks_are_called_late_and_are_the_same_again(tmp_path):
    made = run(pushing(tmp_path, actuation={"control_jitter_s": 0.008}, seed=5))
    times = [seen.time_s for seen in Listener.shown if seen.at_tick]
    late = np.array(times) - 0.01 * np.arange(len(times))
    assert len(times) == 50
    assert late.min() >= 0.0
    assert late.max() < 0.008
    assert late.std() == pytest.approx(0.008 / math.sqrt(12.0), rel=0.3)
    assert_replayed(made)
    again = run(pushing(tmp_path, actuation={"control_jitter_s": 0.008}, seed=5))
    assert np.array_equal(made.log.rows, again.log.rows, equal_nan=True)
    with pytest.raises(InputError, match=r"actuation.control_jitter_s: must be less than control_period_s \(0.01 s\)"):
        run(pushing(tmp_path, actuation={"control_jitter_s": 0.01}))
