"""Boosts, rotations and translations of whole scenes; contacts nobody handles; momentum that wheels exchange."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.scenario.shipped import scenario_path
from tests.conftest import MJCF
from tests.scenes import HEAD, ball, box, compile_paths, scene

# A free base with a bent two-joint arm: off-centre everything, nothing planar.
REACHER = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0.02 -0.03 0.01" mass="6" diaginertia="0.5 0.6 0.7"/>
  <geom name="base" type="box" size="0.2 0.2 0.2" mass="0"/>
  <body name="upper" pos="0.3 0.05 0"><inertial pos="0.25 0 0" mass="1" diaginertia="0.01 0.05 0.05"/>
    <joint name="a" axis="0 0.8 0.6"/>
    <body name="lower" pos="0.5 0 0"><inertial pos="0.2 0 0" mass="0.7" diaginertia="0.01 0.03 0.03"/>
      <joint name="b" axis="0 1 0"/>
      <geom name="finger" type="capsule" fromto="0.1 0 0 0.4 0 0" size="0.04" mass="0"/><site name="tip" pos="0.44 0 0"/>
    </body></body></body></worldbody><actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>"""


def hit(folder, *, shift=(0, 0, 0), boost=(0, 0, 0), turn=(1, 0, 0, 0)):
    """The same collision seen from elsewhere: moved, in motion, rotated. Returns the impact and the last state."""
    q = np.array(turn, dtype=float) / np.linalg.norm(turn)

    def rotated(v):
        out = np.empty(3)
        mujoco.mju_rotVecQuat(out, np.array(v, dtype=float), q)
        return out

    def pose(position, quaternion):
        out = np.empty(4)
        mujoco.mju_mulQuat(out, q, np.array(quaternion, dtype=float) / np.linalg.norm(quaternion))
        return [*(rotated(position) + shift).tolist(), *out.tolist()]

    def twist(linear, angular):  # angular velocity is in body axes: it turns with the body
        return [*(rotated(linear) + boost).tolist(), *angular]

    path = scene(
        folder,
        REACHER,
        {"block": box("block", mass=2.5, half=(0.2, 0.3, 0.25))},
        duration_s=2.0,
        initial={
            "joints": {
                "robot/free": pose((0, 0, 0), (1, 0.1, -0.05, 0.2)),
                "a": 0.3,
                "b": -0.4,
                "block/free": pose((1.65, 0.8, 0.2), (0.9, 0.2, 0.3, -0.1)),
            },
            "rates": {
                "robot/free": twist((0.4, 0.1, 0), (0.05, -0.1, 0.08)),
                "a": 0.2,
                "b": -0.1,
                "block/free": twist((-0.2, 0, 0.01), (0.4, -0.3, 0.5)),
            },
        },
        contacts={
            "rules": [{"between": ["finger", "block/block"], "restitution": 0.9}],
            "ignored": [{"between": ["base", "block/block"], "reason": "they meet only after what is tested"}],
        },
        phases=[{"name": "pd", "until": "end", "controller": {"kind": "pd", "kp": 2.0, "kd": 0.5}}],
    )
    run = ffsm_mj.run(path)
    assert all(check.passes for check in all_checks(run))
    joints = [run[f"state.q_robot_{j}_rad"][-1] for j in "ab"] + [run[f"state.v_robot_{j}_rad_s"][-1] for j in "ab"]
    return run.impacts[0], np.array(joints), rotated


