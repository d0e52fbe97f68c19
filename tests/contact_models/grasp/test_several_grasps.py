"""Several grasps at once: closed chains, their loads, and what is left as one of them lets go."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.dynamics.rigid_body import momentum_matrix
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import OFF
from tests.contact_models.grasp.two_arms import CLAMP, JOINTS, LEFT, PD, POSE, RATES, RIGHT, holding, plate, robot
from tests.replays import proved
from tests.scenes import scene


def leave(*names, **phase):
    """A phase in which some grasps let go."""
    return {"name": f"leave_{names[0]}", "release": [*names], "controller": OFF, **phase}


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Both arms hold the plate; the left one, which closed first, lets go after half a second."""
    return ffsm_mj.run(holding(tmp_path_factory.mktemp("both")))


def states(run):
    return np.column_stack([run[key] for key in run.log.header.layout.keys if key.startswith("state.")])


def load_on(run, grasp):
    """Force and torque about its site on the object, and the site, (n, 3) each."""
    start, ends = f"contact.grasp_{grasp}_", ("force_{}_N", "torque_{}_N_m", "centre_{}_m")
    return [np.column_stack([run[start + end.format(axis)] for axis in "xyz"]) for end in ends]


def test_a_release_of_one_keeps_the_other(both):
    """The model is that of the other arm's grasp then, a tree again; energy, P and L are kept through the whole."""
    proved(both)
    left, right = both.records["grasp_impulses"]
    assert [(each.grasp, each.place, each.rank, each.mobility) for each in (left, right)] == [
        ("left", 1, 6, 14),  # 6 + 8 joints: the plate is a part of the robot
        ("right", 2, 6, 8),
    ]
    assert [each.release_s for each in both.grasps] == [pytest.approx(0.5, abs=1e-12), None]
    after = both.time > 0.5
    assert not both["contact.grasp_left_closed"][after].any()
    assert np.all(both["contact.grasp_right_closed"][after] == 1.0)
    assert np.all(both["contact.grasp_right_closed"][~after][1:] == 2.0)
    for each in (left, right):
        assert each.energy_change_J == pytest.approx(-each.loss_J, rel=1e-12)
        assert max(each.linear_momentum_change_N_s, each.angular_momentum_change_N_m_s) < 1e-14


def test_the_order_of_grasps_that_close_at_one_instant_does_not_matter(both, tmp_path):
    """Nor which of them makes the plate its child; losses in sum are those of one projection onto all rows."""
    phases = [
        {"name": "hold", "for_s": 0.5, "arm": ["left", "right"], "controller": PD},
        leave("left", until="end"),
    ]
    other = ffsm_mj.run(holding(tmp_path, {"right": RIGHT, "left": LEFT}, phases))
    # Stage errors of order four at 2 ms, and rounding of 400 steps, are the same in both models to 1e-12.
    np.testing.assert_allclose(states(other), states(both), rtol=0, atol=1e-12)
    losses = [sum(record.loss_J for record in run.records["grasp_impulses"]) for run in (other, both)]
    assert losses[0] == pytest.approx(losses[1], rel=1e-13)


def test_all_that_close_at_one_instant_do_so_before_what_the_first_leads_to(both, tmp_path):
    """The phase ends with the first capture, and the next one disarms the other grasp: it has closed by then."""
    phases = [
        {"name": "take", "until": "grasp", "arm": ["left", "right"], "controller": PD},
        {"name": "hold", "for_s": 0.2, "controller": PD},
        {"name": "again", "until": "end", "arm": ["left"], "controller": PD},
    ]
    run = ffsm_mj.run(holding(tmp_path, phases=phases, duration_s=0.3))
    assert [(each.grasp, each.time_s) for each in run.grasps] == [("left", 0.0), ("right", 0.0)]
    assert not run.records["near_misses"]
    assert len(run.records["armings"]) == 2  # arming a closed grasp does nothing
    same = both.time < 0.2
    np.testing.assert_allclose(states(run)[: same.sum()], states(both)[same], rtol=0, atol=1e-12)


