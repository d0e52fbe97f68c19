"""Joints through waypoints: the path is the one of least jerk, limits are kept, and runs follow it."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.dynamics.trajectories import MinimumJerk
from ffsm_mj.errors import InputError
from tests.controllers.test_hold import START, slider
from tests.controllers.test_track import ARM, WHEELS
from tests.replays import assert_passes


def test_from_rest_to_rest_it_is_the_closed_form():
    """10 s^3 - 15 s^4 + 6 s^5, with its rate and acceleration; the fastest is 15/8 of the mean, in the middle."""
    start, end, length = np.array([0.3, -1.0]), np.array([1.5, 0.2]), 2.7
    path = MinimumJerk([0.0, length], np.vstack((start, end)), np.zeros(2))
    for t in np.linspace(0.0, length, 31):
        s = t / length
        position, rate, acceleration = path.at(t)
        np.testing.assert_allclose(position, start + (end - start) * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=1e-14)
        np.testing.assert_allclose(rate, (end - start) * 30 * s**2 * (1 - s) ** 2 / length, atol=1e-13)
        np.testing.assert_allclose(acceleration, (end - start) * 60 * s * (1 - s) * (1 - 2 * s) / length**2, atol=1e-12)
    fastest = max(np.abs(rates).max() for _, rates in path.extremes(1))
    assert fastest == pytest.approx(15.0 / 8.0 * 1.2 / length, rel=1e-12)


def test_through_waypoints_no_other_path_has_less_jerk(rng):
    """The first variation of the integral of jerk^2 vanishes for all changes that leave waypoints and ends as they are."""
    times = np.array([0.0, 0.8, 1.1, 3.0])
    positions, rates = rng.normal(size=(4, 2)), rng.normal(size=2)
    path = MinimumJerk(times, positions, rates)
    for k, time in enumerate(times):
        np.testing.assert_allclose(path.at(time)[0], positions[k], atol=1e-12)
    np.testing.assert_allclose(path.at(0.0)[1], rates, atol=1e-12)
    np.testing.assert_allclose(path.at(0.0)[2], 0.0, atol=1e-11)
    np.testing.assert_allclose(path.at(3.0)[1:], 0.0, atol=1e-11)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    polynomial = np.polynomial.Polynomial
    for _ in range(5):
        # Zero at the waypoints, and of third order at both ends: what is left of position, rate and acceleration there.
        change = polynomial.fromroots([0.0] * 3 + [3.0] * 3 + [0.8, 1.1]) * polynomial(rng.normal(size=3))
        product = scale = 0.0
        for one, other in pairwise(times):
            at = one + (other - one) * (nodes + 1.0) / 2.0
            # The acceleration is a cubic in each segment: its derivative from differences over a long step is exact to 1e-9.
            step = 1e-3 * (other - one)
            jerk = np.array([(cubic(path, t + step) - cubic(path, t - step)) for t in at]) / (2.0 * step)
            varied = change.deriv(3)(at)[:, None] * weights[:, None] * (other - one) / 2.0
            product, scale = product + (jerk * varied).sum(axis=0), scale + np.abs(jerk * varied).sum(axis=0)
        assert (np.abs(product) < 1e-5 * scale).all()


def cubic(path, time):
    return path.at(time)[2]


def test_many_waypoints_on_a_path_of_least_jerk_are_that_path():
    """Waypoints on the closed form, at uneven times, change nothing: 1200 of them are solved for at once."""
    times = np.linspace(0.0, 1.0, 1201) ** 1.5

    def closed(s):
        return 10 * s**3 - 15 * s**4 + 6 * s**5

    path = MinimumJerk(times, closed(times)[:, None], np.zeros(1))
    middle = (times[1:] + times[:-1]) / 2.0
    np.testing.assert_allclose([path.at(s)[0][0] for s in middle], closed(middle), atol=1e-12)
    np.testing.assert_allclose([path.at(s)[1][0] for s in middle], 30 * middle**2 * (1 - middle) ** 2, atol=1e-8)


def test_extremes_are_found_wherever_they_are(rng):
    path = MinimumJerk([0.0, 1.0, 1.7, 4.0], rng.normal(size=(4, 3)), rng.normal(size=3))
    fine = [path.at(t)[:2] for t in np.linspace(0.0, 4.0, 20001)]
    for order in (0, 1):
        values, sampled = np.array([v for _, v in path.extremes(order)]), np.array([each[order] for each in fine])
        assert (values.max(axis=0) >= sampled.max(axis=0) - 1e-12).all()
        assert (values.min(axis=0) <= sampled.min(axis=0) + 1e-12).all()
        np.testing.assert_allclose(values.max(axis=0), sampled.max(axis=0), atol=1e-5)


def arm(law, **changes):
    """The seven-joint arm on its free base, turning slowly, with ideal motors."""
    path = {"kind": "joint_path", "joints": ARM, "bandwidth_rad_s": 5.0, **law}
    return prepare(
        "capture",
        {
            "actuators": {},
            "grasps": {},
            "duration_s": 2.5,
            "initial.rates.robot/base": [0.01, 0.0, -0.02, 0.05, -0.1, 0.08],
            "phases": [{"name": "all", "until": "end", "controller": path}],
            **changes,
        },
    )


GOAL = (START + np.array([0.4, 0.3, -0.5, -0.6, 0.2, 0.4, -0.3])).tolist()


def off_path(run, length=2.0):
    system = prepare("capture").system
    q = run.qpos[:, [system.joint(name).qpos.start for name in ARM]]
    s = np.minimum(run.time / length, 1.0)[:, None]
    return np.abs(q - START - (np.array(GOAL) - START) * (10 * s**3 - 15 * s**4 + 6 * s**5)).max()


def test_a_run_follows_the_closed_form():
    """On a base that turns, and with an error of first order in the control period: efforts are held."""
    law = {"waypoints": [{"at_s": 2.0, "positions": GOAL}]}
    off = {}
    for period in (0.02, 0.01):
        run = arm(law, time_step_s=0.01, control_period_s=period).run()
        assert_passes(run)
        off[period] = off_path(run)
        told = run["controller.path_error_rad"].max()
        assert told == pytest.approx(off[period], rel=1e-9)
        reports = run.summary()["controller"]["phases"][0]["reports"]
        assert reports == {"largest_error_rad": pytest.approx(told)}
    # q differs by 0.6 rad at most: the jerk is below 60 * 0.6 / 8 = 4.5 rad/s^3, half a period of which is 0.045 rad/s^2;
    # over w^2 = 25 1/s^2 that is 2e-3 rad.
    assert off[0.02] < 2e-3
    assert off[0.01] / off[0.02] == pytest.approx(0.5, abs=0.1)


def test_what_other_parts_do_is_known():
    """Wheels that turn the base push the arm off its path by no more than the period does."""
    law = {
        "kind": "joint_path",
        "joints": ARM,
        "bandwidth_rad_s": 2.0,
        "waypoints": [{"at_s": 1.0, "positions": START.tolist()}],
    }
    spin = {"kind": "pd", "joints": WHEELS, "kp": 0.0, "kd": 0.3}
    rates = {f"initial.rates.{name}": 5.0 for name in WHEELS}
    worst = {}
    for parts in ({"arm": law, "wheels": spin}, {"arm": law}):
        phases = [{"name": "all", "until": "end", "controllers": parts}]
        run = arm({}, phases=phases, duration_s=1.0, **rates).run()
        worst[len(parts)] = run["controller.arm_path_error_rad"].max()
    assert worst[2] < 3.0 * worst[1] + 1e-5


def refused(law, **changes):
    """Lines of the refusal of a first phase."""
    with pytest.raises(InputError) as error:
        arm(law, **changes).assemble()
    return error.value.lines


def test_limits_are_refused_with_the_numbers():
    points = {"waypoints": [{"at_s": 2.0, "positions": GOAL}]}
    fastest = 15.0 / 8.0 * 0.6 / 2.0
    assert arm({**points, "max_speed": 1.001 * fastest}).run().outcome == "completed"
    (line,) = refused({**points, "max_speed": 0.999 * fastest})
    numbers = f"robot/elbow: speed {-fastest:.6g} rad/s at 1 s, allowed at most {0.999 * fastest:.6g}"
    assert "phases.0.controller.waypoints: the path exceeds a limit: " + numbers + "; allow it more time" in line
    weak = {"kind": "torque_speed", "stall_torque_N_m": 1.0, "no_load_speed_rad_s": 9.0}
    (line,) = refused(points, actuators={"elbow": weak})
    assert "robot/elbow: effort " in line
    assert "N m at " in line
    # A later phase begins at a state that is not known before.
    law = {"kind": "joint_path", "joints": ARM, "bandwidth_rad_s": 5.0, **points, "max_speed": 0.999 * fastest}
    coast = {"name": "coast", "for_s": 0.01, "controller": {"kind": "off"}}
    run = arm({}, phases=[coast, {"name": "move", "until": "end", "controllers": {"arm": law}}]).run()
    assert run.outcome == "controller_failed"
    expected = "phase 'move', part 'arm' (joint_path) at t = 0.01 s: the path exceeds a limit (robot/elbow: speed "
    assert run.message.startswith(expected)


def test_efforts_are_predicted_as_the_run_needs_them():
    """The greatest effort of a run is allowed by a hundredth more, and refused by a hundredth less: measured 0.5 % apart."""
    points = {"waypoints": [{"at_s": 2.0, "positions": GOAL}]}
    run = arm(points, duration_s=2.0, control_period_s=0.005).run()
    most = [np.abs(run[f"actuators.robot_{name}_command_N_m"]).max() for name in ARM]
    assert arm({**points, "max_effort": [1.01 * each for each in most]}, duration_s=0.01).run().outcome == "completed"
    lines = refused({**points, "max_effort": [0.99 * each for each in most]})
    assert sorted(re.findall(r"robot/(\w+): effort", " ".join(lines))) == sorted(ARM)


def sliding(folder, *points, **law):
    """A finger that slides from 0.02 m within [0, 0.04] m."""
    waypoints = [{"at_s": at, "positions": [position]} for at, position in points]
    law = {"kind": "joint_path", "joints": ["slide"], "bandwidth_rad_s": 5.0, "waypoints": waypoints, **law}
    return slider(folder, {}, phases=[{"name": "all", "until": "end", "controller": law}])


def test_a_path_that_leaves_the_range_between_waypoints_is_refused(tmp_path):
    """A waypoint beyond the range is known at load; that the path overshoots, where it begins."""
    said = r"waypoints\.1\.positions\.0: 0\.05 is beyond the range of robot/slide, \[0, 0\.04\]"
    with pytest.raises(InputError, match=said):
        ffsm_mj.run(sliding(tmp_path, (0.5, 0.03), (1.0, 0.05)))
    assert ffsm_mj.run(sliding(tmp_path, (1.0, 0.04))).outcome == "completed"
    with pytest.raises(InputError) as error:
        ffsm_mj.run(sliding(tmp_path, (0.4, 0.0395), (0.8, 0.0395), (1.0, 0.0)))
    path = MinimumJerk([0.0, 0.4, 0.8, 1.0], np.array([[0.02], [0.0395], [0.0395], [0.0]]), np.zeros(1))
    most = max(float(position[0]) for _, position in path.extremes(0))
    assert most > 0.04
    assert f"robot/slide: position {most:.6g} m at 0.6" in str(error.value)
    assert "allowed [0, 0.04]" in str(error.value)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ({"waypoints": []}, r"waypoints: should have at least 1 item"),
        ({"waypoints": [{"at_s": 1.0, "positions": [0.0]}]}, r"waypoints\.0\.positions: 1 values for 7 joints"),
        ({"waypoints": [{"at_s": 0.0, "positions": GOAL}]}, r"waypoints\.0\.at_s: should be greater than 0"),
        (
            {"waypoints": [{"at_s": 1e-3, "positions": GOAL}]},
            r"at_s: comes 0\.001 s after the one before, less than the control",
        ),
        ({"waypoints": [{"at_s": 2.0, "positions": GOAL}] * 2}, r"the times of waypoints must ascend; 2 s follows 2 s"),
        (
            {"waypoints": [{"at_s": 2.0, "positions": GOAL}, {"at_s": 2.1, "positions": START.tolist()}], "max_speed": 3.0},
            r"waypoints\.1\.at_s: robot/\w+ needs a mean speed of [\d.]+ from the waypoint before, max_speed is 3",
        ),
        ({"waypoints": [{"at_s": 2.0, "positions": GOAL}], "max_effort": [1.0, 2.0]}, r"max_effort: 2 values for 7 joints"),
    ],
)
def test_faults(law, said):
    with pytest.raises(InputError, match=said):
        arm(law).assemble()


def test_a_phase_ends_at_the_last_waypoint():
    path = {"kind": "joint_path", "bandwidth_rad_s": 2.0, "waypoints": [{"at_s": 0.3, "positions": [-1.05, 0.75, 1.9]}]}
    rest = {"name": "rest", "until": "end", "controller": {"kind": "off"}}
    phases = [
        {"name": "wait", "for_s": 0.1, "controller": {"kind": "off"}},
        {"name": "move", "until": "finished", "controller": path},
        rest,
    ]
    run = ffsm_mj.run("air-bearing", {"duration_s": 0.5, "phases": phases})
    assert [phase.start_s for phase in run.log.phases] == pytest.approx([0.0, 0.1, 0.4])
    assert run.log.phases[2].reason == "finished"
