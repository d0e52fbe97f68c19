"""Mechanisms in motion: whole runs against elimination and closed forms, their checks, replays and loads; joined models."""

from __future__ import annotations

import json
import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.tolerances import RANK
from tests.contact_models.limits import DRIVEN, driven_by
from tests.mechanisms.models import WELDED, four_bar, geared, mechanism, parallelogram, turned, two_loops
from tests.replays import proved


def last(run, *names):
    return [float(run[f"state.{name}"][-1]) for name in names]


def angle(run):
    """Angle of the base about z."""
    w, z = last(run, "q_robot_base_qw", "q_robot_base_qz")
    return 2.0 * math.atan2(z, w)


def linkage(folder, step_s, **scenario):
    """M3: the crank is driven by .02 N m for 1.5 s."""
    path = mechanism(
        folder,
        four_bar(),
        {"crank": math.pi / 3},
        {"robot/base": [0.02, -0.01, 0, 0, 0, 0.1], "crank": 2.0},
        **{"duration_s": 1.5, "time_step_s": step_s, "control_period_s": 0.02, "phases": DRIVEN} | scenario,
    )
    return path, driven_by(lambda _: (0.02,))


M3 = (-0.020219556376, 0.035748069614, 0.264427984378, 5.264011458758, 3.310309246622, 0.084336278151)


def test_a_driven_four_bar_linkage(tmp_path):
    """M3: digits by elimination, order 4, momentum as the integrator keeps it."""
    errors = []
    for step_s in (2e-3, 1e-3):
        path, laws = linkage(tmp_path, step_s)
        run = ffsm_mj.run(path, controllers=laws)
        found = (
            *last(run, "q_robot_base_x_m", "q_robot_base_y_m"),
            angle(run),
            *last(run, "q_robot_crank_rad", "v_robot_crank_rad_s"),
            float(run["balance.work_J"][-1]),
        )
        errors.append(np.abs(np.subtract(found, M3)).max())
    proved(run)
    assert errors[1] < 4e-12
    assert errors[0] / errors[1] > 10.0


def test_a_parallelogram_with_a_redundant_bar(tmp_path):
    """M7: rank 3 of 6; with two bars it is another mechanism."""
    found = []
    for bars in (3, 2):
        rates = {"robot/base": [0, 0, 0, 0, 0, 0.2], "bar0": 1.5}
        run = ffsm_mj.run(mechanism(tmp_path, parallelogram(bars), {"bar0": 0.8}, rates, control_period_s=0.02))
        proved(run)
        found.append([*last(run, "q_robot_base_x_m", "q_robot_base_y_m"), angle(run), *last(run, "q_robot_bar0_rad")])
    np.testing.assert_allclose(found[0], [0.01640258328, 0.051855406556, 0.336456346953, 2.061623317634], rtol=0, atol=2e-12)
    assert found[1][3] == pytest.approx(2.067992560911, abs=2e-12)


def test_numbers_of_a_file_that_are_rounded_leave_a_mechanism_its_motion(tmp_path, monkeypatch):
    """A redundant bar that is 1e-8 m off its place: what it adds to the rank is rounding, and the motion that of equal bars.

    At the rank of exact numbers, 1e-10, it is a truss, which closes at a right angle, 44 degrees away, and does not move.
    """
    rates = {"robot/base": [0, 0, 0, 0, 0, 0.2], "bar0": 1.5}
    even, rounded = (
        ffsm_mj.run(mechanism(tmp_path, parallelogram(off=off), {"bar0": 0.8}, rates, control_period_s=0.02, duration_s=0.4))
        for off in (0.0, 1e-8)
    )
    proved(rounded)
    for name in ("q_robot_bar0_rad", "q_robot_base_x_m", "v_robot_bar0_rad_s"):
        np.testing.assert_allclose(last(rounded, name), last(even, name), rtol=0, atol=1e-7)  # ten times the error
    # Rows that are closed to 1e-8 only close another way as the bars turn: the energy changes by less than that share.
    energy = rounded["energy.total_J"]
    assert np.abs(energy - energy[0]).max() < 1e-8 * energy[0]
    monkeypatch.setattr("ffsm_mj.assembly.initial_state.MECHANISM_RANK", RANK)
    data = prepare(mechanism(tmp_path, parallelogram(off=1e-8), {"bar0": 0.8}, rates)).assemble().data
    assert data.joint("robot/bar0").qpos[0] == pytest.approx(0.5 * math.pi, abs=1e-4)
    assert abs(data.joint("robot/bar0").qvel[0]) < 1e-6


