"""Magnetorquers: torque m x B against closed forms, in the balance, in every motion; detumbling by B-dot."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.special import ellipj

import ffsm_mj
from ffsm_mj.dynamics.rigid_body import external_actuators
from ffsm_mj.errors import InputError
from ffsm_mj.fields.interface import StrictModel
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.replay import replay_log
from ffsm_mj.report.plots import figures
from tests.contact_models.grasp.scenes import grasping
from tests.fields.test_orbit import failing
from tests.fields.test_sensors_in_orbit import DIPOLE, RATE, elements, igrf_dipole, turn
from tests.laws import Law
from tests.scenes import HEAD, scene
from tests.verification.independent.scenes import changed, independent

FIELD = np.array((1e-5, -2e-5, 4e-5))
UNIFORM = {"magnetic_field": {"kind": "uniform", "field_T": FIELD.tolist()}}
TORQUERS = {
    axis: {"kind": "magnetorquer", "site": "coils", "axis": axis, "max_dipole_A_m2": 50.0} for axis in ("x", "y", "z")
}


def craft(moments=(2.0, 3.0, 4.0), sensors=""):
    """A body of 30 kg with coils; the axes of inertia and of the coils are turned against the body's."""
    return f"""<mujoco>{HEAD}<worldbody><body name="hub"><freejoint name="free"/>
      <inertial pos="0.1 0 0" quat="0.9 0.1 -0.2 0.3" mass="30" diaginertia="{" ".join(map(str, moments))}"/>
      <site name="coils" pos="0.2 0.1 0" euler="20 -30 40"/></body></worldbody><sensor>{sensors}</sensor></mujoco>"""


class Dipoles(Law):
    """Given dipoles from a time on."""

    class Config(StrictModel):
        """Dipoles by axis, A m^2."""

        kind: Literal["dipoles"]
        dipoles: tuple[float, ...]
        names: tuple[str, ...] = ("x", "y", "z")

    def __init__(self, config, context):
        self._ids = [context.system.index("actuator", name) for name in config.names]
        self._dipoles = config.dipoles

    def control(self, observation, command):
        command.effort[self._ids], command.powered[self._ids] = self._dipoles, True


def torqued(folder, dipoles, *, robot="", spin=(0.0, 0.0, 0.0), out=None, **keys):
    """A craft whose law holds dipoles; steps of 0.1 s, 2 s in all."""
    phases = [{"name": "torque", "until": "end", "controller": {"kind": "dipoles", "dipoles": dipoles}}]
    steps = {"time_step_s": 0.1, "control_period_s": 0.1, "duration_s": 2.0}
    initial = {"joints": {"free": [0, 0, 0, 1, 0, 0, 0]}, "rates": {"free": [0, 0, 0, *spin]}}
    keys = steps | {"environment": UNIFORM, "actuators": TORQUERS, "initial": initial, "phases": phases} | keys
    path = scene(folder, robot or craft(), {}, **keys)
    return ffsm_mj.run(path, controllers={"dipoles": Dipoles}, **({"out": out} if out else {}))


def of(run, stem, row=-1, parts="xyz", ending=""):
    return np.array([run[f"{stem}_{part}{ending}"][row] for part in parts])


def about(axis, degrees):
    """Rotation matrix about a coordinate axis."""
    half = np.radians(degrees) / 2.0
    return turn(np.insert(np.sin(half) * np.eye(3)[axis], 0, np.cos(half)))


SITE = about(0, 20) @ about(1, -30) @ about(2, 40)
"""Axes of the coils as columns in axes of the body."""


def test_the_torque_is_m_x_B(tmp_path):
    """Limits too: 80 A m^2 are 50."""
    robot, out = craft(sensors='<gyro name="gyro" site="coils"/>'), tmp_path / "run"
    run = torqued(tmp_path, [3.0, -5.0, 80.0], robot=robot, spin=(0.1, 0.05, -0.08), out=out)
    assert not failing(run)
    for row in (0, 7, -2):
        body = turn(of(run, "state.q_robot_free", row, ("qw", "qx", "qy", "qz")))
        for i, (name, dipole) in enumerate(zip("xyz", (3.0, -5.0, 50.0), strict=True)):
            assert run[f"actuators.{name}_applied_A_m2"][row] == dipole
            torque = of(run, f"actuators.{name}_torque", row, ending="_N_m")
            np.testing.assert_allclose(torque, np.cross(body @ SITE[:, i] * dipole, FIELD), rtol=0.0, atol=1e-17)
    impulse = of(run, "balance.field_on_robot_L", ending="_N_m_s")
    moved = of(run, "momentum.robot_L", ending="_N_m_s") - of(run, "momentum.robot_L", 0, ending="_N_m_s")
    np.testing.assert_allclose(impulse, moved, rtol=0.0, atol=1e-9)
    assert np.linalg.norm(impulse) > 2e-3
    assert replay_log(ffsm_mj.load_run(out).log).agrees
    play = [{"name": "torque", "until": "end", "controller": {"kind": "playback", "file": "run/run.mcap"}}]
    again = torqued(tmp_path, (), robot=robot, spin=(0.1, 0.05, -0.08), phases=play)
    np.testing.assert_array_equal(again["state.q_robot_free_qx"], run["state.q_robot_free_qx"])
    assert independent(run)["field impulse"].passes
    assert "inputs" in figures(run, ["inputs"])
    assert not external_actuators(compile_log(run.log)).any()  # entered as a field, and not again as an actuator
    key = "balance.field_on_robot_L_y_N_m_s"
    assert not independent(changed(run, key, lambda value: value + 1e-7 * run.time))["field impulse"].passes


