"""What is held presses on something: a slab, a third body, the robot's own base; springs push it; pairs as it is let go."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.stages import Smooth
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.balance.exchange import ExchangeIntegrator
from ffsm_mj.contact_models.grasp import loops
from ffsm_mj.contact_models.persistent import closed_contacts
from ffsm_mj.contact_models.persistent.exchange import Shares
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.records.signals import COMPONENTS
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import ARM, OFF, grasping
from tests.contact_models.impact.test_fixed import slab
from tests.laws import Law
from tests.replays import proved
from tests.scenes import ball, scene

pytestmark = pytest.mark.usefixtures("example_contact_models")

PUSH = {"kind": "pd", "joints": ["robot/x"], "kp": 2.0, "kd": 0.5, "target": [3.0]}
HANDLE = np.array((-0.1, 0.01, 0.02))
"""The object's site, in the frame of its base."""
SITES = {"robot_site": "robot/centre", "object_site": "target/centre"}
NEARBY = {
    "joints": {"target/free": [1.08, 0.03, 0.02, 1, 0, 0, 0]},
    "rates": {"robot/free": [0, 0, 0, 0.02, -0.03, 0.05], "target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3]},
}
MASS = {"robot": 2.0, "target": 3.0, "stone": 5.0}


def rail(folder, others, pairs, *, fixed=None, robot=None, **changes):
    """A ball on a rail takes hold of a free one, and pushes it along the rail against something; lets go, and goes on."""
    folder.mkdir(exist_ok=True)
    return scene(
        folder,
        robot or ball("ball", mass=MASS["robot"], joints="x"),
        {"target": ball("target", mass=MASS["target"]), **others},
        fixed=fixed,
        **{
            "duration_s": 0.4,
            "initial": {"joints": {"target/free": [0.2504, 0, 0, 1, 0, 0, 0]}, "rates": {"robot/x": 1.0}},
            "contacts": {"rules": [{"between": ["ball", "target/target"], "restitution": 0.5}, *pairs]},
            "grasps": {"grasp": {**SITES, "when": {"touch": ["ball-target/target"]}}},
            "phases": [
                {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
                {"name": "press", "for_s": 0.3, "controller": PUSH},
                {"name": "leave", "until": "end", "release": ["grasp"], "controller": PUSH},
            ],
        }
        | changes,
    )


def on_a_wall(folder, restitution=0.0, **changes):
    """Against a fixed wall."""
    pair = {"name": "late", "between": ["target/target", "wall/wall"], "restitution": restitution}
    wall = {"wall": slab("wall", "0.1 0.5 0.5")}
    return rail(folder, wall, [pair], fixed={"wall": {"position_m": [0.47, 0, 0]}}, **changes)


def pressed(run):
    """Rows in which the late pair presses while the grasp holds."""
    rows = (run["contact.late_mode"] == 2.0) & (run["contact.grasp_closed"] == 1.0)
    assert rows.sum() > 50
    return rows


def along(run, what, rows):
    """One force in some rows, (n, 3)."""
    return np.column_stack([run[f"contact.{what}_force_{x}_N"] for x in "xyz"])[rows]


def test_the_load_balances_the_wall(tmp_path):
    """Nothing moves: motor, link and wall bear the same force, which changes with nothing but the motor."""
    run = proved(ffsm_mj.run(on_a_wall(tmp_path / "scene", restitution=0.2)))
    rows = pressed(run)
    motor, wall, load = run["actuators.robot_push_x_applied_N"][rows], along(run, "late", rows), along(run, "grasp", rows)
    np.testing.assert_allclose(wall, [[force, 0.0, 0.0] for force in motor], atol=1e-13)  # on the wall
    np.testing.assert_allclose(load, wall, atol=1e-13)
    assert motor.min() > 4.0


def test_the_peak_of_the_load_is_right_after_an_event(tmp_path):
    """Masses and motor say what it is at the capture, between two ticks; the motor pushes ever less from there."""
    run = proved(ffsm_mj.run(on_a_wall(tmp_path / "scene", duration_s=0.06)))
    (capture,), (told,) = run.records["grasp_impulses"], run.grasps
    assert told.peak_s == capture.time_s
    motor = capture.efforts_after["robot/push_x"][0]
    assert motor == pytest.approx(PUSH["kp"] * (3.0 - capture.qpos[0]) - PUSH["kd"] * capture.qvel_after["robot/x"][0])
    share = MASS["target"] / (MASS["robot"] + MASS["target"])
    assert told.peak_force_N == pytest.approx(share * motor, rel=1e-13)
    at_s = run["contact.grasp_event_s"]
    (row,) = np.flatnonzero(np.isfinite(at_s))
    assert (at_s[row], run.time[row - 1] < at_s[row] < run.time[row]) == (told.peak_s, True)
    force = np.linalg.norm(along(run, "grasp", slice(None)), axis=1)
    assert force.max() < told.peak_force_N < force.max() + 0.01
    rows = run.log.rows.copy()
    rows[row, run.log.header.layout.index["contact.grasp_event_force_N"]] += 1e-7
    assert not replay_log(dataclasses.replace(run.log, rows=rows)).agrees


def test_an_impact_on_what_is_held_and_pressed_has_its_load_after(tmp_path):
    """A wall is hit for good: from a share of the motor's force to all of it, at that instant."""
    run = proved(ffsm_mj.run(on_a_wall(tmp_path / "scene", duration_s=0.2)))
    hit = next(impact for impact in run.impacts if impact.pair == "late")
    (row,) = np.flatnonzero(run["contact.grasp_event_s"] == hit.time_s)
    assert run["contact.grasp_event_force_N"][row] == pytest.approx(hit.efforts_after["robot/push_x"][0], rel=1e-12)
    assert run.grasps[0].peak_s == hit.time_s


def test_what_is_let_go_in_touch_stays_closed(tmp_path):
    """Hand and target at gap 0 are a closed pair again, which bears what the grasp bore."""
    run = proved(ffsm_mj.run(on_a_wall(tmp_path / "scene")))
    (capture,) = run.grasps
    begun = [(record.pair, record.time_s) for record in run.records["contact_beginnings"]]
    assert begun[-1] == ("ball-target/target", capture.release_s)
    after = run.time > capture.release_s + 1e-6  # the row at that tick is of before
    motor = run["actuators.robot_push_x_applied_N"][after]
    np.testing.assert_allclose(run["contact.ball_target_target_force_N"][after], motor, atol=1e-13)
    np.testing.assert_allclose(run["contact.late_force_N"][after], motor, atol=1e-13)


@pytest.mark.long
def test_a_log_with_a_hole_is_taken_up_again(tmp_path):
    """Rows are lost while it presses: behind them hand and target, at gap 0 on one rigid body, are no contact."""
    run = ffsm_mj.run(on_a_wall(tmp_path / "scene"))
    first = int(np.flatnonzero(pressed(run))[10])
    rows = np.delete(run.log.rows, slice(first, first + 10), axis=0)
    again = replay_log(dataclasses.replace(run.log, rows=rows))
    assert again.agrees, again.worst


@pytest.mark.long
@pytest.mark.parametrize("down_m_s", [0.3, 0.0, -0.1])
def test_what_lies_on_a_slab_is_taken_up_from_it(tmp_path, down_m_s):
    """The grasp's impulse presses it on, leaves it or lifts it: an impact at the same instant, nothing, an end."""
    pairs = [
        {"between": ["ball", "target/target"], "restitution": 0.5},
        {"name": "late", "between": ["target/target", "wall/wall"], "restitution": 0.3},
    ]
    path = rail(
        tmp_path / "scene",
        {"wall": slab("wall", "2 2 0.1")},
        [],
        robot=ball("ball", mass=MASS["robot"], joints="xz"),
        fixed={"wall": {"position_m": [0, 0, -0.2]}},
        contacts={"rules": pairs},
        initial={"joints": {"robot/x": -0.4, "robot/z": 0.15}, "rates": {"robot/x": 1.0, "robot/z": -down_m_s}},
        grasps={"grasp": {**SITES, "when": {"within": {"position_m": 0.25}}}},
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "until": "end", "controller": OFF},
        ],
    )
    run = proved(ffsm_mj.run(path))
    (capture,), late = run.grasps, [impact.time_s for impact in run.impacts if impact.pair == "late"]
    ended = [record.time_s for record in run.records["contact_endings"]]
    assert ended == ([capture.time_s] if down_m_s else [])
    assert (late[:1] == [capture.time_s]) == (down_m_s > 0.0)