@pytest.mark.parametrize("kind", ["welded", "body joined by two connects and a weld"])
def test_a_welded_body_moves_as_one_rigid_body(tmp_path, kind):
    """M8: two bodies as one, also if further constraints say the same."""
    more = (
        "" if kind == "welded" else '<connect body1="base" body2="child" anchor="1 0 0"/><weld body1="child" body2="base"/>'
    )
    text = WELDED.replace("</equality>", f"{more}</equality>")
    om, centre = np.array([0.8, -1.1, 0.6]), np.array([0.8, 0.4, -0.2]) / 7.0
    rates = {"robot/base": [*-np.cross(om, centre), *om]}
    run = ffsm_mj.run(mechanism(tmp_path, text, {}, rates, control_period_s=0.02, time_step_s=2e-3))
    proved(run)
    spin = last(run, *(f"v_robot_base_w{axis}_rad_s" for axis in "xyz"))
    np.testing.assert_allclose(spin, [0.887732327255, -0.932093100647, 0.752527426020], rtol=0, atol=1e-12)
    turn = last(run, *(f"q_robot_base_q{axis}" for axis in "wxyz"))
    np.testing.assert_allclose(turn, [0.736125052348, 0.373179733624, -0.467830662279, 0.316213954706], rtol=0, atol=1e-12)


def test_two_loops_that_share_a_joint(tmp_path):
    """Six rows of rank four: order four in all coordinates, and energy to rounding."""
    found = []
    for step_s in (2e-3, 1e-3, 5e-4):
        path = mechanism(
            tmp_path,
            two_loops(),
            {"crank": math.pi / 3},
            {"crank": 2.0},
            duration_s=0.6,
            time_step_s=step_s,
            control_period_s=0.02,
        )
        run = ffsm_mj.run(path)
        found.append(last(run, "q_robot_crank_rad", "v_robot_crank_rad_s", "q_robot_r1_rad", "q_robot_r2_rad"))
    proved(run)
    coarse, fine = (np.abs(np.subtract(each, found[2])).max() for each in found[:2])
    assert coarse / fine == pytest.approx(17.0, rel=0.3)
    assert fine < 1e-11
    energy = run["energy.total_J"]
    assert np.abs(energy - energy[0]).max() < 1e-14


def test_two_masses_on_a_tendon_of_constant_length(tmp_path):
    """M10: masses of 3 and 2 kg turn about each other at 1.6 rad/s, with any path of rows over quarter turns."""
    errors = []
    for step_s in (0.01, 0.005):
        path = mechanism(tmp_path, ROPE, {"x": 0.5}, {"x": 0.0, "y": 0.8}, time_step_s=step_s, control_period_s=0.02)
        run = ffsm_mj.run(path)
        x, y = last(run, "q_robot_x_m", "q_robot_y_m")
        assert math.hypot(x, y) == pytest.approx(0.5, abs=1e-10)
        errors.append(abs(math.atan2(y, x) - 1.6))
    proved(run)
    assert errors[1] < 2e-10
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.2)
    # A tension shortens the rope: mu r w^2 = 1.2 * .5 * 1.6^2 = 1.536 N. The state has the error of the steps, 5e-11.
    np.testing.assert_allclose(run["contact.robot_taut_force_N"], -1.536, rtol=0, atol=1e-9)


def test_motion_does_not_depend_on_place_time_or_speed_of_the_frame(tmp_path):
    """The linkage turned by .7 rad, 50 m away and moving at 2 m/s: the same joints."""
    found = []
    for boost in (False, True):
        c, s = math.cos(0.7), math.sin(0.7)
        v = np.array([0.02, -0.01, 0.0])
        if boost:
            v = np.array([c * v[0] - s * v[1] + 2.0, s * v[0] + c * v[1] + 0.3, -0.1])
        pose = {"robot/base": [50, -20, 5, *turned(0.7)]} if boost else {}
        path = mechanism(
            tmp_path,
            four_bar(),
            pose | {"crank": math.pi / 3},
            {"robot/base": [*v, 0, 0, 0.1], "crank": 2.0},
            control_period_s=0.02,
        )
        run = ffsm_mj.run(path)
        found.append(last(run, "q_robot_crank_rad", "q_robot_rocker_rad", "v_robot_crank_rad_s"))
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=2e-10)