def test_two_touches_at_one_instant_close_both(tmp_path):
    """A plate meets both hands at once: the impact is resolved first, then both latch in one instant."""
    touch = [{"touch": [f"{side}_hand-plate/plate"]} for side in ("left", "right")]
    rigid = dict.fromkeys(JOINTS, 0.0)
    initial = {"joints": {"plate/free": [1.8, 0, 0, 1, 0, 0, 0], **rigid}, "rates": {"plate/free": [-0.3, 0, 0, 0, 0, 0]}}
    rules = {"rules": [{"between": [f"{side}_hand", "plate/plate"], "restitution": 0.5} for side in ("left", "right")]}
    grasps = {"left": LEFT | {"when": touch[0]}, "right": RIGHT | {"when": touch[1]}}
    phases = [{"name": "meet", "until": "grasp", "arm": ["left", "right"], "controller": OFF}]
    phases += [{"name": "hold", "until": "end", "controller": OFF}]
    wide = plate().replace('size="0.1 0.25 0.05"', 'size="0.1 0.35 0.05"').replace('pos="0.03 0.02 0"', 'pos="0.03 0 0"')
    run = proved(
        ffsm_mj.run(
            holding(
                tmp_path,
                grasps,
                phases,
                {"plate": wide},
                initial=initial,
                contacts=rules,
                duration_s=1.2,
            )
        )
    )
    assert len({record.time_s for record in (*run.impacts, *run.records["grasp_impulses"])}) == 1
    assert sorted(each.grasp for each in run.grasps) == ["left", "right"]


def test_an_estimator_of_one_grasp_says_so(tmp_path):
    sites, kinds = ("robot/clamp", "plate/to_clamp"), ("framepos", "framequat")
    sensors = {f"{of.partition('/')[0]}_{kind}": {"kind": kind, "of": of} for of in sites for kind in kinds}
    run = ffsm_mj.run(holding(tmp_path, estimator={"kind": "mekf"}, sensors=sensors), check=False)
    assert run.outcome == "controller_failed"
    assert "the grasp 'right' closes while another is closed: kind mekf knows one at a time" in run.message


def test_loads_are_what_moves_the_plate(tmp_path):
    """Both forces and moments give the rate of change of its momentum, by differences of order four at 2 ms."""
    coast = [{"name": "coast", "until": "end", "arm": ["left", "right"], "controller": OFF}]
    run = ffsm_mj.run(holding(tmp_path, phases=coast, duration_s=0.1, control_period_s=2e-3))
    system = prepare(holding(tmp_path, phases=coast)).system
    data, of_plate = mujoco.MjData(system.mj), []
    first = run.log.header.layout.keys.index("state.time_s") + 1
    for row in run.log.rows:
        data.qpos[:], data.qvel[:] = np.split(row[first : first + system.mj.nq + system.mj.nv], [system.mj.nq])
        mujoco.mj_forward(system.mj, data)
        of_plate.append(momentum_matrix(system.mj, data, system.objects[0].root) @ data.qvel)
    P = np.array(of_plate)[1:]
    rate = (P[:-4] - 8.0 * P[1:-3] + 8.0 * P[3:-1] - P[4:]) / (12.0 * 2e-3)
    total = np.zeros((len(run.time), 6))
    for grasp in ("left", "right"):
        force, torque, centre = load_on(run, grasp)
        total += np.column_stack((force, torque + np.cross(centre, force)))
    # h^4 / 30 times the fifth derivative: rates of 1/s give 5e-13, of 10/s 5e-8.
    np.testing.assert_allclose(total[3:-2], rate, rtol=0, atol=1e-7)
    assert np.abs(load_on(run, "right")[0][3:]).max() > 0.1


def test_boosted_and_turned(both, tmp_path):
    """The whole scene turned about an axis and boosted moves alike, through both closings and the release."""
    turn, boost = np.array([0.8, 0.36, -0.48, 0.0]), np.array([0.3, -0.2, 0.1])
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, turn)
    R = matrix.reshape(3, 3)

    def pose(place, quaternion):
        turned = np.empty(4)
        mujoco.mju_mulQuat(turned, turn, np.array(quaternion) / np.linalg.norm(quaternion))
        return [*(R @ place), *turned]

    rates = {name: [*(R @ rate[:3] + boost), *rate[3:]] if name.endswith("free") else rate for name, rate in RATES.items()}
    joints = {"robot/free": pose([0, 0, 0], [1, 0, 0, 0]), "plate/free": pose(POSE[:3], POSE[3:]), **JOINTS}
    run = ffsm_mj.run(holding(tmp_path, initial={"joints": joints, "rates": rates}))
    places = [np.column_stack([each[f"state.q_plate_free_{x}_m"] for x in "xyz"]) for each in (both, run)]
    np.testing.assert_allclose(places[1], places[0] @ R.T + np.outer(run.time, boost), rtol=0, atol=1e-12)
    for grasp in ("left", "right"):
        ours, theirs = (np.nan_to_num(load_on(each, grasp)[0]) for each in (both, run))
        np.testing.assert_allclose(theirs, ours @ R.T, rtol=0, atol=1e-10)


