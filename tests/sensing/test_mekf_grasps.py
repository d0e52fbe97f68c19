"""The Kalman filter through grasps: it predicts the robot with its load, and its errors stay as large as it says."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.contact_models.grasp.scenes import OFF, grasping
from tests.scenes import ball
from tests.sensing.filter_drive import PERIOD_S, noiseless
from tests.sensing.grasp_drive import CAMERA, CaughtDrive, arm_and_target, grasp_filter, sensors_of_arm
from tests.sensing.scenes import column, run
from tests.sensing.test_mekf_consistency import bounds

STILL = {"acceleration_density": 0.0, "angular_acceleration_density": 0.0}
CAUGHT, LET_GO, END = 8, 18, 26
"""Ticks at which the target is caught and let go, and of the end."""
LONG_HELD = 17


@pytest.fixture(scope="module")
def systems(tmp_path_factory):
    return arm_and_target(tmp_path_factory.mktemp("arm"))


def seeded(systems, seeds, *, knows=True, encoder_rad=0.0, **camera):
    """Mean NEES of base and target while it is held and after it was let go, and the sum of all NIS with its degrees."""
    free, grasped = systems
    sensors = sensors_of_arm(free, **camera)
    sensors |= {n: replace(sensors[n], quantum=encoder_rad) for n in ("robot/q1", "robot/q2")}
    nees, nis, dof = [], 0.0, 0.0
    for seed in seeds:
        made = grasp_filter(free, sensors, {"grasp": grasped} if knows else {})
        drive, found, reports = CaughtDrive(free, grasped, sensors, made, seed), {}, []

        def tick(time_s, made=made, drive=drive, found=found, reports=reports):
            reports.append(made.telemetry()[:2])
            found[round(time_s / PERIOD_S)] = drive.nees()

        drive.through(CAUGHT, LET_GO, END, tick)
        nees.append([found[LONG_HELD], found[END]])
        nis += np.nansum([report[0] for report in reports])
        dof += sum(report[1] for report in reports)
    return np.mean(nees, axis=0), nis, dof


def test_the_estimate_follows_exactly_through_a_grasp(systems):
    """Without noise: before it, at its impulse, under load, and after the release.

    The filter integrates half steps where the truth integrates whole ones: RK4 errs by 1e-9 of a turn per step of 0.05 rad,
    in 26 steps by 2.6e-8.
    """
    free, grasped = systems
    exact = noiseless(sensors_of_arm(free))
    made = grasp_filter(free, exact, {"grasp": grasped}, process=STILL)
    drive = CaughtDrive(free, grasped, exact, made, 0, process=STILL, error=np.zeros(24))
    errors, rates = [], []

    def tick(_):
        errors.append(np.abs(drive.error()).max())
        rates.append(drive.truth.data.qvel.copy())

    drive.through(CAUGHT, LET_GO, END, tick)
    assert max(errors) < 2.6e-8
    assert np.abs(rates[CAUGHT + 1] - rates[CAUGHT])[:6].max() > 0.01  # the load was felt


def test_nees_and_nis_are_inside_their_bounds_through_a_grasp(systems):
    """Six runs with encoders of 14 bit; a filter that does not know the load is outside."""
    nees, nis, dof = seeded(systems, range(6), encoder_rad=3.8e-4)
    low, high = bounds(12, 6)
    assert ((low < nees) & (nees < high)).all()
    low, high = bounds(dof)
    assert low < nis < high
    without, _, _ = seeded(systems, range(2), knows=False)
    assert (without[0] > bounds(12, 2)[1]).all()


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("camera", [{}, {"delay_s": 0.1, "delay_jitter_s": 0.05, "dropout": 0.1}])
def test_a_hundred_runs_through_a_grasp(systems, camera):
    nees, nis, dof = seeded(systems, range(100), encoder_rad=3.8e-4, **camera)
    (low, high), (least, most) = bounds(12, 100), bounds(dof) / dof
    print(f"held {nees[0].round(2)}, let go {nees[1].round(2)} of [{low:.2f}, {high:.2f}]")
    print(f"NIS/dof {nis / dof:.4f} of [{least:.4f}, {most:.4f}]")
    assert ((low < nees) & (nees < high)).all()
    assert least < nis / dof < most


def test_late_samples_count_as_on_time_through_a_grasp(systems):
    """A camera that is 0.2 s late, across the closing and the opening of the grasp: as one that is not, to rounding."""
    free, grasped = systems
    ends = []
    for delay_s in (0.0, 0.2):
        sensors = sensors_of_arm(free, delay_s=delay_s)
        made = grasp_filter(free, sensors, {"grasp": grasped})
        drive = CaughtDrive(free, grasped, sensors, made, 3)
        shown, last_s = drive.truth.measured, (LET_GO + 2) * PERIOD_S
        drive.truth.measured = lambda time_s, shown=shown, last_s=last_s: {
            name: sample._replace(valid=sample.valid and (name not in CAMERA or sample.time_s < last_s))
            for name, sample in shown(time_s).items()
        }
        drive.through(CAUGHT, LET_GO, END)
        ends.append((drive.error(), made.covariance("robot"), made.covariance("target")))
    for one, other in zip(*ends, strict=True):
        assert np.abs(one - other).max() < 1e-11  # rounding of 1e-16 through 100 updates with numbers of order one


def test_an_impact_on_what_is_held_moves_the_robot_too(systems):
    """The variances of the base's velocities grow, and so do those of the target, which turns about the base."""
    free, grasped = systems
    sensors = sensors_of_arm(free)
    made = grasp_filter(free, sensors, {"grasp": grasped}, impact_velocity_m_s=0.3, impact_rate_rad_s=0.4)
    drive = CaughtDrive(free, grasped, sensors, made, 0)
    drive.through(2, 99, 2)
    before = {name: np.diagonal(made.covariance(name)) for name in ("robot", "target")}
    hit = SimpleNamespace(time_s=2 * PERIOD_S, energy_before_J={}, geoms=("target/target",))
    made.update(2 * PERIOD_S, drive.truth.measured(2 * PERIOD_S), (hit,), drive.estimate)
    added = np.diagonal(made.covariance("robot")) - before["robot"]
    assert added == pytest.approx(np.repeat((0.0, 0.0, 0.3**2, 0.4**2), 3), abs=1e-12)
    more = np.diagonal(made.covariance("target")) - before["target"]
    assert more[9:] == pytest.approx(np.full(3, 0.4**2))
    assert (more[6:9] > 0.3**2).all()