def test_a_third_body_is_pushed_on(tmp_path):
    """Robot, target and stone have one acceleration, motor / sum of masses: the load moves two, the contact one."""
    stone = {"stone": ball("stone", mass=MASS["stone"])}
    pairs = [{"name": "late", "between": ["target/target", "stone/stone"], "restitution": 0.0}]
    initial = {
        "joints": {"target/free": [0.2504, 0, 0, 1, 0, 0, 0], "stone/free": [0.47, 0, 0, 1, 0, 0, 0]},
        "rates": {"robot/x": 1.0},
    }
    run = proved(ffsm_mj.run(rail(tmp_path / "scene", stone, pairs, initial=initial)))
    rows = pressed(run)
    a = run["actuators.robot_push_x_applied_N"][rows] / sum(MASS.values())
    np.testing.assert_allclose(along(run, "late", rows)[:, 0], MASS["stone"] * a, atol=1e-12)
    np.testing.assert_allclose(along(run, "grasp", rows)[:, 0], (MASS["stone"] + MASS["target"]) * a, atol=1e-12)


def sprung(folder, on="wall"):
    """A spring between the target, held and pushed along the rail, and a wall, or a stone that stands beside the rail."""
    spring = {"kind": "spring", "geoms": ["target/target", f"{on}/{on}"], "stiffness_N_m": 300.0}
    changes = {"contact_models": [spring], "time_step_s": 2e-3, "control_period_s": 2e-3, "duration_s": 0.25}
    if on == "wall":
        return rail(
            folder, {"wall": slab("wall", "0.1 0.5 0.5")}, [], fixed={"wall": {"position_m": [0.47, 0, 0]}}, **changes
        )
    joints = {"target/free": [0.2504, 0, 0, 1, 0, 0, 0], "stone/free": [0.47, 0.05, 0, 1, 0, 0, 0]}
    initial = {"joints": joints, "rates": {"robot/x": 1.0}}
    return rail(folder, {"stone": ball("stone", mass=MASS["stone"])}, [], initial=initial, **changes)