def test_a_scene_has_no_soft_forces(tmp_path):
    """MuJoCo's own constraints are off: its rows would be there besides."""
    path = mechanism(tmp_path, geared(), {}, {"A": 1.0}, duration_s=0.1)
    assert prepare(path).system.mj.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EQUALITY
    run = ffsm_mj.run(path)
    proved(run)
    a, b = last(run, "v_robot_A_rad_s", "v_robot_B_rad_s")
    assert b == pytest.approx(-3.0 * a, abs=1e-12)


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("step_s", [1e-4, 1e-3, 4e-3])
@pytest.mark.parametrize("bars", [2, 3])
def test_a_change_point_ends_the_run(tmp_path, bars, step_s):
    """A parallelogram that becomes flat can go on as one or as an antiparallelogram: the run ends there."""
    rates = {"bar0": -1.5}
    path = mechanism(
        tmp_path, parallelogram(bars), {"bar0": 0.8}, rates, duration_s=1.0, time_step_s=step_s, control_period_s=4e-3
    )
    run = ffsm_mj.run(path)
    assert run.outcome == "singular_mechanism"
    assert "dead centre or change point" in run.message
    bar = run["state.q_robot_bar0_rad"]
    assert abs(bar[-1]) < 1.6 * 4.1e-3
    assert not [check for check in all_checks(run) if not check.passes]


def test_what_projections_change_is_bounded(tmp_path, monkeypatch):
    """Drift of a linkage at 4 rad/s in steps of 4 ms costs 2e-12 J; the balance would not miss what a wrong row takes.

    An error of 1e-4 that is none moves the linkage at the start of each step, in 5e-5 J: energy passes, this check fails.
    """
    given = {"time_step_s": 4e-3, "control_period_s": 4e-3, "duration_s": 0.3}

    def judged():
        run = ffsm_mj.run(mechanism(tmp_path, four_bar(), {"crank": 1.0472}, {"crank": 4.0}, **given))
        assert all(check.passes for check in run.checks() if check.name == "energy")
        (check,) = [check for check in run.checks() if check.name == "energy of projections"]
        assert check.residual == run["balance.projected_loops_J"].max()
        return check

    right, independent = judged(), ClosedLoops.independent
    assert right.passes
    assert right.residual < 1e-11

    def shifted(self):
        J, errors = independent(self)
        return J, errors + 1e-4

    monkeypatch.setattr(ClosedLoops, "independent", shifted)
    wrong = judged()
    assert not wrong.passes
    assert wrong.residual > 1e-5


FORCE, TORQUE = ([f"{what}_{x}_{unit}" for x in "xyz"] for what, unit in (("force", "N"), ("torque", "N_m")))
ROPE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/><site name="a"/>
  <body name="mass"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
  <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><site name="b"/></body></body></worldbody>
  <tendon><spatial name="rope"><site site="a"/><site site="b"/></spatial></tendon>
  <equality><tendon name="taut" tendon1="rope" polycoef=".5 0 0 0 0"/></equality></mujoco>"""


def momenta_of_child(path, run):
    """Linear momentum of the child, its angular momentum about its mass centre, and the welded point from there, by row."""
    model = prepare(path).system.mj
    data, child, found = mujoco.MjData(model), model.body("robot/child").id, []
    for qpos, qvel in zip(run.qpos, run.qvel, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        J, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, J, turn, child)
        axes = data.ximat[child].reshape(3, 3)
        spin = axes @ (model.body_inertia[child] * (axes.T @ (turn @ qvel)))
        point = data.xpos[child] + data.xmat[child].reshape(3, 3) @ (0.05, 0.02, 0.0)
        found.append((model.body_mass[child] * J @ qvel, spin, point - data.xipos[child]))
    return np.array(found).transpose(1, 0, 2)


@pytest.mark.parametrize("name", ["joint", ""])
def test_the_load_of_a_weld_is_what_moves_the_body(tmp_path, name):
    """M8: slides and a ball joint exert nothing, so the weld alone changes the momenta of the child."""
    text = WELDED.replace('name="joint"', f'name="{name}"' if name else "")
    start = "contact.robot_joint" if name else "contact.robot_base_equality"
    om, centre, h = np.array([0.8, -1.1, 0.6]), np.array([0.8, 0.4, -0.2]) / 7.0, 2e-3
    rates = {"robot/base": [*-np.cross(om, centre), *om]}
    path = mechanism(tmp_path, text, {}, rates, control_period_s=h, time_step_s=h, duration_s=0.2)
    run = ffsm_mj.run(path)
    proved(run)
    force, torque = (np.stack([run[f"{start}_{key}"] for key in keys], axis=1) for keys in (FORCE, TORQUE))
    linear, spin, arm = momenta_of_child(path, run)
    # Central differences are off by h^2 / 6 of the third derivative: 7e-7 of some 2 N 1/s^2 and 1 N m 1/s^2.
    for load, momentum in ((force, linear), (torque + np.cross(arm, force), spin)):
        assert np.abs(load).max() > 0.01
        np.testing.assert_allclose(load[1:-1], (momentum[2:] - momentum[:-2]) / (2.0 * h), rtol=0, atol=3e-6)


ROOM = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
 <body name="post" pos="0 2 0"><geom name="post" type="box" size=".1 .1 .1"/></body>
 <body name="arm"><freejoint name="float"/><inertial pos="0 0 0" mass="20" diaginertia="2 2.2 2.4"/>
  <body name="link" pos=".2 0 0"><joint name="elbow" axis="0 0 1"/>
   <inertial pos=".2 0 0" mass="2" diaginertia=".01 .03 .03"/>
   <site name="tip" pos=".4 0 0"/></body></body>
 <body name="box" pos=".7 0 0"><freejoint name="box"/><inertial pos=".02 .01 0" mass="3" diaginertia=".03 .04 .05"/>
  <site name="face" pos="-.1 0 0"/>
  <body name="lid" pos=".1 0 0"><joint name="lid" axis="0 0 1"/>
   <inertial pos=".1 0 0" mass=".4" diaginertia=".001 .002 .002"/>
  </body></body></worldbody>
<equality>{equality}</equality><actuator><motor name="elbow" joint="elbow"/></actuator></mujoco>"""


