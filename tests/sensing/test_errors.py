"""Errors of sensors: their order, their statistics, and that no other sensor and no restart changes them."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError, ScenarioFaults
from ffsm_mj.model.sensors import ModelSensor
from ffsm_mj.sensing.config import SensorConfig
from ffsm_mj.sensing.group import GroupErrors, SampleLayout, SensorGroup
from ffsm_mj.sensing.sensor import NoiseStream, RandomWalk, Sensor, SensorErrors, sensors_of
from tests.scenes import compile_paths
from tests.sensing.scenes import Listener, arm, column, pushing, run


def sensor(folder, kind='<gyro name="s" site="imu"/>', **config) -> Sensor:
    """One sensor with its configuration."""
    (folder / "robot.xml").write_text(arm(kind))
    return sensors_of(compile_paths(folder / "robot.xml"), {"s": SensorConfig(**config)}, 0.01, 10.0)[0]


def test_errors_apply_in_the_order_of_hardware(tmp_path):
    """Misaligned by 90 degrees about z, scaled by 1.5, biased, limited, rounded: each number by hand."""
    made = sensor(
        tmp_path,
        misalignment_rad=[0, 0, math.pi / 2],
        scale_error=0.5,
        bias=[0.1, 0.0, 9.0],
        range=[-2.0, 4.0],
        quantum=0.25,
    )
    # (1, 2, 3) seen from a frame turned by 90 degrees: (2, -1, 3); times 1.5: (3, -1.5, 4.5); with bias (3.1, -1.5, 13.5).
    assert np.allclose(SensorErrors(made, 0).measured(np.array([1.0, 2.0, 3.0]), 0), [3.0, -1.5, 4.0], atol=1e-12)


def test_noise_is_a_function_of_seed_name_and_sample():
    """In any order, from any sample on; another seed or name gives other numbers."""
    forwards = [NoiseStream(7, "robot/gyro", 3).normal(i) for i in range(0, 600, 50)]
    stream = NoiseStream(7, "robot/gyro", 3)
    backwards = [stream.normal(i) for i in reversed(range(0, 600, 50))]
    assert np.array_equal(forwards, backwards[::-1])
    assert not np.any(NoiseStream(8, "robot/gyro", 3).normal(0) == forwards[0])
    assert not np.any(NoiseStream(7, "robot/gyro_2", 3).normal(0) == forwards[0])


def test_another_sensor_moves_no_noise(tmp_path):
    """Its own columns are the same numbers with and without others beside it, in another order, and with dropouts."""
    runs = []
    for i, (sensors, configs) in enumerate(
        (
            ('<jointpos name="e" joint="j1" noise="0.01"/>', {}),
            ('<gyro name="g" site="imu" noise="1"/><jointpos name="e" joint="j1" noise="0.01"/>', {"g": {"dropout": 0.5}}),
        )
    ):
        folder = tmp_path / str(i)
        folder.mkdir()
        runs.append(run(pushing(folder, robot=arm(sensors), sensors=configs, duration_s=0.1, seed=3)))
    noise = [column(r, "sensor.robot_e_rad") - column(r, "sensor.robot_e_true_rad") for r in runs]
    assert np.array_equal(noise[0], noise[1])
    assert 0.002 < noise[0].std() < 0.03


def test_white_noise_and_a_quantiser_have_their_moments(tmp_path):
    """4096 samples of three components. The standard error of a variance is sqrt(2 / n), 1.3 %: bounds are four of them."""
    noisy, fine = sensor(tmp_path, noise=0.2), sensor(tmp_path, quantum=0.01)
    errors = SensorErrors(noisy, 1)
    values = np.array([errors.measured(np.zeros(3), i) for i in range(4096)])
    assert abs(values.mean()) < 4.0 * 0.2 / math.sqrt(values.size)
    assert values.var() == pytest.approx(0.04, rel=4.0 * math.sqrt(2.0 / values.size))
    ramp = np.linspace(0.0, 1.0, 4096 * 3).reshape(-1, 3)
    rounded = SensorErrors(fine, 1)
    off = np.array([rounded.measured(value, i) - value for i, value in enumerate(ramp)])
    assert np.abs(off).max() <= 0.005 + 1e-15
    assert off.var() == pytest.approx(0.01**2 / 12.0, rel=0.01)  # uniform


def test_a_bias_walks_as_the_square_root_of_time():
    """Variance of 300 walks after 100 samples: 100, within four standard errors sqrt(2 / 300)."""
    ends = [RandomWalk(NoiseStream(seed, "w", 1), 1).at(100)[0] for seed in range(300)]
    assert np.var(ends) == pytest.approx(100.0, rel=4.0 * math.sqrt(2.0 / 300))
    walk = RandomWalk(NoiseStream(1, "w", 1), 1)
    assert walk.at(50) != walk.at(40)  # and back
    assert walk.at(50) == RandomWalk(NoiseStream(1, "w", 1), 1).at(50)


def test_an_orientation_is_turned_by_its_noise(tmp_path):
    made = sensor(tmp_path, '<framequat name="s" objtype="site" objname="imu"/>', noise=0.01)
    errors, turns = SensorErrors(made, 2), []
    for i in range(1000):
        measured, turn = errors.measured(np.array([1.0, 0, 0, 0]), i), np.empty(3)
        assert np.linalg.norm(measured) == pytest.approx(1.0, abs=1e-15)
        mujoco.mju_quat2Vel(turn, measured, 1.0)
        turns.append(turn)
    assert np.std(turns) == pytest.approx(0.01, rel=4.0 * math.sqrt(0.5 / 3000))


def test_samples_that_overtake_and_samples_that_never_arrive(tmp_path):
    """With a jitter of ten intervals the newest sample is shown, however late older ones come; with dropout 1 none is."""
    late = SensorGroup([sensor(tmp_path, interval_s=0.01, delay_jitter_s=0.1)], 0)
    times = []
    for tick in range(200):
        late.take(np.full(3, float(tick)))
        late.arrive(0.01 * tick)
        times.append(late.shown[late.layout.times.start] if late.shown is not None else 0.0)
    seen = np.array(times[20:])
    assert (np.diff(seen) >= 0.0).all()
    assert (np.diff(seen) == 0.0).any()
    assert (np.diff(seen) > 0.015).any()
    lost = SensorGroup([sensor(tmp_path, dropout=1.0)], 0)
    lost.take(np.zeros(3))
    assert not lost.arrive(9.0)
    assert lost.shown is None


@pytest.mark.parametrize(
    ("config", "kind", "words"),
    [
        ({"bias": [1, 2]}, "gyro", "bias has 2 numbers; the errors of a <gyro> have 3 components"),
        ({"delay_s": 10.0}, "gyro", "delay_s the first sample would arrive at 10 s, not before the end (10 s)"),
        ({"first_s": 4.0, "delay_s": 6.0}, "gyro", "delay_s the first sample would arrive at 10 s"),
        ({"first_s": 10.0}, "gyro", "first_s the first sample would arrive at 10 s"),
        ({"field_of_view": {"half_angle_rad": 0.5, "site": "imu"}}, "gyro", "only frame sensors see something"),
        ({"field_of_view": {"half_angle_rad": 0.5, "site": "eye"}}, "framepos", "unknown site 'eye'; allowed: robot/imu"),
        ({"quantum": 0.1}, "framequat", "has no meaning for a <framequat>"),
        ({"misalignment_rad": [0, 0, 1]}, "framequat", "only vectors of three components have a frame"),
    ],
)
def test_what_does_not_fit_a_sensor_is_refused(tmp_path, config, kind, words):
    where = 'site="imu"' if kind == "gyro" else 'objtype="site" objname="imu"'
    with pytest.raises(ScenarioFaults) as refused:
        sensor(tmp_path, f'<{kind} name="s" {where}/>', **config)
    fault = refused.value.faults[0]
    assert words in " ".join((*map(str, fault.path[2:]), fault.message))
    assert fault.path[:2] == ("sensors", "s")


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        ({"actuation": {"delay_s": 0.5}}, r"actuation.delay_s: 0.5 s is not shorter than the run \(0.5 s\)"),
        (
            {"actuators": {"m1": {"kind": "ideal", "delay_s": 9.0}}},
            r"actuators.m1.delay_s: 9 s is not shorter than the run",
        ),
        ({"sensors": {"robot/gyro": {"kind": "gyro", "of": "imu"}}}, "sensors.robot/gyro: is a sensor of a model already"),
        ({"sensors": {"robot_gyro": {"kind": "gyro", "of": "imu"}}}, "are both logged as sensor.robot_gyro_x_rad_s"),
    ],
)
def test_delays_beyond_the_run_and_names_that_are_taken_are_refused(tmp_path, scenario, words):
    with pytest.raises(InputError, match=words):
        run(pushing(tmp_path, robot=arm('<gyro name="gyro" site="imu"/>'), **scenario))


def test_check_says_where_a_delay_of_a_file_is_longer_than_the_run(tmp_path):
    path = pushing(tmp_path, robot=arm('<gyro name="gyro" site="imu" delay="9"/>'))
    lines = prepare(path, controllers={"listen": Listener}).describe()
    assert "    robot/gyro: gyro, every 0.01 s, 9 s late, nothing arrives within the run" in lines


def test_an_unknown_kind_is_refused_with_its_line(tmp_path):
    with pytest.raises(InputError, match=r"robot.xml:\d+: sensor 's' is a <insidesite>, which cannot be measured"):
        run(pushing(tmp_path, robot=arm('<insidesite name="s" site="imu" objtype="body" objname="hand"/>')))


def test_an_unknown_kind_in_an_included_file_is_named_there(tmp_path):
    robot = arm('<jointpos joint="j1"/>').replace("</mujoco>", '<include file="more.xml"/></mujoco>')
    kinds = '<jointactuatorfrc joint="j1"/>\n<jointlimitfrc name="s" joint="j1"/>\n<user dim="2"/>'
    (tmp_path / "more.xml").write_text(f"<mujocoinclude><sensor>\n{kinds}\n</sensor></mujocoinclude>")
    with pytest.raises(InputError) as refused:
        run(pushing(tmp_path, robot=robot.replace('name="j1" axis', 'name="j1" range="-1 1" limited="true" axis')))
    assert [line.split(",")[0].rpartition("/")[2] for line in refused.value.lines] == [
        "more.xml:3: sensor 's' is a <jointlimitfrc>",
        "more.xml:4: sensor 'user' is a <user>",
    ]


def test_a_delay_without_a_buffer_counts(tmp_path):
    made = sensor(tmp_path, '<gyro name="s" site="imu" interval="0.02 -0.005" delay="0.1" cutoff="3" noise="0.1"/>')
    assert isinstance(made.model, ModelSensor)
    assert (made.interval_s, made.first_s, made.delay_s, made.high) == (0.02, 0.015, 0.1, 3.0)
    assert made.noise.tolist() == [0.1] * 3


def test_a_group_measures_what_each_sensor_measures(tmp_path):
    """Bit for bit, with every error, together and alone, in any order of the samples."""
    configs = [
        {"noise": 0.1, "bias": [0.1, 0.2, 0.3]},
        {"quantum": 0.125, "scale_error": 0.01},
        {"misalignment_rad": [0.1, 0.2, 0.3], "noise": 0.2},
        {"bias_walk": 0.3, "noise": 0.01},
        {"range": [-0.5, 0.5], "noise_density": 0.01},
    ]
    made = [sensor(tmp_path, **config) for config in configs]
    layout = SampleLayout(made)
    together = GroupErrors(made, 4, layout)
    for number in (0, 1, 255, 256, 300, 3):
        true = np.sin(np.arange(3.0 * len(made)) + number)
        parts = zip(made, np.split(true, len(made)), strict=True)
        alone = [SensorErrors(each, 4).measured(part, number) for each, part in parts]
        given = np.zeros(layout.size)
        given[layout.values] = given[layout.true] = true
        sample = together.sample(given, number)
        assert np.array_equal(sample[layout.values], np.concatenate(alone))
        assert np.array_equal(sample[layout.true], true)
        assert (sample[layout.times] == number * made[0].interval_s).all()
        assert (sample[layout.valid] == 1.0).all()