@pytest.mark.long
@pytest.mark.parametrize("on", ["wall", "stone"])
def test_a_spring_on_what_is_held_is_no_part_of_the_load(tmp_path, on):
    """The load is what the link bears: mass times acceleration of the object, and what the spring puts on it."""
    run = proved(ffsm_mj.run(sprung(tmp_path / "s", on)))
    rows = (run["contact.spring_force_N"] > 0.1) & (run["contact.grasp_closed"] == 1.0)
    assert rows.sum() > 40
    spring, motor = run["contact.spring_force_N"][rows], run["actuators.robot_push_x_applied_N"][rows]
    if on == "stone":  # it stands beside the rail
        apart = [run[f"state.q_stone_free_{x}_m"][rows] - run[f"state.q_target_free_{x}_m"][rows] for x in "xy"]
        spring = spring * apart[0] / np.hypot(*apart)
    a = (motor - spring) / (MASS["robot"] + MASS["target"])
    np.testing.assert_allclose(along(run, "grasp", rows)[:, 0], MASS["target"] * a + spring, atol=1e-12)


class Lean(Law):
    """A thruster pushes the base ahead while the arm is held stiff."""

    def __init__(self, _, context):
        self._joints = [context.system.joint(name) for name in ("shoulder", "elbow")]

    def control(self, observation, command):
        angles, rates = (
            np.array([array[getattr(joint, which).start] for joint in self._joints])
            for array, which in ((observation.data.qpos, "qpos"), (observation.data.qvel, "dofs"))
        )
        command.drive(slice(None), np.append(-20.0 * angles - 4.0 * rates, 12.0))


def leaning(folder):
    """A tumbling ball is caught and pressed, off centre, on a slab in space by the thrust of the base."""
    robot = ARM.replace('<geom name="hull"', '<site name="nozzle" pos="-0.2 0.01 0.02"/><geom name="hull"').replace(
        "</actuator>", '<motor name="thrust" site="nozzle" gear="1 0 0 0 0 0"/></actuator>'
    )
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "press", "until": "end", "controller": {"kind": "lean"}},
    ]
    pairs = [
        {"between": ["hand", "target/target"], "restitution": 0.5},
        {"name": "late", "between": ["target/target", "wall/wall"], "restitution": 0.2},
    ]
    return grasping(
        folder,
        robot=robot,
        others={"wall": slab("wall", "0.1 2 2")},
        fixed={"wall": {"position_m": [1.3, 0, 0]}},
        initial=NEARBY,
        contacts={"rules": pairs},
        phases=phases,
        duration_s=0.85,
    )