def room(folder, equality, joints=None, rates=None, **keys):
    (folder / "room.xml").write_text(ROOM.format(equality=equality))
    given = {
        "name": "room",
        "duration_s": 1.0,
        "control_period_s": 0.02,
        "scene": {"mjcf": "room.xml", "robot": "arm"},
        "contacts": {"rules": []},
        "initial": {"joints": joints or {}, "rates": rates or {}},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / "room.yaml"
    path.write_text(json.dumps(given | keys))
    return path


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("kind", ["weld", "connect"])
def test_an_object_in_the_hand_from_the_start(tmp_path, kind):
    """The object without a value comes to the hand, and its rates follow; what the robot loses, it gains."""
    path = room(
        tmp_path,
        f'<{kind} site1="tip" site2="face"/>',
        {"elbow": 0.4},
        {"float": [0.1, 0, 0, 0.2, -0.1, 0.3], "elbow": 0.8, "lid": -0.5},
    )
    data = prepare(path).assemble().data
    np.testing.assert_allclose(data.site("box/face").xpos, data.site("robot/tip").xpos, rtol=0, atol=1e-12)
    run = ffsm_mj.run(path)
    proved(run)
    energy = run["energy.objects_J"]
    assert np.abs(np.diff(energy)).max() > 1e-6
    given = np.linalg.norm([run[f"balance.contact_P_{axis}_N_s"] for axis in "xyz"], axis=0)
    assert given[-1] > 0.01


def test_a_hand_on_a_fixed_post(tmp_path):
    """A fixed body takes momentum, and no energy."""
    path = room(tmp_path, '<connect body1="link" body2="post" anchor=".4 0 0"/>', {}, {"elbow": 0.8, "lid": 0.1})
    run = ffsm_mj.run(path)
    proved(run)
    energy = run["energy.robot_J"]
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9 * (1 + energy[0]))


def test_joints_of_two_models_that_are_coupled(tmp_path):
    """A coupling passes power, and no momentum."""
    path = room(
        tmp_path, '<joint joint1="lid" joint2="elbow" polycoef="0 -2 .5 0 0"/>', {}, {"elbow": 0.8, "float": [0.1] * 6}
    )
    run = ffsm_mj.run(path)
    proved(run)
    elbow, lid = last(run, "q_robot_elbow_rad", "q_box_lid_rad")
    assert lid == pytest.approx(-2.0 * elbow + 0.5 * elbow**2, abs=1e-11)
    assert np.abs(np.diff(run["energy.objects_J"])).max() > 1e-6
    for axis in "xyz":
        assert np.abs(run[f"balance.contact_P_{axis}_N_s"]).max() == 0.0