def compass(folder, step_s, angle=1.0):
    """A dipole of 50 A m^2 in a field of 4e-5 T, both along x but for an angle about z; inertia 0.02 kg m^2, 8 s."""
    steps = {"time_step_s": step_s, "control_period_s": step_s, "duration_s": 8.0}
    robot = f"""<mujoco>{HEAD}<worldbody><body name="hub"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/><site name="coils"/></body></worldbody></mujoco>"""
    folder.mkdir()
    return torqued(
        folder,
        [50.0, 0.0, 0.0],
        robot=robot,
        environment={"magnetic_field": {"kind": "uniform", "field_T": [4e-5, 0.0, 0.0]}},
        initial={"joints": {"free": [0, 0, 0, float(np.cos(angle / 2)), 0, 0, float(np.sin(angle / 2))]}},
        **steps,
    )


def test_a_compass(tmp_path):
    """I a'' = -m B sin a from 1 rad at rest: sin(a/2) = k cd(w t, k), w^2 = 0.1; order 4, and work is that of m . B."""
    k, w = np.sin(0.5), np.sqrt(50.0 * 4e-5 / 0.02)
    _, cn, dn, _ = ellipj(8.0 * w, k * k)
    exact, errors = 2.0 * np.arcsin(k * cn / dn), []
    for step_s in (0.8, 0.4):
        run = compass(tmp_path / f"{step_s}", step_s)
        angle = 2.0 * np.arctan2(run["state.q_robot_free_qz"][-1], run["state.q_robot_free_qw"][-1])
        errors.append(abs(angle - exact))
        work = run["balance.robot_field_work_J"][-1]
        assert work == pytest.approx(2e-3 * (np.cos(angle) - np.cos(1.0)), abs=2e-3 * (w * step_s) ** 4)
    assert not failing(compass(tmp_path / "fine", 0.05))
    assert errors[1] < 1e-5
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4), errors