@pytest.mark.long
@pytest.mark.parametrize(
    "view",
    [
        {"shift": (30.0, -20.0, 10.0)},
        {"boost": (1.0, -2.0, 0.5)},
        {"turn": (0.3, -0.5, 0.7, 0.4)},
        {"shift": (-5.0, 8.0, 3.0), "boost": (-0.3, 0.2, 0.9), "turn": (0.8, 0.1, 0.5, -0.2)},
    ],
    ids=["moved", "boosted", "rotated", "all three"],
)
def test_a_collision_looks_the_same_from_everywhere(tmp_path, view):
    """Time, impulse, energy and joint motion agree; normal and point turn and move along.

    RK4 at 1 ms leaves 1e-12; tens of metres cost two digits of the gap, hence 1e-9 in time.
    """
    here, joints, _ = hit(tmp_path)
    there, moved_joints, rotated = hit(tmp_path, **view)
    assert there.time_s == pytest.approx(here.time_s, abs=1e-9)
    assert there.impulse_N_s == pytest.approx(here.impulse_N_s, rel=1e-8)
    assert there.energy_change_J == pytest.approx(here.energy_change_J, rel=1e-7)
    np.testing.assert_allclose(there.normal, rotated(here.normal), atol=1e-8)
    expected = rotated(here.point_m) + view.get("shift", 0.0) + np.array(view.get("boost", (0, 0, 0))) * there.time_s
    np.testing.assert_allclose(there.point_m, expected, atol=1e-8)
    np.testing.assert_allclose(moved_joints, joints, atol=1e-7)


def test_contacts_that_nobody_handles_are_reported(tmp_path):
    """A ball flies through an object without a contact rule: start, end and depth are in the summary."""
    path = scene(
        tmp_path,
        ball("ball", joints="x"),
        {"ghost": ball("ghost", joints="x")},
        contacts={"rules": []},
        duration_s=1.0,
        initial={"joints": {"ghost/x": 0.5}, "rates": {"robot/x": 1.0}},
    )
    (contact,) = ffsm_mj.run(path).summary()["unhandled_contacts"]
    assert contact["geoms"] == ["ghost/ghost", "robot/ball"]
    # Radii 0.1 each, 0.5 apart, 1 m/s: from 0.3 s to 0.7 s, seen at the ticks of 1 ms; deepest 0.2 m.
    assert contact["start_s"] == pytest.approx(0.3, abs=0.0011)
    assert contact["end_s"] == pytest.approx(0.7, abs=0.0011)
    assert contact["max_depth_m"] == pytest.approx(0.2, abs=0.002)


def test_a_reaction_wheel_exchanges_momentum(tmp_path):
    """Base at rest, wheel spun up by a held torque: I_base w_base = -I_wheel w_wheel, nothing created, work booked."""
    bus = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="10" diaginertia="1 1 2"/><geom size="0.2" mass="0"/>
      <body name="rotor"><inertial pos="0 0 0" mass="1" diaginertia="0.05 0.05 0.1"/><joint name="wheel" axis="0 0 1"/>
      </body></body></worldbody><actuator><motor name="wheel" joint="wheel"/></actuator></mujoco>"""
    path = scene(
        tmp_path,
        bus,
        {},
        actuators={"wheel": {"kind": "reaction_wheel", "max_torque_N_m": 0.5, "max_speed_rad_s": 4.0}},
        phases=[
            {
                "name": "spin",
                "until": "end",
                "controller": {"kind": "pd", "joints": ["wheel"], "kp": 100.0, "kd": 0.0, "target": [50.0]},
            }
        ],
    )
    run = ffsm_mj.run(path)
    base, wheel = run["state.v_robot_free_wz_rad_s"], run["state.v_robot_wheel_rad_s"]
    # Total L_z = (2 + 0.1) w_base + 0.1 w_wheel = 0.
    np.testing.assert_allclose(2.1 * base, -0.1 * wheel, atol=1e-13)
    # Torque 0.5 N m on the relative inertia 0.1 (1 - 0.1 / 2.1): saturated at 4 rad/s after 0.762 s, held there.
    inertia = 0.1 * (1 - 0.1 / 2.1)
    assert wheel[500] == pytest.approx(0.5 / inertia * 0.5, rel=1e-9)
    assert wheel.max() == pytest.approx(4.0, abs=0.5 / inertia * 0.001 * 1.01)  # it stops within a tick
    assert np.abs(run["momentum.total_L_z_N_m_s"]).max() < 1e-13
    assert run["balance.work_J"][-1] == pytest.approx(run["energy.total_J"][-1], rel=1e-10)
    assert all(check.passes for check in all_checks(run, 1e-12))


@pytest.fixture(scope="module")
def hardware(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hardware") / "run"
    ffsm_mj.run("free-flying-hardware", {"duration_s": 14.0}, out=folder, rerun=False)
    return ffsm_mj.load_run(folder)


@pytest.mark.long
def test_body_fixed_thrusters_stop_the_robot(hardware):
    """After the pause at most one shortest pulse of a pair is left on each axis, of the 1.2 N s that the hit gave.

    On-off thrusters end in a limit cycle whose phase depends on the last digit of everything before; its size does not: two
    jets of 5 N for 20 ms make 0.2 N s.
    """
    k = int(np.argmax(hardware["phase.index"] == 2))
    left = np.hypot(hardware["momentum.robot_P_x_N_s"][k], hardware["momentum.robot_P_y_N_s"][k])
    assert left < np.sqrt(2) * 2 * 5.0 * 0.02
    assert hardware.impacts[0].impulse_N_s > 1.0
    assert all(check.passes for check in all_checks(hardware))


@pytest.mark.long
def test_thruster_log_adds_up(hardware):
    """Impulse is 5 N times on-time; no pulse is shorter than 20 ms; the jets' sum is at least what they took out."""
    total = 0.0
    jets = [key for key in hardware.keys if key.endswith("_on_time_s")]
    assert len(jets) == 8
    for key in jets:
        impulse = hardware[key.replace("on_time_s", "impulse_N_s")]
        np.testing.assert_allclose(impulse, 5.0 * hardware[key], rtol=1e-9)
        applied = hardware[key.replace("on_time_s", "applied_N")] > 0.0
        edges = np.flatnonzero(np.diff(applied.astype(int)))
        for on, off in zip(edges[::2], edges[1::2], strict=False):
            assert hardware.time[off] - hardware.time[on] >= 0.02 - 1.1e-3  # the first pulse starts between two ticks
        total += impulse[-1]
    taken = np.linalg.norm([hardware[f"balance.external_P_{a}_N_s"][-1] for a in "xy"])
    assert total >= taken > 0.9


