"""The Kalman filter: its derivatives, its updates, late samples, impacts, and what it refuses."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from ffsm_controllers.estimators.frames import axes_of
from ffsm_controllers.estimators.mekf.config import MekfConfig
from ffsm_controllers.estimators.mekf.estimate import Estimate, right_jacobian
from ffsm_controllers.estimators.mekf.frame_measurement import KINDS, measurement_of
from ffsm_controllers.estimators.mekf.joints import encoder_errors
from ffsm_controllers.estimators.mekf.layout import Layout, floating_bodies
from ffsm_controllers.estimators.mekf.propagation import Propagation
from ffsm_controllers.estimators.readings import RateFilter, Reading
from ffsm_mj.controller_protocol import Measurement, predict
from ffsm_mj.errors import ScenarioFaults
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.sensors import AddedSensor
from ffsm_mj.sensing.config import SensorConfig
from ffsm_mj.sensing.sensor import sensors_of
from tests.scenes import box
from tests.sensing.filter_drive import (
    CAMERA,
    INITIAL,
    SATELLITE,
    Drive,
    error_of,
    filter_of,
    moved,
    noiseless,
    satellites,
    sensors_in,
)
from tests.sensing.scenes import arm

STILL = {"acceleration_density": 0.0, "angular_acceleration_density": 0.0}
DIFFERENCE = 1e-5
INERTIAL = np.array((0.5, -0.1, 0.7, 0.5))
"""Attitude of the world axes in those of the orbit."""
FAR = np.tile(np.concatenate(([0.2, -0.1, 0.1], [0.3, -0.4, 0.166], [0.05, 0.02, -0.03], [0.05, -0.04, 0.02])), 2)
"""Initial errors: the attitude by 30 degrees (0.527 rad)."""


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    return satellites(tmp_path_factory.mktemp("satellites"))


@pytest.fixture(scope="module")
def moving_arm(tmp_path_factory):
    """An arm that moves, and a box that its hand sees, in a general state with efforts."""
    folder = tmp_path_factory.mktemp("arm")
    own = '<gyro name="gyro" site="pad"/><velocimeter name="velocimeter" site="imu"/>'
    (folder / "robot.xml").write_text(arm(own))
    (folder / "b.xml").write_text(box("b", mass=5.0, half=(0.2, 0.3, 0.5)).replace('pos="0 0 0"', 'pos=".1 .2 -.1"', 1))
    added = [AddedSensor(kind, kind, "b/b", "wrist") for kind in KINDS if kind.startswith("frame")]
    added.append(AddedSensor("startracker", "startracker", "imu"))
    made = compile_system(
        read_model(folder / "robot.xml"), {"b": read_model(folder / "b.xml")}, time_step_s=0.01, sensors=added
    )
    data, random = mujoco.MjData(made.mj), np.random.default_rng(4)
    mujoco.mj_integratePos(made.mj, data.qpos, random.standard_normal(made.mj.nv), 1.0)
    data.qvel[:], data.ctrl[:] = 0.4 * random.standard_normal(made.mj.nv), (0.2, 0.02, 6.0)
    return made, data


def believed(system, data, covariance=None):
    layout = Layout(floating_bodies(system), ())
    covariance = np.zeros((layout.size, layout.size)) if covariance is None else covariance
    made = mujoco.MjData(system.mj)
    made.qpos[:], made.qvel[:], made.ctrl[:] = data.qpos, data.qvel, data.ctrl
    return Estimate(layout, made, covariance)


def sensor_in(system, name):
    """A sensor without errors; star trackers measure in the axes of the orbit."""
    configs = {"startracker": SensorConfig(kind="startracker", of="imu", axes="eci")}
    return next(one for one in sensors_of(system, configs, 0.05, 10.0, INERTIAL) if one.name == name)


def rated(value, time_s=0.0, valid=True):
    return Measurement(np.asarray(value, dtype=float), time_s, 0.0, valid)


@pytest.mark.parametrize("sensor", list(KINDS))
def test_measurements_are_those_of_mujoco_with_their_derivatives(moving_arm, sensor):
    """At the truth the innovation is zero; central differences of 1e-5 err by 1e-10 of second derivatives of order 1."""
    system, data = moving_arm
    name = f"robot/{sensor}" if sensor in ("gyro", "velocimeter") else sensor
    system.mj.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    mujoco.mj_forward(system.mj, data)
    value = data.sensor(name).data.copy()
    if sensor == "startracker":  # in axes that are not the world's
        mujoco.mju_mulQuat(value, INERTIAL, value.copy())
    measurement = measurement_of(system.mj, floating_bodies(system), sensor_in(system, name))
    innovation, slope = measurement.innovation(system.mj, believed(system, data), value)
    assert np.abs(innovation).max() < 1e-12
    for i in range(slope.shape[1]):
        error = DIFFERENCE * np.eye(slope.shape[1])[i]
        ahead, behind = (
            measurement.innovation(system.mj, believed(system, moved(system, data, sign * error)), value)[0]
            for sign in (-1.0, 1.0)
        )
        assert np.abs((ahead - behind) / (2 * DIFFERENCE) - slope[:, i]).max() < 1e-8


@pytest.mark.parametrize("sensor", ["framepos", "framequat"])
def test_errors_of_encoders_are_noise_of_what_is_seen_across_the_joints(moving_arm, sensor):
    """Their derivatives by central differences, as above."""
    system, data = moving_arm
    joints = [system.joint(f"robot/{name}") for name in ("j1", "j2")]
    system.mj.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    mujoco.mj_forward(system.mj, data)
    value = data.sensor(sensor).data.copy()
    measurement = measurement_of(system.mj, floating_bodies(system), sensor_in(system, sensor))
    dofs = [joint.dofs.start for joint in joints]
    slope = measurement.innovation(system.mj, believed(system, data), value, dofs)[1][:, 24:]
    assert np.abs(slope).max() > 0.1
    for i, joint in enumerate(joints):
        innovations = []
        for step in (-DIFFERENCE, DIFFERENCE):
            belief = believed(system, data)
            belief.data.qpos[joint.qpos] += step
            innovations.append(measurement.innovation(system.mj, belief, value)[0])
        assert np.abs((innovations[0] - innovations[1]) / (2 * DIFFERENCE) - slope[:, i]).max() < 1e-8


def test_a_camera_on_a_joint_with_a_noisy_encoder_is_believed_as_far_as_it_is_good(tmp_path):
    """An encoder of 0.02 rad puts a box at 2 m off by 40 mm, for a camera of 5 mm: NIS per degree of freedom is 1 with it.

    Of 60 samples of three components the mean is known to sqrt(2 / 540) = 0.06 in the linear case.
    """
    inside = '<joint name="j" axis="0 1 0"/><geom size=".1" mass="1"/><site name="eye"/></body></body>'
    eye = '<site name="eye" pos=".3 .1 0" euler="0 60 15"/></body>'
    encoder = '<jointpos name="encoder" joint="j"/><jointvel name="rate" joint="j"/></sensor>'
    robot = SATELLITE.replace(eye, f'<body name="link" pos=".3 .1 0">{inside}').replace("</sensor>", encoder)
    system = satellites(tmp_path, robot=robot)
    sensors = sensors_in(system)
    sensors["robot/encoder"] = replace(sensors["robot/encoder"], noise=np.array([0.02]))
    found = []
    for believed_rad in (0.02, 0.0):
        drive = Drive(system, sensors, filter_of(system, sensors, noise={"encoder": believed_rad}), seed=1)
        nis = []
        drive.run(60, lambda _, drive=drive, nis=nis: nis.append(drive.made.telemetry()[:2]))
        found.append(np.nansum(np.array(nis)[:, 0]) / np.nansum(np.array(nis)[:, 1]))
    assert abs(found[0] - 1.0) < 0.3
    assert found[1] > 2.0


def test_encoders_have_the_noise_of_their_samples_or_that_is_believed():
    """White noise and rounding of 1e-3 / sqrt(12); joints without an error are left out.

    Differences of two samples 0.1 s apart have 200 times their variance; a sensor of rates has its own.
    """
    places = [Reading(name, "position", slice(i, i + 1), slice(i, i + 1), ignore) for i, name in enumerate("abc")]
    for reading in places[:2]:
        reading.differentiate(0.0, lambda before, after: after - before)
    readings = [*places, Reading("rate", "twist", slice(2, 2), slice(2, 3), ignore)]
    sensors = {
        "a": SimpleNamespace(noise=0.0, quantum=1e-3, interval_s=0.1),
        "b": SimpleNamespace(noise=0.0, quantum=0.0, interval_s=0.1),
        "c": SimpleNamespace(noise=0.1, quantum=0.0, interval_s=0.1),
        "rate": SimpleNamespace(noise=0.3, quantum=0.0, interval_s=0.1),
    }
    errors = encoder_errors(readings, sensors, {"c": 0.2})
    assert errors.dofs == (0, 2)
    assert errors.variances == pytest.approx([1e-6 / 12.0, 0.04])
    assert errors.rate_variances == pytest.approx([200.0 * 1e-6 / 12.0, 0.09])


@pytest.mark.parametrize("filter_s", [0.0, 0.02, 0.2])
def test_the_gain_of_differences_is_the_sum_of_their_squared_answers_to_one_sample(filter_s):
    """Variances of independent errors add up; after 300 samples the answer is below 1e-6 of the first."""
    rates = RateFilter(filter_s, lambda before, after: after - before)
    for k in range(3):
        rates.rate(0.01 * k, np.zeros(1))
    answers = [float(rates.rate(0.03 + 0.01 * k, np.array([1.0 if k == 0 else 0.0]))[0]) for k in range(300)]
    assert rates.gain(0.01) == pytest.approx(math.fsum(answer**2 for answer in answers), rel=1e-9)


def ignore(value, data):
    """Writes nothing."""


def test_the_covariance_moves_as_the_differences_of_predictions(moving_arm):
    """Of base with arm and of a box whose mass is off its origin: over 0.1 s to 2 (0.1 rad)^3 / 12 = 2e-4 of the largest."""
    system, data = moving_arm
    config = MekfConfig(kind="mekf", process=STILL)
    belief = believed(system, data, np.zeros((24, 24)))
    propagation = Propagation(system.mj, belief.layout, config, {}, {})
    found = np.empty((24, 24))
    for i in range(24):
        error = DIFFERENCE * np.eye(24)[i]
        states = [moved(system, data, sign * error) for sign in (1.0, -1.0)]
        for state in states:
            state.ctrl[:] = data.ctrl
            predict(system.mj, state, 0.1)
        found[:, i] = error_of(system, *states).ravel() / (2 * DIFFERENCE)
    for covariance in (np.eye(24), np.diag(np.arange(1.0, 25.0))):
        belief = believed(system, data, covariance)
        propagation.advance(belief, 0.1, data.ctrl)
        assert np.abs(belief.covariance - found @ covariance @ found.T).max() < 3e-4 * covariance.max()
    assert np.abs(found - np.eye(24)).max() > 0.05


def test_process_noise_is_a_random_walk_and_its_integral(moving_arm):
    """From certainty: variance q^2 t of the rates, q^2 t^3 / 3 of the coordinates, whatever the steps (slow turning)."""
    robot, _ = moving_arm
    belief = believed(robot, mujoco.MjData(robot.mj))
    config = MekfConfig(kind="mekf", process={"acceleration_density": 0.1, "angular_acceleration_density": 0.2})
    propagation = Propagation(robot.mj, belief.layout, config, {}, {})
    for _ in range(40):
        propagation.advance(belief, 0.05, np.zeros(robot.mj.nu))
    body = belief.layout.named("b")
    variances = np.diagonal(belief.covariance)
    # The box's mass is off its origin, whose velocity its turning therefore does not change at rest.
    assert variances[body.velocity] == pytest.approx(0.01 * 2.0)
    assert variances[body.position] == pytest.approx(0.01 * 8.0 / 3.0)
    assert variances[body.rate] == pytest.approx(0.04 * 2.0)
    assert variances[body.attitude] == pytest.approx(0.04 * 8.0 / 3.0)


def test_the_reset_is_the_derivative_of_what_remains():
    """Central differences of Log(Exp(-theta) Exp(theta + e)) at 0, 1e-5 and 1 rad."""
    for theta in (np.zeros(3), np.full(3, 1e-5), np.array([0.5, -0.7, 0.5])):
        columns = []
        for axis in range(3):
            turns = [np.empty(4), np.empty(4)]
            for turn, sign in zip(turns, (1.0, -1.0), strict=True):
                turn[:] = 1.0, 0.0, 0.0, 0.0
                mujoco.mju_quatIntegrate(turn, theta + sign * DIFFERENCE * np.eye(3)[axis], 1.0)
            apart = np.empty(3)
            mujoco.mju_subQuat(apart, *turns)
            columns.append(apart / (2 * DIFFERENCE))
        # The vector between the two turns is that between the remaining errors, up to the square of the step.
        assert np.allclose(np.transpose(columns), right_jacobian(theta), atol=1e-8)


def test_a_correction_turns_quaternion_and_covariance(system):
    """By 53 degrees: the quaternion by Exp(theta), the covariance of the attitude, and that with others, by the Jacobian."""
    theta, random = np.array([0.5, -0.7, 0.3]), np.random.default_rng(0)
    root = random.standard_normal((24, 24))
    belief = believed(system, mujoco.MjData(system.mj), root @ root.T)
    before, covariance = belief.data.qpos.copy(), belief.covariance
    error, reset, turn = np.zeros(24), np.eye(24), np.empty(3)
    body = belief.layout.named("b")
    error[body.attitude], reset[body.attitude, body.attitude] = theta, right_jacobian(theta)
    belief.correct(error)
    mujoco.mju_subQuat(turn, belief.data.qpos[body.qpos][3:], before[body.qpos][3:])
    assert np.allclose(turn, theta, atol=1e-12)
    assert np.allclose(belief.covariance, reset @ covariance @ reset.T, atol=1e-12)
    assert not np.allclose(belief.covariance, covariance, atol=0.1)


@pytest.mark.parametrize(
    ("sensor", "config", "expected"),
    [
        ({"noise": 0.02}, {}, 0.02),
        ({"noise": 0.02, "quantum": 0.1}, {}, math.hypot(0.02, 0.1 / math.sqrt(12.0))),
        ({"noise": 0.0}, {"floor": {"rate_rad_s": 0.001}}, 0.001),
        ({"noise": 0.02}, {"noise": {"gyro": 0.05}}, 0.05),
        ({"noise": (0.02, 0.03, 0.05)}, {}, (0.02, 0.03, 0.05)),
    ],
)
def test_what_the_filter_believes_of_a_sample(system, sensor, config, expected):
    """Noise and rounding, the floor, or what is stated: after one sample of a gyro, it is what is left."""
    sensors = sensors_in(system)
    noise = np.broadcast_to(sensor["noise"], 3)
    sensors["robot/gyro"] = replace(sensors["robot/gyro"], **{**sensor, "noise": noise})
    made = filter_of(system, sensors, initial={"rate_rad_s": 1e3}, **config)
    Drive(system, sensors, made, 0).run(0)
    axes = axes_of(system.mj.site("robot/imu").quat)
    left = axes.T @ made.covariance("robot")[9:, 9:] @ axes  # in axes of the sensor
    assert np.sqrt(np.diagonal(left)) == pytest.approx(np.broadcast_to(expected, 3), rel=1e-6)


def test_thirty_degrees_are_corrected_at_once_by_an_exact_attitude(system):
    """Noise of 1e-6 rad against 0.5 rad: the attitude is right to 1e-6 after one sample, as no sum of angles would be."""
    sensors = noiseless(sensors_in(system))
    deviations = {"position_m": 0.3, "attitude_rad": 0.5, "velocity_m_s": 0.1, "rate_rad_s": 0.1}
    made = filter_of(system, sensors, initial=deviations, process=STILL)
    drive = Drive(system, sensors, made, 0, process=STILL, error=FAR)
    assert np.linalg.norm(drive.error()[:, 3:6], axis=1) == pytest.approx(0.527, abs=1e-3)
    drive.run(0)
    assert np.abs(drive.error()[:, 3:6]).max() < 4e-6
    assert np.abs(drive.error()[:, :3]).max() < 1e-5  # of the position too: levers of 2 m are turned by the attitude first


def test_without_noise_it_converges_to_the_truth(system):
    """Floors of 1e-6 m and rad at 10 Hz for 3 s: rates to 1e-6 / 0.1 s or better."""
    sensors = noiseless(sensors_in(system))
    made = filter_of(system, sensors, process=STILL)
    drive = Drive(system, sensors, made, 1, process=STILL)
    before = np.abs(drive.error()).max()
    drive.run(60)
    assert before > 0.02
    assert np.abs(drive.error()).max() < 1e-5


def test_late_samples_give_the_estimate_of_samples_on_time(system):
    """All camera samples up to 0.8 s, on time or 0.1 to 0.2 s late, under efforts that change: the same to rounding."""
    found = []
    for late in ({}, {"delay_s": 0.1, "delay_jitter_s": 0.1}):
        sensors = sensors_in(system, **late)
        made = filter_of(system, sensors)
        drive = Drive(system, sensors, made, 3)
        shown = drive.truth.measured
        drive.truth.measured = lambda time_s, shown=shown: {
            name: sample._replace(valid=sample.valid and not (name in CAMERA and sample.time_s > 0.81))
            for name, sample in shown(time_s).items()
        }

        def push(time_s, drive=drive):
            drive.estimate.ctrl[:] = drive.truth.data.ctrl[:] = 40.0 * math.sin(9.0 * time_s)

        drive.run(20, push)
        found.append(
            (drive.estimate.qpos.copy(), drive.estimate.qvel.copy(), made.covariance("b"), made.covariance("robot"))
        )
    for on_time, late in zip(*found, strict=True):
        assert np.abs(on_time - late).max() < 1e-12


def test_a_turned_and_boosted_scene_has_the_same_errors(system):
    """The same measurements in a frame that is turned, shifted and moves: the estimate moves with it, to rounding."""
    sensors = sensors_in(system)
    first, second = filter_of(system, sensors), filter_of(system, sensors)
    drive = Drive(system, sensors, first, 5)
    turn, shift, boost = np.array([0.5, 0.1, -0.7, 0.3]), np.array([3.0, -2.0, 1.0]), np.array([0.7, 0.2, -0.4])
    turn /= np.linalg.norm(turn)

    def turned(vector):
        made = np.empty(3)
        mujoco.mju_rotVecQuat(made, np.asarray(vector, dtype=float), turn)
        return made

    def attitude(quaternion):
        made = np.empty(4)
        mujoco.mju_mulQuat(made, turn, quaternion)
        return made

    def elsewhere(data, time_s):
        made = mujoco.MjData(system.mj)
        for tree in system.trees:
            joint = tree.joints[0]
            pose, twist = data.qpos[joint.qpos], data.qvel[joint.dofs]
            made.qpos[joint.qpos] = np.concatenate((turned(pose[:3]) + shift + boost * time_s, attitude(pose[3:])))
            made.qvel[joint.dofs] = np.concatenate((turned(twist[:3]) + boost, twist[3:]))
        return made

    other = elsewhere(drive.estimate, 0.0)
    second.start(other)

    def follow(time_s):
        measured = drive.truth.measured(time_s)
        place, stars = measured["robot/place"], measured["robot/stars"]
        measured["robot/place"] = place._replace(value=turned(place.value) + shift + boost * place.time_s)
        measured["robot/stars"] = stars._replace(value=attitude(stars.value))
        second.update(time_s, measured, (), other)

    drive.run(20, follow)
    # Rounding of 1e-16 of some metres, through 20 updates.
    assert np.abs(error_of(system, elsewhere(drive.estimate, 1.0), other)).max() < 1e-12
    assert np.abs(error_of(system, drive.estimate, other)).max() > 1.0


def test_what_others_set_in_the_estimate_stays_when_samples_come_late(system):
    """As by an estimator around it: the state of the last call stands, uncertain as at first, whatever comes late."""
    sensors = sensors_in(system, delay_s=0.1)
    made = filter_of(system, sensors, process=STILL)
    drive = Drive(system, sensors, made, 0, process=STILL)
    body = system.trees[1].joints[0]

    def hold(_):
        drive.estimate.qpos[body.qpos], drive.estimate.qvel[body.dofs] = (9.0, 8.0, 7.0, 1.0, 0.0, 0.0, 0.0), 0.0

    shown = drive.truth.measured
    drive.truth.measured = lambda time_s: {
        name: sample._replace(valid=sample.valid and (name != "sees" or sample.time_s < 0.35))
        for name, sample in shown(time_s).items()
    }
    drive.run(8, hold)  # the last camera sample is of 0.3 s and arrives at 0.4 s
    made.update(0.4, drive.truth.measured(0.4), (), drive.estimate)
    expected = np.diag(np.repeat(list(INITIAL.values()), 3) ** 2)
    assert np.abs(made.covariance("b") - expected).max() < 1e-15
    assert drive.estimate.qpos[body.qpos][:3] == pytest.approx((9.0, 8.0, 7.0))


def test_an_impact_that_it_is_told_of_adds_to_the_variances_of_velocities(system):
    """Of the bodies whose geoms met, or of all where none is named; of an event without a jump nothing."""
    sensors = sensors_in(system)
    made = filter_of(system, sensors, impact_velocity_m_s=0.3, impact_rate_rad_s=0.4)
    hit = SimpleNamespace(time_s=0.0, energy_before_J={}, geoms=("b/b",))
    for event, bodies in (
        (hit, {"b"}),
        (SimpleNamespace(time_s=0.0, energy_before_J={}), {"robot", "b"}),
        (SimpleNamespace(time_s=0.0), set()),
    ):
        drive = Drive(system, sensors, made, 0)
        drive.run(0)
        before = {name: made.covariance(name) for name in ("robot", "b")}
        drive = Drive(system, sensors, made, 0)
        drive.run(0, events=[event])
        added = {name: np.diagonal(made.covariance(name) - before[name]) for name in before}
        for name, variances in added.items():
            expected = np.repeat((0.0, 0.0, 0.3**2, 0.4**2), 3) * (name in bodies)
            assert variances == pytest.approx(expected, abs=1e-15)


def test_a_gate_leaves_out_what_is_improbable(system):
    """A camera that jumps by 1 m, 200 standard deviations: rejected and reported; without a gate the estimate follows."""
    errors = []
    for gate in (0.9999, None):
        sensors = sensors_in(system)
        made = filter_of(system, sensors, gate=gate)
        drive = Drive(system, sensors, made, 2)
        shown, rejected = drive.truth.measured, []
        drive.truth.measured = lambda time_s, shown=shown: {
            name: sample._replace(value=sample.value + 1.0 * (name == "sees" and abs(sample.time_s - 1.0) < 1e-9))
            for name, sample in shown(time_s).items()
        }
        drive.run(20, lambda _, made=made, rejected=rejected: rejected.append(made.telemetry()[2]))
        errors.append(np.abs(drive.error()[1, :3]).max())
        assert sum(rejected) == (gate is not None)
    assert errors[0] < 0.03
    assert errors[1] > 0.1


def test_a_bias_of_the_gyro_is_found(system):
    """0.02 rad/s, 20 times the noise: found within five of the standard deviations that the filter states."""
    sensors = sensors_in(system)
    bias = np.array([0.02, -0.01, 0.015])
    sensors["robot/gyro"].bias[:] = bias
    made = filter_of(system, sensors, gyro_bias_rad_s=0.02)
    Drive(system, sensors, made, 0).run(60)
    signals = [signal.name for signal in made.telemetry_signals]
    told = dict(zip(signals, made.telemetry(), strict=True))
    for axis, true in zip("xyz", bias, strict=True):
        sigma = told[f"sigma_bias_robot_gyro_{axis}_rad_s"]
        assert sigma < 0.002
        assert abs(told[f"bias_robot_gyro_{axis}_rad_s"] - true) < 5 * sigma


def test_nothing_that_is_measured_or_not_gives_nan(system):
    """Before the first arrival, with samples that are not valid, with certainty, and with no idea at all."""
    none = {name: rated(np.full(sensor.size, math.nan), math.nan, False) for name, sensor in sensors_in(system).items()}
    for deviation in (0.0, 1e6):
        initial = dict.fromkeys(("position_m", "attitude_rad", "velocity_m_s", "rate_rad_s"), deviation)
        sensors = noiseless(sensors_in(system))
        made = filter_of(system, sensors, initial=initial, process=STILL, floor={"position_m": 1e-12})
        drive = Drive(system, sensors, made, 0, process=STILL, error=np.zeros(24))
        made.update(0.0, none, (), drive.estimate)
        drive.run(10)
        assert np.isfinite(np.concatenate((drive.estimate.qpos, drive.estimate.qvel, made.telemetry()[3:]))).all()
        assert np.linalg.eigvalsh(made.covariance("b")).min() > -1e-9


@pytest.mark.parametrize(
    ("left_out", "words"),
    [
        ({"robot/place", "sees"}, r"(?s)position of 'robot': .*<framepos> of it.*position of 'b'"),
        ({"turned"}, r"attitude of 'b': .*<framequat> of it, relative to the world or to another body"),
    ],
)
def test_a_filter_without_what_it_needs_names_body_and_measurement(system, left_out, words):
    sensors = {name: sensor for name, sensor in sensors_in(system).items() if name not in left_out}
    with pytest.raises(ScenarioFaults, match=words):
        filter_of(system, sensors)


def test_unknown_names_are_refused(system):
    sensors = sensors_in(system)
    for config, words in (({"bodies": {"c": {}}}, "'c'.*b, robot"), ({"noise": {"seen": 0.1}}, "'seen'.*sees")):
        with pytest.raises(ScenarioFaults, match=words):
            filter_of(system, sensors, **config)