def test_a_latch_with_freedom_jolts_the_two_that_it_joins(tmp_path):
    """The variances of their velocities grow by what the filter takes an impact for; those of the third body do not."""
    given = {"initial": {"velocity_m_s": 0.01}, "process": STILL, "impact_velocity_m_s": 0.3}
    latch = {"robot_site": "grip", "object_site": "handle", "when": {"within": {"position_m": 0.2}}}
    path = grasping(
        tmp_path,
        others={"rock": ball("rock")},
        duration_s=0.02,
        control_period_s=0.01,
        initial={"joints": {"target/free": [1.06, 0, 0, 1, 0, 0, 0], "rock/free": [0, 5, 0, 1, 0, 0, 0]}},
        grasps={"grasp": {**latch, "joint": "hinge", "axis": [0, 0, 1]}},
        phases=[{"name": "hold", "until": "end", "arm": ["grasp"], "controller": OFF}],
        sensors={
            f"{kind}_{body[:3]}": {"kind": kind, "of": body, "first_s": 0.015}  # after the row that is read
            for kind in ("framepos", "framequat")
            for body in ("robot/base", "target/target", "rock/rock")
        },
        estimator={"kind": "mekf", **given},
    )
    made = run(path)
    assert made.grasps[0].time_s == 0.0
    for body, sigma in (("robot", math.hypot(0.01, 0.3)), ("target", math.hypot(0.01, 0.3)), ("rock", 0.01)):
        assert column(made, f"estimate.sigma_v_{body}_free_vx_m_s")[1] == pytest.approx(sigma, rel=1e-6)


@pytest.mark.parametrize("told", [True, False])
def test_in_a_run_errors_stay_within_what_the_filter_says(tmp_path, told):
    """Caught, held by a servo, let go: five standard deviations of each of 24 errors, without any process noise.

    Of its own grasps the robot knows, also where it is not told of impacts.
    """
    base = {"kind": "framepos", "of": "robot/base", "noise": 0.002, "interval_s": 0.02}
    turn = {**base, "kind": "framequat", "noise": 0.001}
    seen = {"of": "target/target", "relative_to": "grip", "delay_s": 0.03}
    joints = {
        f"{kind}_{joint}": {"kind": kind, "of": joint}
        for kind in ("jointpos", "jointvel")
        for joint in ("shoulder", "elbow")
    }
    hold = {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}
    path = grasping(
        tmp_path,
        duration_s=0.5,
        time_step_s=0.005,
        control_period_s=0.01,
        impact_feedback=told,
        initial={
            "joints": {"target/free": [1.08, 0.03, 0.02, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3]},
        },
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "for_s": 0.25, "controller": hold},
            {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
        ],
        sensors={"at": base, "turned": turn, "sees": {**base, **seen}, "sees_turn": {**turn, **seen}, **joints},
        estimator={"kind": "mekf", "process": {"acceleration_density": 1e-4, "angular_acceleration_density": 1e-4}},
    )
    made = run(path)
    (capture,) = made.grasps
    assert capture.release_s is not None
    keys = [key for key in made.log.header.layout.keys if key.startswith("estimate.sigma_")]
    assert len(keys) == 24
    for key in keys:
        error, sigma = column(made, key.replace("sigma_", "error_")), column(made, key)
        assert np.abs(error / sigma).max() < 5.0, key
        assert sigma[-1] < 0.02