def test_hardware_robot_is_the_case_study_with_its_wheel_at_rest(case_study):
    """The wheel's 0.5 kg and 0.2 kg m^2 are taken out of the base: same mass matrix of base and arm when it is locked."""
    from ffsm_mj.dynamics.rigid_body import mass_matrix

    hardware = compile_paths(MJCF / "ffsm_3dof_hardware.xml", {"object": MJCF / "box_1m.xml"})
    plain, real = mujoco.MjData(case_study.mj), mujoco.MjData(hardware.mj)
    plain.qpos[:6] = (1, 2, 0.3, 0.4, -0.5, 0.6)
    real.qpos[:7] = (1, 2, 0.3, 7.0, 0.4, -0.5, 0.6)
    mujoco.mj_forward(case_study.mj, plain)
    mujoco.mj_forward(hardware.mj, real)
    keep = [0, 1, 2, 4, 5, 6]
    M = mass_matrix(hardware.mj, real)[np.ix_(keep, keep)]
    np.testing.assert_allclose(M, mass_matrix(case_study.mj, plain)[:6, :6], atol=1e-12)


@pytest.mark.long
def test_spatial_scenario():
    """The tumbling satellite is hit, the spacecraft recovers and reaches the point; every law to the shipped tolerance."""
    run = ffsm_mj.run("spatial")
    assert run.outcome == "completed"
    assert len(run.impacts) >= 1
    assert run.unhandled_contacts == ()
    assert run.summary()["tip"]["final_error_m"] < 1e-3
    assert [p.name for p in run.phases] == ["approach", "safety_pause", "recover", "regulate"]
    k = int(np.argmax(run["phase.index"] == 3))
    P = np.array([run[f"momentum.robot_P_{a}_N_s"][k] for a in "xyz"])
    first = np.array([run[f"momentum.robot_P_{a}_N_s"][np.argmax(run["phase.index"] == 2)] for a in "xyz"])
    assert np.linalg.norm(P) < 0.1 * np.linalg.norm(first)
    wheels = [np.abs(run[f"state.v_robot_wheel_{a}_rad_s"]).max() for a in "xyz"]
    assert max(wheels) > 5.0  # they store what the hit left
    for check in all_checks(run):
        assert check.passes, check
    assert scenario_path("spatial").exists()