def test_the_field_is_that_of_each_stage(tmp_path):
    """A heavy body at the origin hardly turns: its angular impulse is m x the integral of B, which turns with the orbit.

    Frozen at the start of each step the field would make this a method of order one.
    """
    heavy = (
        craft((1e12, 1e12, 1e12))
        .replace('pos="0.1 0 0" quat="0.9 0.1 -0.2 0.3"', 'pos="0 0 0"')
        .replace('euler="20 -30 40"', "")
    )
    _, hill = elements(np.radians(25.0))

    def field(time_s):
        place, _ = elements(np.radians(25.0) + RATE * time_s)
        return igrf_dipole(place, 9921.0 + time_s / 86400.0) @ hill

    nodes, weights = np.polynomial.legendre.leggauss(30)
    integral = 1000.0 * sum(w * field(1000.0 * (1.0 + x)) for x, w in zip(nodes, weights, strict=True))
    errors = []
    for step_s in (200.0, 100.0):
        (tmp_path / f"{step_s}").mkdir()
        keys = {"time_step_s": step_s, "control_period_s": step_s, "duration_s": 2000.0, "environment": DIPOLE}
        run = torqued(tmp_path / f"{step_s}", [0, 10.0, 0], robot=heavy, **keys)
        impulse = of(run, "balance.field_on_robot_L", ending="_N_m_s")
        errors.append(np.linalg.norm(impulse - np.cross((0, 10.0, 0), integral)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1), errors


def test_dipoles_that_change_act_from_their_tick_on(tmp_path):
    """A heavy body in a uniform field: the angular impulse is the sum of m x B h, with a delay of half a tick too."""
    dipoles = np.random.default_rng(5).uniform(-40.0, 40.0, (20, 2))
    lines = ["time_s,x_A_m2,y_A_m2", *(f"{0.1 * k!r},{m!r},{n!r}" for k, (m, n) in enumerate(dipoles.tolist()))]
    (tmp_path / "dipoles.csv").write_text("\n".join(lines))
    heavy = craft((1e9, 1e9, 1e9)).replace('quat="0.9 0.1 -0.2 0.3"', "").replace('euler="20 -30 40"', "")
    phases = [{"name": "torque", "until": "end", "controller": {"kind": "playback", "file": "dipoles.csv"}}]
    actuators = {"x": TORQUERS["x"], "y": TORQUERS["y"] | {"delay_s": 0.05}}
    run = torqued(tmp_path, (), robot=heavy, phases=phases, actuators=actuators)
    assert not failing(run)
    total = 0.1 * dipoles.sum(axis=0)
    total[1] -= 0.05 * dipoles[-1, 1]
    impulse = of(run, "balance.field_on_robot_L", ending="_N_m_s")
    np.testing.assert_allclose(impulse, np.cross([*total, 0.0], FIELD), rtol=0.0, atol=1e-15)


def test_magnetorquers_of_arm_and_object_in_a_grasp(tmp_path):
    """A ball with coils is caught by a hand with coils, held and let go; each has its own entries, and a replay agrees."""
    actuators = {
        "hand": {"kind": "magnetorquer", "site": "grip", "axis": "y", "max_dipole_A_m2": 500.0},
        "ball": {"kind": "magnetorquer", "site": "handle", "max_dipole_A_m2": 500.0, "delay_s": 0.0105},
    }
    hold = {"kind": "dipoles", "names": ["hand", "ball"], "dipoles": [300.0, -200.0]}
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": hold},
        {"name": "hold", "for_s": 0.9, "controller": hold | {"dipoles": [-100.0, 400.0]}},
        {"name": "leave", "until": "end", "release": ["grasp"], "controller": hold},
    ]
    steps = {"time_step_s": 2e-3, "control_period_s": 2e-3}
    path = grasping(tmp_path, environment=UNIFORM, actuators=actuators, phases=phases, **steps)
    run = ffsm_mj.run(path, controllers={"dipoles": Dipoles}, out=tmp_path / "run")
    assert not failing(run)
    assert len(run.grasps) == 1
    assert np.linalg.norm(of(run, "balance.field_on_objects_L", ending="_N_m_s")) > 1e-3
    assert np.linalg.norm(of(run, "balance.field_on_robot_L", ending="_N_m_s")) > 1e-3
    again = replay_log(ffsm_mj.load_run(tmp_path / "run").log)
    assert again.agrees
    checks = independent(run)
    assert {name for name, check in checks.items() if not check.passes} == set()
    assert {"field impulse", "grasp load"} <= set(checks)
    rest = ffsm_mj.resume(tmp_path / "run", 1.0, controllers={"dipoles": Dipoles})
    for key in run.keys:
        np.testing.assert_array_equal(rest[key], run[key][-len(rest.time) :], err_msg=key)


def test_a_law_knows_the_torques_that_act(tmp_path):
    """The external field of a control law, in a model of its own with another inertia, has those of the dipoles held."""
    seen = []

    class Looking(Dipoles):
        class Config(Dipoles.Config):
            kind: Literal["looking"]

        def __init__(self, config, context):
            super().__init__(config, context)
            self._field = context.external_field

        def control(self, observation, command):
            force = np.zeros(6)
            self._field.add_to(observation.data, force)
            seen.append(force)
            super().control(observation, command)

    phases = [{"name": "torque", "until": "end", "controller": {"kind": "looking", "dipoles": [3.0, -5.0, 7.0]}}]
    initial = {"joints": {"free": [0, 0, 0, 1, 0, 0, 0]}, "rates": {"free": [0, 0, 0, 0.1, 0.05, -0.08]}}
    path = scene(
        tmp_path,
        craft(),
        {},
        environment=UNIFORM,
        actuators=TORQUERS,
        initial=initial,
        phases=phases,
        controller_model={"robot": {"hub": {"inertia_kg_m2": [2.5, 3.0, 4.0, 0.3, 0.1, -0.2]}}},
        duration_s=0.1,
    )
    run = ffsm_mj.run(path, controllers={"looking": Looking})
    assert not seen[0].any()  # at t = 0 nothing is powered
    body = turn(of(run, "state.q_robot_free", 50, ("qw", "qx", "qy", "qz")))
    torque = body.T @ np.cross(body @ SITE @ (3.0, -5.0, 7.0), FIELD)  # on a free joint in body axes
    np.testing.assert_allclose(seen[50], [0, 0, 0, *torque], rtol=0.0, atol=1e-17)