def test_a_log_with_a_gap_goes_on_with_both_closed(both):
    for rows in (np.concatenate((both.log.rows[:10], both.log.rows[30:])), both.log.rows[20:]):
        again = replay_log(replace(both.log, rows=rows))
        assert again.agrees, again.worst


def soft_and_hard():
    """A ball and a cylindrical latch, which rigid ones of the same sites replace, the first closed grasp last."""
    grasps = {
        "left": LEFT | {"joint": "ball"},
        "right": RIGHT | {"joint": "cylindrical", "axis": [0, 1, 0]},
        "hard": RIGHT,
        "left_hard": LEFT,
    }
    phases = [
        {"name": "soft", "for_s": 0.1, "arm": ["left", "right"], "controller": PD},
        {"name": "hard", "for_s": 0.1, "arm": ["hard"], "controller": PD},
        {"name": "all_hard", "for_s": 0.1, "arm": ["left_hard"], "controller": PD},
        leave("hard", until="end"),
    ]
    return {"grasps": grasps, "phases": phases}, [(3, 17), (4, 13), (6, 11), (6, 8)]


def three():
    """Two arms and a clamp of the base: the clamp leaves few motions to stop."""
    grasps = {"left": LEFT, "right": RIGHT, "clamp": CLAMP}
    phases = [
        {"name": "hold", "for_s": 0.1, "arm": [*grasps], "controller": PD},
        leave("right", for_s=0.1),
        leave("left", "clamp", until="end"),
    ]
    return {"grasps": grasps, "phases": phases}, [(6, 14), (6, 8), (2, 6)]


def two_objects():
    """One object for each arm, and the first one let go: the other becomes a child of its hand."""
    grasps = {"left": LEFT, "right": RIGHT | {"object_site": "box/b_right"}}
    joints = {"plate/free": POSE, "box/free": [1.5, -1.0, 0.2, 1, 0, 0, 0], **JOINTS}
    phases = [{"name": "hold", "for_s": 0.2, "arm": [*grasps], "controller": PD}, leave("left", until="end")]
    box = plate("box").replace("to_", "b_")
    changes = {"objects": {"box": box}, "initial": {"joints": joints, "rates": RATES}, "phases": phases}
    return changes | {"grasps": grasps}, [(6, 20), (6, 14)]


MATE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="mate"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="6" diaginertia="0.3 0.2 0.3"/><geom name="mate" type="box" size="0.1 0.1 0.1" mass="0"/>
  <body name="m0" pos="-0.2 0 0"><joint name="m0" axis="0 0 1"/><inertial pos="-0.1 0 0" mass="1" diaginertia=".01 .01 .01"/>
  <body name="m1" pos="-.3 0 0"><joint name="m1" axis="0 1 0"/><inertial pos="-0.1 0 0" mass=".8" diaginertia=".01 .01 .01"/>
  <site name="mate_tip" pos="-0.25 0 0"/></body></body></body></worldbody></mujoco>"""


def two_robots():
    """The plate links the robot with another one, which takes it first and keeps it while the robot lets go and returns."""
    grasps = {"mate": CLAMP | {"robot_site": "mate_tip"}, "left": LEFT}
    joints = {"plate/free": POSE, "mate/free": [2.6, 0.1, 0, 1, 0, 0, 0], **JOINTS}
    rates = RATES | {"mate/free": [0.05, -0.1, 0.02, 0.1, 0.2, 0.05]}
    phases = [
        {"name": "link", "for_s": 0.1, "arm": [*grasps], "controller": PD},
        leave("left", for_s=0.1),
        {"name": "again", "for_s": 0.1, "arm": ["left"], "controller": PD},
        leave("mate", until="end"),
    ]
    changes = {"objects": {"mate": MATE}, "initial": {"joints": joints, "rates": rates}, "phases": phases}
    return changes | {"grasps": grasps}, [(6, 22), (6, 16), (6, 16)]


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("scenario", [soft_and_hard, three, two_objects, two_robots])
def test_chains(tmp_path, scenario):
    """Rank and mobility by counting, and every check through the whole of it."""
    changes, counted = scenario()
    run = proved(ffsm_mj.run(holding(tmp_path, duration_s=0.4, **changes)))
    assert [(each.rank, each.mobility) for each in run.records["grasp_impulses"]] == counted


def test_a_planar_chain_has_loads_of_least_norm(tmp_path):
    """Hinges across a plane stop three of the second grasp's six motions; its load has no part in the others."""
    flat = dict.fromkeys((), 0.0)
    place = {"plate/free": [1.35, 0.02, 0, 1, 0, 0, 0], **JOINTS}
    rates = {"robot/free": [0.02, -0.01, 0, 0, 0, 0.06], "plate/free": [-0.05, 0.1, 0, 0, 0, 0.15], **flat}
    run = ffsm_mj.run(holding(tmp_path, axes=("0 0 1",) * 4, initial={"joints": place, "rates": rates}, duration_s=0.2))
    proved(run)
    second = run.records["grasp_impulses"][1]
    assert (second.rank, second.mobility) == (3, 11)  # 6 + 8 - 3
    force, torque, _ = load_on(run, "right")
    assert max(np.nanmax(np.abs(part)) for part in (force[:, 2], torque[:, :2])) < 1e-12
    assert np.nanmax(np.abs(force[:, :2])) > 0.01


