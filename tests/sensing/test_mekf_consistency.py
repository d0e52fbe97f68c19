"""Consistency of the Kalman filter: its errors are as large as it says, over seeded runs."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.stats import chi2

from tests.sensing.filter_drive import Drive, filter_of, satellites, sensors_in
from tests.sensing.scenes import arm, column, pushing, run
from tests.sensing.test_direct import BASE, ENCODERS, camera

BIAS_RAD_S = 0.01
LATE = {"delay_s": 0.1, "delay_jitter_s": 0.05, "dropout": 0.1}


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    return satellites(tmp_path_factory.mktemp("satellites"))


def seeded(system, seeds, ticks, noise_factor=1.0, bias=False, without=(), **camera):
    """Mean NEES of each body after the last tick, and the sum of all NIS with its degrees of freedom.

    There are all sensors but those ``without``. The initial error, the pushes, the noise and the bias of the gyro are drawn
    anew for each seed; ``noise_factor`` is the ratio of the noise of all sensors to that which the filter believes.
    """
    nees, nis, dof = [], 0.0, 0.0
    for seed in seeds:
        believed = {name: sensor for name, sensor in sensors_in(system, **camera).items() if name not in without}
        real = {name: replace(sensor, noise=noise_factor * sensor.noise) for name, sensor in believed.items()}
        if bias:
            real["robot/gyro"].bias[:] = BIAS_RAD_S * np.random.default_rng((seed, 1)).standard_normal(3)
        made = filter_of(system, believed, gyro_bias_rad_s=BIAS_RAD_S if bias else None)
        drive = Drive(system, real, made, seed)
        reports = []
        drive.run(ticks, lambda _, made=made, reports=reports: reports.append(made.telemetry()[:2]))
        nis += np.nansum([report[0] for report in reports])
        dof += sum(report[1] for report in reports)
        nees.append(drive.nees())
    return np.mean(nees, axis=0), nis, dof


def bounds(dof, runs=1):
    """Two-sided 95 % bounds of the mean of chi-square numbers of some degrees of freedom."""
    return chi2.ppf([0.025, 0.975], dof * runs) / runs


def test_nees_and_nis_are_inside_their_bounds(system):
    """Eight runs of 1.5 s with a late camera."""
    nees, nis, dof = seeded(system, range(8), 30, delay_s=0.1)
    low, high = bounds(12, 8)
    assert ((low < nees) & (nees < high)).all()
    low, high = bounds(dof)
    assert low < nis < high


def test_a_wrong_noise_is_outside(system):
    """Sensors of twice the noise that the filter believes: two runs of 1.5 s suffice."""
    nees, nis, dof = seeded(system, range(2), 30, noise_factor=2.0, delay_s=0.1)
    assert (nees > bounds(12, 2)[1]).all()
    assert nis > 2.0 * bounds(dof)[1]


WORLD = ("robot/place", "robot/stars", "robot/gyro")


def test_with_a_camera_alone_the_relative_pose_is_known_and_where_both_are_is_not(system):
    """NEES and NIS as with all sensors; what the camera sees is known to millimetres, the common place stays at 5 cm.

    No relative sample tells the mean of two independent errors of 5 cm, whose standard deviation is 5 cm / sqrt(2).
    """
    nees, nis, dof = seeded(system, range(8), 30, without=WORLD, delay_s=0.1)
    low, high = bounds(12, 8)
    assert ((low < nees) & (nees < high)).all()
    low, high = bounds(dof)
    assert low < nis < high
    made = filter_of(system, {name: sensor for name, sensor in sensors_in(system).items() if name not in WORLD})
    drive = Drive(system, sensors_in(system), made, 0)
    drive.run(30)
    assert np.sqrt(np.diag(made.covariance("robot"))[:3].min()) > 0.05 / 2**0.5
    truth, estimate = drive.truth.data, drive.estimate
    for data in (truth, estimate):
        mujoco.mj_kinematics(system.mj, data)
    true, seen = (
        data.site("robot/eye").xmat.reshape(3, 3).T @ (data.body("b/b").xpos - data.site("robot/eye").xpos)
        for data in (truth, estimate)
    )
    assert np.abs(true - seen).max() < 0.01  # noise of 5 mm a sample, 30 of them: 1 mm, and what 0.01 rad do at 2 m
    assert np.abs(drive.error()[:, :3]).max() > 0.02  # which the initial error of the place still is


def told(case, nees, nis, dof):
    """Print what is measured; whether each mean is inside its 95 % bounds, NEES of the bodies and NIS."""
    (low, high), (least, most) = bounds(12, 100), bounds(dof) / dof
    text = f"NEES {nees.round(2)} of [{low:.2f}, {high:.2f}], NIS/dof {nis / dof:.4f} of [{least:.4f}, {most:.4f}]"
    print(f"{case}: {text}, {dof:.0f} degrees of freedom")
    return [*((low < nees) & (nees < high)), least < nis / dof < most]


@pytest.mark.long
def test_a_hundred_runs_with_a_late_camera(system):
    """NEES of both bodies after 1.5 s and NIS of all samples."""
    assert all(told("late", *seeded(system, range(100), 30, delay_s=0.1)))


@pytest.mark.long
def test_a_hundred_runs_with_jitter_dropouts_and_a_biased_gyro(system):
    assert all(told("late, jitter, dropouts, biased gyro", *seeded(system, range(100), 30, bias=True, **LATE)))


@pytest.mark.long
def test_a_hundred_runs_with_wrong_noise(system):
    """Twice and half of what the filter believes."""
    for factor in (2.0, 0.5):
        assert not any(told(f"noise x {factor}", *seeded(system, range(100), 30, noise_factor=factor, delay_s=0.1)))


@pytest.mark.parametrize("dropout", [0.0, 1.0])
def test_in_a_run_with_an_impact_errors_stay_within_what_the_filter_says(tmp_path, dropout):
    """An arm hits a box that a late camera on its hand sees, or never does: five standard deviations of each of 24 errors.

    The jump of the box's velocity, 0.4 m/s, is one of the standard deviation that the filter adds at the impact.
    """
    noise = {"base_position": 0.005, "base_attitude": 0.002, "base_velocity": 0.003, "base_rate": 0.001}
    seen = camera("framepos", "framequat", interval_s=0.1, delay_s=0.1, noise=0.005, dropout=dropout)
    made = run(
        pushing(
            tmp_path,
            robot=arm(ENCODERS + BASE),
            sensors={**{name: {"noise": value} for name, value in noise.items()}, **seen},
            estimator={"kind": "mekf", "process": {"acceleration_density": 1e-3, "angular_acceleration_density": 1e-3}},
            duration_s=0.4,
        )
    )
    keys = [key for key in made.log.header.layout.keys if key.startswith("estimate.sigma_")]
    assert len(keys) == 24
    for key in keys:
        error, sigma = column(made, key.replace("sigma_", "error_")), column(made, key)
        assert np.abs(error / sigma).max() < 5.0
    jump = column(made, "estimate.error_v_b_free_vx_m_s")
    assert np.abs(jump).max() > 0.1
    assert set(column(made, "estimate.nis_dof")) == ({12.0} if dropout else {12.0, 18.0})