def test_a_magnetorquer_is_no_thruster(tmp_path):
    law = {"kind": "base_pd", "thrusters": ["x", "y", "z"], "translation": {"kp": 1.0, "kd": 1.0}}
    phases = [{"name": "keep", "until": "end", "controller": law}]
    with pytest.raises(InputError, match=r"controller\.thrusters\.0: x is a magnetorquer"):
        ffsm_mj.run(scene(tmp_path, craft(), {}, environment=UNIFORM, actuators=TORQUERS, phases=phases))


def documented_law():
    """The B-dot law of docs/orbit.md."""
    page = (Path(__file__).parents[2] / "docs/orbit.md").read_text()
    names = {}
    exec(next(block for block in re.findall(r"```py\n(.*?)```", page, re.DOTALL) if "BDot" in block), names)
    return names["BDot"]


def test_detumbling_by_b_dot(tmp_path):
    """A fifth of an orbit: the rate falls to what is along the field; the momentum changes by the impulse of the fields.

    In a uniform field dipoles of -k dB/dt take energy at a rate of k (w x B)^2.
    """
    coils = {f"coil_{axis}": keys for axis, keys in TORQUERS.items()}
    path = scene(
        tmp_path,
        craft(),
        {},
        environment=DIPOLE,
        actuators=coils,
        sensors={"field": {"kind": "magnetometer", "of": "coils", "interval_s": 0.5}},
        initial={"joints": {"free": [0, 0, 0, 1, 0, 0, 0]}, "rates": {"free": [0, 0, 0, 0.1, 0.05, -0.08]}},
        phases=[{"name": "detumble", "until": "end", "controller": {"kind": "b_dot"}}],
        duration_s=1200.0,
        time_step_s=0.25,
        control_period_s=0.5,
    )
    run = ffsm_mj.run(path, controllers={"b_dot": documented_law()})
    assert not failing(run)
    rates = np.linalg.norm([run[f"state.v_robot_free_w{axis}_rad_s"] for axis in "xyz"], axis=0)
    field = SITE @ of(run, "sensor.field_true", ending="_T")
    rate = of(run, "state.v_robot_free", parts=("wx", "wy", "wz"), ending="_rad_s")
    across = np.linalg.norm(np.cross(rate, field)) / np.linalg.norm(field)
    assert rates[600] < 0.35 * rates[0]
    assert rates[-1] < 0.25 * rates[0]
    assert across < 0.05 * rates[0]
    moved = of(run, "momentum.robot_L", ending="_N_m_s") - of(run, "momentum.robot_L", 0, ending="_N_m_s")
    impulse = of(run, "balance.field_on_robot_L", ending="_N_m_s")
    assert np.linalg.norm(impulse) > 0.1
    np.testing.assert_allclose(impulse, moved, rtol=0.0, atol=1e-8)
    assert "Jacobi integral" not in {check.name for check in run.checks()}


BAD = {"kind": "magnetorquer", "site": "coils", "max_dipole_A_m2": 5.0}


@pytest.mark.parametrize(
    ("actuators", "environment", "fault"),
    [
        ({"x": BAD | {"max_dipole_A_m2": 0.0}}, UNIFORM, r"actuators\.x\.max_dipole_A_m2: .*greater than 0"),
        ({"x": BAD | {"max_dipole_A_m2": -3.0}}, UNIFORM, r"actuators\.x\.max_dipole_A_m2: .*greater than 0"),
        ({"x": BAD | {"max_dipole_A_m2": float("nan")}}, UNIFORM, r"actuators\.x\.max_dipole_A_m2"),
        ({"x": BAD | {"site": "coil"}}, UNIFORM, r"actuators\.x\.site: unknown site 'coil' \(did you mean 'robot/coils'"),
        ({"x": BAD | {"axis": "w"}}, UNIFORM, r"actuators\.x\.axis: .*'x', 'y' or 'z'"),
        ({"x": BAD}, {}, r"actuators\.x\.kind: a magnetorquer needs 'environment\.magnetic_field'"),
        ({"robot/push": BAD}, UNIFORM, r"actuators\.robot/push: is an actuator of a model already"),
    ],
)
def test_faults(tmp_path, actuators, environment, fault):
    robot = craft().replace("<sensor>", '<actuator><motor name="push" site="coils" gear="1 0 0 0 0 0"/></actuator><sensor>')
    keys = {"environment": environment} if environment else {}
    with pytest.raises(InputError, match=r"scene\.yaml:1:\d+: .*" + fault):
        ffsm_mj.run(scene(tmp_path, robot, {}, actuators=actuators, **keys))