def test_a_load_limit_needs_a_load_that_is_determined(tmp_path):
    limit = {"load_limit": {"force_N": 1.2}}
    run = proved(ffsm_mj.run(holding(tmp_path / "one", {"left": LEFT, "right": RIGHT | limit}, duration_s=0.3)))
    (opened,) = run.records["releases"]
    assert (opened.grasp, opened.reason) == ("right", "load_limit")
    assert opened.force_N >= 1.2
    flat = {"joints": {"plate/free": [1.35, 0.02, 0, 1, 0, 0, 0], **JOINTS}, "rates": {}}
    grasps = {"left": LEFT | limit, "right": RIGHT}
    run = ffsm_mj.run(holding(tmp_path / "flat", grasps, axes=("0 0 1",) * 4, initial=flat, duration_s=0.2))
    assert run.outcome == "unsupported_contact"
    assert "the load limit of grasp 'left' cannot be applied at t = 0 s: with left, right closed, the joints" in run.message


def test_what_is_refused_by_name(tmp_path):
    for k, (grasps, words) in enumerate(
        (
            ({"a-b": LEFT, "a_b": RIGHT}, "grasps.a_b: its columns would have the names of those of 'a-b'"),
            ({"left": LEFT | {"robot_site": "to_right"}}, "grasps.left.robot_site"),
        )
    ):
        with pytest.raises(InputError) as error:
            prepare(holding(tmp_path / str(k), grasps))
        assert words in str(error.value)


WALL = """<mujoco><option gravity="0 0 0"/><worldbody><body name="wall">
  <geom name="wall" type="box" size="0.05 1.5 1.5"/></body></worldbody></mujoco>"""


@pytest.mark.long
@pytest.mark.parametrize(("friction", "step_s"), [({}, 2e-3), ({"mu": 0.4}, 2e-3), ({"mu": 1.0}, 5e-3)])
def test_a_grasp_closes_and_another_opens_while_the_plate_is_pressed_on_a_wall(tmp_path, friction, step_s):
    """The first arm presses the plate on the wall; the second one latches it there, and takes it over.

    At 5 ms the point that sticks drifts by 3e-12 m/s until then, which is no slip: its direction is rounding.
    """
    press = PD | {"kp": 4.0, "target": [-0.3, 0.1, 0.4, 0.1, 0.25, -0.2, -0.35, 0.2]}
    grasps = {"left": LEFT, "right": RIGHT}
    phases = [
        {"name": "press", "for_s": 0.35, "arm": ["left"], "controller": press},
        {"name": "both", "for_s": 0.15, "arm": ["right"], "controller": press},
        leave("left", for_s=0.1, controller=press),
        leave("right", until="end"),
    ]
    path = scene(
        tmp_path,
        robot(),
        {"plate": plate(), "wall": WALL},
        fixed={"wall": {"position_m": [1.85, 0, 0]}},
        duration_s=0.7,
        time_step_s=step_s,
        control_period_s=1e-2,
        initial={
            "joints": {"plate/free": [1.6, 0.03, -0.02, 1, 0, 0, 0], **JOINTS},
            "rates": {"plate/free": [0.3, 0.02, 0, 0, 0, 0], "robot/free": [0.25, 0, 0, 0, 0, 0]},
        },
        grasps=grasps,
        contacts={"rules": [{"between": ["plate/plate", "wall/wall"], "restitution": 0.0, **friction}]},
        phases=phases,
    )
    run = proved(ffsm_mj.run(path))
    closes, opens = run.grasps[1].time_s, run.grasps[0].release_s
    pressed = [(each.start_s, each.end_s or run.time[-1]) for each in run.contacts]
    assert any(start < closes <= end for start, end in pressed)
    assert any(start < opens <= end + 1e-2 for start, end in pressed)
