"""The law ``detumble``: closed forms, conservation, frames, saturation and thrusters, load of the grasp, bad input."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.controllers.detumbling import JETS, ORTHOGONAL, POSE, PYRAMID, RATES, SPIN, detumbled, left, spacecraft
from tests.scenes import HEAD, ball, scene

WHEELS = {"wheels": ["wheel_0", "wheel_1", "wheel_2"], "rate_1_s": 1.0}
FINAL = 20.0


def test_one_wheel_and_a_rigid_hub_have_the_closed_form(tmp_path):
    """About its axis L_r falls by (1 - k dt) a tick, exactly: wheel I_a thetadot = L (1 - (1 - k dt)^n), hub the rest.

    The wheel's acceleration is constant through a tick and the axis does not move, so RK4 has no truncation error; what is
    left are 250 roundings of 1e-16 of L.
    """
    initial = {"rates": {"base": [0.0, 0.0, 0.0, 0.0, 0.0, 0.4]}}
    robot = spacecraft([[0.0, 0.0, 1.0]], arm=False)
    run = detumbled(tmp_path, {"wheels": ["wheel_0"], "rate_1_s": 0.7}, robot=robot, duration_s=5.0, initial=initial)
    # The wheel's centre is on the axis, its inertia about it part of the hub's.
    L = (3.0 + SPIN) * 0.4
    kept = (1.0 - 0.7 * 0.02) ** 250
    assert run["state.v_robot_wheel_0_rad_s"][-1] == pytest.approx(L * (1.0 - kept) / SPIN, rel=1e-12)
    assert run.qvel[-1, 5] == pytest.approx(0.4 * kept, rel=1e-11)
    assert left(run) == pytest.approx(L * kept, rel=1e-11)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("axes", [ORTHOGONAL, PYRAMID], ids=["orthogonal", "pyramid"])
def test_the_stack_comes_to_rest_and_its_wheels_have_its_momentum(tmp_path, axes):
    """In a turned and moving frame; L falls as exp(-k t) from 1 N m s to 2e-9, and h of the wheels is L to that."""
    names = [f"wheel_{i}" for i in range(len(axes))]
    run = detumbled(tmp_path, WHEELS | {"wheels": names}, robot=spacecraft(axes))
    found = ffsm_mj.angular_momentum(run)
    assert left(run) < 1e-8
    np.testing.assert_allclose(found["subsystems"]["wheels"]["after_N_m_s"], found["initial_N_m_s"], atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(run.qvel[-1, 3:6]), 0.0, atol=1e-8)
    # The path through time is that of the law: (1 - k dt)^n, to the order of the held torque while the hub turns.
    share = run["controller.stack_momentum_N_m_s"]
    assert share[100] / share[0] == pytest.approx((1.0 - 0.02) ** 100, rel=0.02)
    assert all(check.passes for check in all_checks(run))
    assert found["residual_N_m_s"] < 1e-10  # truncation of RK4 in 20 ms, as in the balance


def test_boosted_and_turned_scenes_do_the_same(tmp_path):
    """Rates of wheels and joint are those of the scene turned and boosted, to rounding that the motion amplifies: 1e-9."""
    turn = np.array([0.3, -0.5, 0.1, 0.8])
    turn /= np.linalg.norm(turn)
    pose, turned, velocity = np.array(POSE), np.empty(4), np.empty(3)
    mujoco.mju_mulQuat(turned, turn, pose[3:])
    mujoco.mju_rotVecQuat(velocity, np.array(RATES[:3]), turn)
    other = {
        "joints": {"base": [7.0, -3.0, 2.0, *turned.tolist()]},
        "rates": {"base": [*(velocity + np.array([3.0, -2.0, 5.0])).tolist(), *RATES[3:]]},
    }
    one, two = (tmp_path / name for name in ("one", "two"))
    one.mkdir()
    two.mkdir()
    first = detumbled(one, WHEELS, duration_s=4.0)
    second = detumbled(two, WHEELS, duration_s=4.0, initial=other)
    np.testing.assert_allclose(second.qvel[:, 3:10], first.qvel[:, 3:10], atol=1e-9)


def test_the_arm_alone_changes_no_angular_momentum(tmp_path):
    """Without wheels and thrusters L is constant whatever the arm does, and the run says so."""
    run = detumbled(tmp_path, {"arm": {"positions": [1.2], "over_s": 3.0}}, duration_s=5.0)
    found = ffsm_mj.angular_momentum(run)
    np.testing.assert_allclose(found["final_N_m_s"], found["initial_N_m_s"], atol=1e-12)
    assert run.qpos[-1, 10] == pytest.approx(1.2, abs=0.02)
    assert "no wheels and no thrusters" in run.summary()["controller"]["phases"][0]["reports"]["note"]
    # Wheels without power turn against the hub by what the joint does to it, I_a / I = 1e-2 of L at most.
    assert left(run) == pytest.approx(np.linalg.norm(found["initial_N_m_s"]), rel=1e-2)


def test_the_arm_is_folded_while_the_stack_comes_to_rest(tmp_path):
    run = detumbled(tmp_path, WHEELS | {"arm": {"positions": [-1.0], "over_s": 6.0}})
    assert run.qpos[-1, 10] == pytest.approx(-1.0, abs=1e-6)
    assert left(run) < 1e-8


SLOW = {f"wheel_{i}": {"kind": "reaction_wheel", "max_torque_N_m": 0.5, "max_speed_rad_s": 20.0} for i in range(3)}


def test_saturated_wheels_without_thrusters_keep_what_they_can_and_say_so(tmp_path):
    """Each wheel holds at most I_a x 20 rad/s; the rest stays, and total L is conserved."""
    run = detumbled(tmp_path, WHEELS, actuators=SLOW)
    reports = run.summary()["controller"]["phases"][0]["reports"]
    assert "saturated" in reports["note"]
    assert left(run) > 0.1
    assert np.abs(run.qvel[:, 6:9]).max() <= 20.0 * (1.0 + 1e-3)
    found = ffsm_mj.angular_momentum(run)
    np.testing.assert_allclose(found["final_N_m_s"], found["initial_N_m_s"], atol=1e-11)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["ideal", "on_off"])
def test_thrusters_take_over_from_saturated_wheels_without_net_force(tmp_path, kind):
    """Wheels end at most at the share to which they are unloaded, plus what they take up last; couples move nothing.

    What on-off jets leave is taken by the wheels, so the end is as exact as without thrusters.
    """
    jet = {"kind": "on_off", "force_N": 0.5, "threshold_N": 0.2} if kind == "on_off" else {"kind": "ideal"}
    law = WHEELS | {"thrusters": JETS, "unload_to": 0.7}
    run = detumbled(
        tmp_path, law, robot=spacecraft(jets="couples"), duration_s=60.0, actuators=SLOW | dict.fromkeys(JETS, jet)
    )
    found = ffsm_mj.angular_momentum(run)
    assert left(run) < 1e-7
    assert np.linalg.norm(found["external_N_m_s"]) > 0.1
    assert found["residual_N_m_s"] < 1e-7  # truncation of RK4 in 20 ms, as in the balance
    total = sum((np.array(each["taken_N_m_s"]) for each in found["actuators"].values() if each["kind"] == "external"), 0.0)
    np.testing.assert_allclose(total, found["external_N_m_s"], atol=1e-4)  # trapezoids of 20 ms
    robot = run.log.rows[:, run.log.header.layout.places(f"momentum.robot_P_{axis}_N_s" for axis in "xyz")]
    np.testing.assert_allclose(robot[-1], robot[0], atol=1e-9)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("jets", [False, True])
def test_what_no_wheel_has_an_axis_for_is_left_to_the_thrusters(tmp_path, jets):
    """One wheel takes its part; the rest stays and is told of, or goes out by proportional jets, to less than 1e-6."""
    law = {"wheels": ["wheel_1"], "rate_1_s": 1.0} | ({"thrusters": JETS} if jets else {})
    run = detumbled(tmp_path, law, robot=spacecraft(jets="couples"), duration_s=20.0)
    note = run.summary()["controller"]["phases"][0]["reports"].get("note", "")
    assert ("no wheel has an axis" in note) != jets
    assert (left(run) < 1e-6) == jets


def test_a_single_jet_drifts_and_the_ledger_has_its_share(tmp_path):
    """One jet is no couple: P changes, and the angular impulse of the log is its moment about the moving centre of mass."""
    run = detumbled(
        tmp_path, {"thrusters": ["jet"], "rate_1_s": 1.0}, robot=spacecraft(jets="alone"), duration_s=3.0,
        actuators={"jet": {"kind": "on_off", "force_N": 0.5}},
        initial={"rates": {"base": [0, 0, 0, 0, 0, -0.3]}},
    )  # fmt: skip
    found = ffsm_mj.angular_momentum(run)
    assert left(run) < np.linalg.norm(found["initial_N_m_s"])
    assert found["residual_N_m_s"] < 1e-8
    np.testing.assert_allclose(found["actuators"]["robot_jet"]["taken_N_m_s"], found["external_N_m_s"], atol=1e-6)


def test_replay_agrees_and_the_end_is_a_check(tmp_path):
    """The check of the last state is the same from the log; with a bound below what is left it fails."""
    bound = {"terminal": {"stack_momentum_N_m_s": 1e-3}}
    run = detumbled(tmp_path, WHEELS, duration_s=4.0, **bound)
    (check,) = [each for each in all_checks(run) if each.name == "stack momentum at the end"]
    assert not check.passes
    assert check.residual == pytest.approx(left(run), rel=1e-12)
    again = replay_log(run.log)
    assert again.agrees
    (same,) = [each for each in again.checks() if each.name == check.name]
    assert same.residual == pytest.approx(check.residual, rel=1e-12)
    assert {each.name for each in again.checks() if not each.passes} == {check.name}


def test_a_phase_ends_when_the_law_has_finished_or_by_the_momentum(tmp_path):
    law = {"kind": "detumble", **WHEELS, "tolerance_N_m_s": 1e-2}
    for end in ({"until": "finished"}, {"stop_when": "stack_momentum < 1e-2 N m s"}):
        phases = [{"name": "one", "controller": law, **end}, {"name": "two", "until": "end", "controller": {"kind": "off"}}]
        run = detumbled(tmp_path, {}, duration_s=8.0, phases=phases)
        start = run.phases[1].start_s
        row = int(np.searchsorted(run.time, start - 1e-9))
        before = run["controller.stack_momentum_N_m_s"][row - 1]
        assert before == pytest.approx(1e-2, rel=0.05)
        assert left(run) < 1.1e-2


def test_on_estimates_it_settles_to_the_noise_of_the_gyro(tmp_path):
    """L is known to the inertia times the noise of the gyro, 1e-3 rad/s; with k dt = 0.02 less of it is left in L."""
    sensors = '<sensor><gyro name="gyro" site="imu"/><framequat name="stars" objtype="site" objname="imu"/></sensor>'
    robot = spacecraft(arm=False).replace("<actuator>", f"{sensors}<actuator>")
    assert HEAD in robot
    robot = robot.replace('<geom name="hub"', '<site name="imu"/><geom name="hub"')
    run = detumbled(tmp_path, WHEELS, robot=robot, sensors={"gyro": {"noise": 1e-3}}, estimator={"kind": "direct"}, seed=3)
    inertia, noise = 3.0, 1e-3
    settled = run["controller.stack_momentum_N_m_s"][500:]
    assert 1e-5 < left(run) < inertia * noise
    assert settled.max() < 6.0 * inertia * noise * np.sqrt(3.0)


@pytest.mark.parametrize(
    ("law", "where", "words"),
    [
        ({"wheels": ["shoulder"]}, "wheels.0", "drives no rotor: the centre of mass of 'robot/link' is 0.3 m off the axis"),
        ({"wheels": ["whel_0"]}, "wheels.0", "did you mean"),
        ({"wheels": ["wheel_0", "wheel_0"]}, "wheels.1", "twice"),
        ({"thrusters": ["jet"]}, "thrusters.0", "jet"),
        ({"wheels": ["wheel_0"], "rate_1_s": 50.0}, "rate_1_s", "stable below 50"),
        ({"arm": {"bandwidth_rad_s": 60.0}}, "arm.bandwidth_rad_s", "stable below 50"),
        ({"arm": {"positions": [1.0, 2.0], "over_s": 1.0}}, "arm.positions", "2 values for 1 joint"),
        ({"arm": {"positions": [1.0]}}, "arm", "go together"),
        ({"arm": {"null_space": True}}, "arm", "needs 'positions'"),
        ({"arm": {"joints": ["elbow"]}}, "arm.joints.0", "elbow"),
        ({"latch": {}}, "latch", "needs one at least"),
        ({"unload_to": 1.0}, "unload_to", "less than 1"),
    ],
)
def test_bad_input_is_one_line(tmp_path, law, where, words):
    with pytest.raises(InputError) as caught:
        detumbled(tmp_path, law)
    (line,) = caught.value.lines
    assert f"phases.0.controller.{where}" in line
    assert words in line


WHEEL = '<joint name="wheel_0" axis="1.0 0.0 0.0"/>'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (WHEEL, WHEEL.replace("/>", ' range="-9 9"/>'), "its hinge has limits (range)"),
        (WHEEL, WHEEL.replace("/>", ' type="slide"/>'), "its joint is a slide, not a hinge"),
        (WHEEL, f'{WHEEL}<joint name="tilt"/>', "the body 'robot/wheel_0' has 2 joints, not one"),
        (WHEEL, f'{WHEEL}<body name="flag"><geom size="1"/></body>', "'robot/wheel_0' carries another one, 'robot/flag'"),
        # Inertias 0.012, 0.012 and 0.02: with the axis along one of the equal ones, half their difference over the trace.
        (WHEEL, WHEEL.replace("1.0 0.0 0.0", "0 1 0"), "about the axis is not symmetric, by 0.0909 of its trace"),
        (WHEEL, WHEEL.replace("/>", ' pos="0 0.001 0"/>'), "centre of mass of 'robot/wheel_0' is 0.001 m off the axis"),
    ],
)
def test_a_wheel_that_is_none_is_told_why(tmp_path, old, new, words):
    """Each condition of a rotor alone."""
    robot = spacecraft()
    assert old in robot
    with pytest.raises(InputError) as caught:
        detumbled(tmp_path, {"wheels": ["wheel_0"]}, robot=robot.replace(old, new))
    (line,) = caught.value.lines
    assert "drives no rotor: " in line
    assert words in line
    assert "Joints of rotors: robot/wheel_1, robot/wheel_2" in line


def test_a_share_of_a_load_limit_that_there_is_not_is_refused():
    law = {"kind": "detumble", "latch": {"share": 0.5}}
    with pytest.raises(InputError, match=r"'grasp' has no 'load_limit'"):
        prepare("capture", {"phases.3.controller": law})


TIP = [0.9, 0.0, 0.0]
LIMIT = {"force_N": 2.0, "torque_N_m": 2.0}


def captured(folder, law, *, limit=None):
    """The spinning spacecraft grasps a heavy ball at rest at its tip at t = 0, and detumbles the stack for 25 s."""
    grasp = {"robot_site": "tip", "object_site": "rock/centre", "when": {"within": {"position_m": 1e-3}}}
    path = scene(
        folder,
        spacecraft(),
        {"rock": ball("rock", mass=8.0, radius=0.3)},
        duration_s=25.0,
        time_step_s=0.02,
        control_period_s=0.02,
        initial={"joints": {"rock/free": [*TIP, 1.0, 0.0, 0.0, 0.0]}, "rates": {"base": [0, 0, 0, 0.1, -0.25, 0.3]}},
        grasps={"grasp": grasp | ({"load_limit": limit} if limit else {})},
        phases=[{"name": "all", "until": "end", "arm": ["grasp"], "controller": {"kind": "detumble", **law}}],
    )
    return ffsm_mj.run(path)


def load(run):
    """Force and torque of the latch at every row."""
    return (
        np.linalg.norm([run[f"contact.grasp_{what}_{axis}_{unit}"] for axis in "xyz"], axis=0)
        for what, unit in (("force", "N"), ("torque", "N_m"))
    )


@pytest.mark.long
@pytest.mark.parametrize("share", [None, 0.1])
def test_the_latch_bears_no_more_than_its_share(tmp_path, share):
    """The load logged by the plant is below the bound that the law computed by inverse dynamics, and the bound acts.

    Without the explicit share half of the limit is the bound, which nothing comes near to. Efforts are held for 20 ms, in
    which the load changes by less than 1 % of itself.
    """
    run = captured(tmp_path, WHEELS | ({"latch": {"share": share}} if share else {}), limit=LIMIT)
    assert run.grasps[0].release_s is None
    assert left(run) < 1e-6
    force, torque = load(run)
    reports = run.summary()["controller"]["phases"][0]["reports"]
    bound = (share or 0.5) * 2.0
    alone = max(1.0, 1.02 * reports["grasp: largest_load_ratio"])
    assert force.max() <= 1.01 * alone * bound
    assert torque.max() <= 1.01 * alone * bound
    assert (reports["grasp: least_share"] < 1.0) == (share is not None)


def test_motion_in_the_null_space_turns_the_base_less(tmp_path):
    """One joint has no reaction null space: the arm stays where it is, in place of moving to the position."""
    law = {"arm": {"positions": [1.0], "over_s": 4.0}}
    moved = detumbled(tmp_path, law, duration_s=6.0, initial={})
    still = detumbled(tmp_path, {"arm": law["arm"] | {"null_space": True}}, duration_s=6.0, initial={})
    assert abs(moved.qpos[-1, 10]) > 0.9
    assert abs(still.qpos[-1, 10]) < 1e-9
    assert np.abs(still.qpos[:, 4:7]).max() < 1e-9
    assert np.abs(moved.qpos[:, 4:7]).max() > 1e-2


def test_seven_joints_move_without_turning_the_base():
    """Base of ``capture`` at rest, no momentum: W qd = 0 is kept but for the lag of the servo; without it the base turns."""
    found = []
    for null_space in (False, True):
        arm = {"positions": [0.4, -1.0, 0.6, 2.2, 0.1, -0.8, 0.0], "over_s": 6.0, "null_space": null_space}
        run = ffsm_mj.run(
            "capture",
            {
                "actuators": {},
                "grasps": {},
                "duration_s": 8.0,
                "time_step_s": 0.01,
                "initial.joints.satellite/free": [50.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
                "initial.rates": {},
                "phases": [
                    {
                        "name": "all",
                        "until": "end",
                        "controllers": {
                            "arm": {"kind": "detumble", "arm": {"bandwidth_rad_s": 5.0, **arm}},
                            "wheels": {"kind": "hold", "joints": ["wheel_x", "wheel_y", "wheel_z"], "bandwidth_Hz": 1.0},
                        },
                    }
                ],
            },
        )
        assert np.abs(run.qpos[-1, 10:17] - run.qpos[0, 10:17]).max() > 0.1
        found.append(ffsm_mj.base_rotation(run)["largest_rad"])
    turned, kept = found
    assert kept < 0.1 * turned