def test_in_space_load_and_slab_give_the_object_its_momentum(tmp_path):
    """P and L about the origin, integrated over the time of pressing by the trapezoidal rule: another way to the same."""
    run = proved(ffsm_mj.run(leaning(tmp_path / "scene"), controllers={"lean": Lean}))
    rows = pressed(run)
    first, last = np.flatnonzero(rows)[[0, -1]]
    assert rows[first : last + 1].all()
    rows = slice(first, last + 1)
    load, contact = along(run, "grasp", rows), -along(run, "late", rows)  # the target is the first of the two
    torque, site, centre = (
        np.column_stack([run[key.format(x)] for x in "xyz"])[rows]
        for key in ("contact.grasp_torque_{}_N_m", "state.q_target_free_{}_m", "contact.late_centre_{}_m")
    )
    attitude = np.column_stack([run[f"state.q_target_free_q{x}"] for x in "wxyz"])[rows]
    for i, quaternion in enumerate(attitude):
        mujoco.mju_rotVecQuat(turned := np.empty(3), HANDLE, quaternion)
        site[i] += turned
    torque += np.cross(site, load) + np.cross(centre, contact)
    wrench = np.column_stack((load + contact, torque))
    momentum = np.column_stack([run[f"momentum.objects_{component}"] for component in COMPONENTS])[rows]
    integral = 1e-3 * (wrench[1:-1].sum(axis=0) + 0.5 * (wrench[0] + wrench[-1]))
    # Torques are held: the wrench of a row is that after the jump at its tick. Half a millisecond of all jumps is at stake.
    at_stake = 0.5e-3 * np.abs(np.diff(wrench, axis=0)).sum(axis=0)
    error = np.abs(integral - (momentum[-1] - momentum[0]))
    assert np.all(error <= 1.1 * at_stake), (error, at_stake)
    assert at_stake.max() < 0.05 * np.abs(0.15 * contact).max()


def hull(folder):
    """The arm folds until the ball that it holds lies on its own base."""
    pairs = [
        {"between": ["hand", "target/target"], "restitution": 0.5},
        {"name": "late", "between": ["hull", "target/target"], "restitution": 0.0},
    ]
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "fold", "for_s": 0.6, "controller": {"kind": "pd", "kp": 3.0, "kd": 0.5, "target": [0.0, 2.9]}},
        {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
    ]
    return grasping(folder, contacts={"rules": pairs}, initial=NEARBY, phases=phases, duration_s=0.75)


def test_what_is_held_lies_on_the_base_of_the_robot(tmp_path):
    """An inner force: it moves no mass centre, and nothing of it is from outside."""
    run = proved(ffsm_mj.run(hull(tmp_path / "scene")))
    rows = pressed(run)
    total = np.column_stack([run[f"momentum.total_{component}"] for component in COMPONENTS])
    assert np.ptp(total[rows], axis=0).max() < 1e-11  # what RK4 leaves in that time; the contact's impulse is 0.1 N s
    assert not any("fixed" in key for key in run.keys)


def judged(run):
    """What is wrong with a run, by its own books and by what its states say with the code that is in now."""
    again = replay_log(run.log)
    laws = {check.name for check in (*all_checks(run), *again.checks()) if not check.passes}
    return laws | (set() if again.agrees else {"log"})


@pytest.mark.long
@pytest.mark.parametrize("wrong", ["booked twice", "not taken off", "stale efforts", "spring booked twice"])
def test_mistakes_on_purpose_are_noticed(tmp_path, monkeypatch, wrong):
    """Of a contact on what is held: its impulse in two books, its force in the load, old efforts."""
    with monkeypatch.context() as patched:
        if wrong == "booked twice":
            of = Shares.of
            patched.setattr(Shares, "of", lambda system, touches, _: of(system, touches, frozenset()))
        elif wrong == "not taken off":
            patched.setattr(PersistentContactModel, "wrenches", lambda *_: ())
        elif wrong == "stale efforts":
            for module in (closed_contacts, loops):
                patched.setattr(module, "Smooth", lambda motion, _: Smooth(motion, motion.data))
        else:
            begin = ExchangeIntegrator.begin
            patched.setattr(ExchangeIntegrator, "begin", lambda self, _: begin(self, frozenset()))
        made_up = sprung if wrong == "spring booked twice" else on_a_wall
        run = ffsm_mj.run(made_up(tmp_path / "scene"))
    assert judged(run)
