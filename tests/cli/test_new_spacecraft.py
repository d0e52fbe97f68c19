"""A spacecraft of one's own: its layout, the geometry of its mission, and the run, which ends in a capture at rest."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import ffsm_mj
from ffsm_controllers.allocation import ThrusterAllocation
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.dynamics.rigid_body import site_wrench
from ffsm_mj.templates.layout import THRUSTERS, WHEELS, authority, jets, wheel_axes
from ffsm_mj.templates.mission import APPROACH_S, CLOSE_IN_S, STAND_OFF_S
from tests.model.test_model_files import TETRA
from tests.scenes import ARM, ball


def _link(name, axis, length, below, range_="-2.9 2.9"):
    """A link along z of its frame with a joint at its beginning."""
    return f"""<body name="{name}" pos="0 0 {below}"><joint name="{name}" axis="{axis}" range="{range_}" armature="0.05"
      actuatorfrcrange="-60 60"/><inertial pos="0 0 {length / 2}" mass="{4 * length + 1}" diaginertia="0.05 0.05 0.01"/>
      <geom type="capsule" fromto="0 0 0.06 0 0 {length - 0.06}" size="0.04" mass="0"/>"""


def arm(joints=6):
    """MJCF of an arm of a metre without actuators; of its six joints the first ones."""
    links = (("pan", "0 0 1", 0.2), ("lift", "0 1 0", 0.4), ("elbow", "0 1 0", 0.35), ("roll", "0 0 1", 0.15))
    links = (*links, ("pitch", "0 1 0", 0.15), ("twist", "0 0 1", 0.15))[:joints]
    below, text = 0.05, ""
    for name, axis, length in links:
        text, below = text + _link(name, axis, length, below), length
    tip = f'<site name="flange" pos="0 0 {below}"/>'
    return f"""<mujoco><compiler angle="radian"/><worldbody><body name="foot">
      <geom type="cylinder" size="0.08 0.05" mass="3"/>{text}{tip}{"</body>" * len(links)}</body></worldbody></mujoco>"""


@pytest.fixture
def made(tmp_path, monkeypatch, capfd):
    """Writes a spacecraft with an arm; returns what was said of it."""
    monkeypatch.chdir(tmp_path)

    def written(*options, text=None):
        Path("arm.xml").write_text(text or arm())
        assert main(["new", "my", "--robot", "arm.xml", "--thrusters", "12", *options]) == 0
        return capfd.readouterr().out

    return written


@pytest.mark.parametrize("count", THRUSTERS)
def test_thrusters_reproduce_random_wrenches(count):
    """Shares that are not negative give each wrench to rounding; six jets through the centre give forces alone."""
    layout = jets(count)
    columns = np.array([[*jet.push, *np.cross(jet.place, jet.push)] for jet in layout]).T
    assert columns.shape == (6, count)
    np.testing.assert_allclose(np.linalg.norm(columns[:3], axis=0), 1.0, rtol=1e-15)
    can = authority(columns, np.array(wheel_axes(4)).T)
    assert (can.torque, can.rank) == (True, 6)
    assert can.wrench == (count > 6)
    # Exhausts point away from the bus: a jet pushes the face or corner that it sits on inwards.
    assert all(np.dot(jet.place, jet.push) < 0.0 for jet in layout)


@pytest.mark.parametrize("count", [c for c in THRUSTERS if c > 6])
def test_without_the_jets_of_one_way_not_every_wrench_is_left(count):
    columns = np.array([[*jet.push, *np.cross(jet.place, jet.push)] for jet in jets(count)]).T
    can = authority(columns[:, columns[0] >= 0.0], np.zeros((3, 0)))
    assert (can.wrench, can.torque) == (False, False)


@pytest.mark.parametrize("count", WHEELS)
def test_wheels_are_equally_strong_about_all_axes(count):
    """Sum of a a^T is n/3, to rounding."""
    axes = np.array(wheel_axes(count))
    np.testing.assert_allclose(axes.T @ axes, count / 3.0 * np.eye(3), atol=1e-14)


@pytest.mark.parametrize("count", [8, 12])
def test_the_allocation_of_a_written_spacecraft_reproduces_random_wrenches(made, count):
    """By the class that the laws use: efforts times wrenches of the compiled jets, to rounding of the largest."""
    said = made("--thrusters", str(count), "--bus-mass", "300", "--bus-size", "1", "1.2", "0.8")
    assert f"thrusters: {count} of 1.2 N: any force and torque can be commanded\n" in said
    assert "wheels: 4 in a pyramid, 7.2 N m s and 1.2 N m each: any torque can be commanded\n" in said
    system = prepare("my.yaml").system
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    ids = np.array([system.index("actuator", f"jet_{i}") for i in range(1, count + 1)])
    allocation, columns = ThrusterAllocation(system, ids), np.array([site_wrench(system.mj, i) for i in ids]).T
    for wrench in np.random.default_rng(0).normal(size=(20, 6)):
        efforts = allocation.efforts(data, wrench[:3], wrench[3:])
        assert efforts.min() >= 0.0
        np.testing.assert_allclose(columns @ efforts, wrench, atol=1e-13 * np.linalg.norm(wrench) * count)


def test_the_bus_has_the_mass_and_size_that_is_asked_for(made):
    made("--wheels", "3", "--bus-mass", "300", "--bus-size", "1", "1.2", "0.8")
    model = prepare("my.yaml").system.mj
    bus = model.body("robot/bus")
    wheels = [model.body(f"robot/wheel_{i}").mass[0] for i in (1, 2, 3)]
    assert bus.mass[0] + sum(wheels) == pytest.approx(300.0, rel=1e-12)
    np.testing.assert_array_equal(model.geom("robot/bus_hull").size, [0.5, 0.6, 0.4])
    edges = np.array([1.0, 1.2, 0.8])
    np.testing.assert_allclose(bus.inertia, bus.mass[0] / 12.0 * (edges @ edges - edges**2), rtol=5e-4)  # of four digits
    assert model.body("robot/foot").pos[2] == 0.4  # the arm stands on the upper face


def test_dry_friction_and_damping_of_another_world_are_removed_and_said(made):
    """2 N m s/rad on a wrist of 0.01 kg m^2 about its axis, as files for other simulators have it; 0.2 N m s/rad stay.

    It decays in 5 ms, or a little less, since what the wrist is mounted on gives way.
    """
    wrist = '<joint name="twist" axis="0 0 1" range="-2.9 2.9" armature="0.05"'
    for damping, removed in ((2.0, "frictionloss, damping"), (0.2, "frictionloss")):
        damped = arm().replace(wrist, f'{wrist[:-5]}0" frictionloss="0.1" damping="{damping}"')
        said = made(text=damped)
        assert f"removed from the robot: {removed}; dry friction of twist, which the law 'track' does not know" in said
        assert bool(re.search(r"damping, by which 'twist' decays in 4\.\d ms, far less than a step", said)) == (
            damping == 2.0
        )
        assert f"  strip: [{removed}]" in Path("my.yaml").read_text()
        for name in ("my.yaml", "my.xml", "my_target.xml"):
            Path(name).unlink()


@pytest.mark.parametrize(("turned", "out"), [("", 1.0), ('euler="3.14159265358979 0 0"', -1.0)])
def test_a_last_link_on_the_arm_s_side_of_its_joint_ends_there(made, turned, out):
    """As of an xArm or a UR, whose flange is at the origin of the last joint: the tool looks away from the arm all the same.

    The link ends 2 cm beyond the joint, a capsule of 4 cm about a middle 2 cm behind it, whichever way its z axis points.
    """
    last, flange = '<body name="twist" ', '<site name="flange" pos="0 0 0.15"/>'
    ahead, behind = "0 0 0.06 0 0 0.09", f"0 0 {-0.06 * out} 0 0 {-0.02 * out}"
    head, tail = arm().replace(flange, "").split(last)
    made(text=f"{head}{last}{turned} {tail.replace(ahead, behind)}")
    (tool,) = [site for site in prepare("my.yaml").scenario.robot.sites.items() if site[0] == "tool"]
    np.testing.assert_allclose(tool[1].pos_m, [0.0, 0.0, 0.02 * out], atol=1e-6)
    x = Rotation.from_quat(tool[1].quaternion, scalar_first=True).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(x, [0.0, 0.0, out], atol=1e-6)


def test_the_target_arrives_before_the_waiting_arm(made):
    """At the time of the capture its grapple is before the tool, turned as it is: by Euler's equations in SciPy.

    Their tolerance is 1e-10; states in the file have nine digits and 1e-8 rad/s, which is 8e-7 rad after 75 s. The arm is
    written to seven digits; MuJoCo's RK4 in steps of 10 ms is off by far less.
    """
    made()
    scenario, system = (prepared := prepare("my.yaml")).scenario, prepared.system
    data = mujoco.MjData(system.mj)
    for name, value in scenario.initial.joints.items():
        if name != "bus_free":
            data.qpos[system.joint(system.resolve("joint", name)).qpos] = value
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]  # where it is at the capture
    moments = system.mj.body("target/target").inertia
    start = np.array(scenario.initial.joints["free"])
    rates = np.array(scenario.initial.rates["free"])

    def motion(_, state):
        turn, spin = state[:4], state[4:]
        half = 0.5 * np.array([-turn[1:] @ spin, *(turn[0] * spin + np.cross(turn[1:], spin))])
        return [*half, *(np.cross(moments * spin, spin) / moments)]

    end = APPROACH_S + STAND_OFF_S + CLOSE_IN_S
    later = solve_ivp(motion, (0.0, end), [*start[3:], *rates[3:]], rtol=1e-10, atol=1e-12).y[:4, -1]
    data.qpos[system.joint("target/free").qpos] = [*start[:3], *later]
    mujoco.mj_forward(system.mj, data)
    tool, grapple = data.site("robot/tool"), data.site("target/grapple")
    way = -scenario.phases[1].controllers["arm"].offset_m[0]
    between = tool.xmat.reshape(3, 3).T @ (grapple.xpos - tool.xpos)
    np.testing.assert_allclose(between, [way, 0.0, 0.0], atol=1e-3)  # the way is written to three digits
    np.testing.assert_allclose(between[1:], 0.0, atol=3e-6)
    turn = Rotation.from_matrix(tool.xmat.reshape(3, 3).T @ grapple.xmat.reshape(3, 3))
    assert turn.magnitude() < 3e-6
    assert np.linalg.norm(rates[3:]) > 0.01  # it does tumble


def test_what_is_noted_of_a_written_spacecraft_is_a_line_of_each_kind(made):
    """What was removed; the foot, whose mesh in single precision may be 5 nm off the bus, is welded to it."""
    foot = '<geom type="box" size="0.08 0.08 0.025" pos="0 0 0.025000005" mass="3"/>'
    text = arm().replace('<geom type="cylinder" size="0.08 0.05" mass="3"/>', foot)
    made(text=text.replace('armature="0.05"', 'armature="0.05" frictionloss="0.1"'))
    removed = "removed from robot: frictionloss of 6 joints (pan, lift, elbow, roll and 2 more)"
    assert prepare("my.yaml").notes() == [removed]
    unwelded = prepare("my.yaml", {"contacts.weld_m": 1e-9}).notes()
    assert [note.partition(" of ")[0] for note in unwelded] == ["removed from robot: frictionloss", "a crack or overlap"]


def test_every_line_has_a_comment(made):
    """Beside it, or above."""
    made()
    for name, mark in (("my.yaml", "# "), ("my.xml", "<!-- "), ("my_target.xml", "<!-- ")):
        before = ""
        for line in Path(name).read_text().splitlines():
            closes = re.fullmatch(r"\s*</\w+>", line)  # the end of an element is its own comment
            assert not line or closes or mark in line or before.strip().startswith(mark.strip()), line
            assert len(line) <= 140
            before = line


def test_a_mesh_of_another_folder_is_found(made, monkeypatch):
    Path("rock.obj").write_text(TETRA.format(x=0.4))
    Path("here").mkdir()
    monkeypatch.chdir("here")
    made("--target", "../rock.obj")
    assert prepare("my.yaml").scenario.objects["target"].asset_folders == ("..",)


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize(
    ("joints", "options"),
    [(6, []), (6, ["--wheels", "3", "--thrusters", "8", "--target", "rock.obj"]), (4, ["--target", "rock.xml"])],
)
def test_the_mission_ends_in_a_capture_at_rest(made, joints, options):
    """As it is written: no impact, one grasp, which lasts; what is left moves by less than what the jets leave to drift.

    They fire where more than half their force is asked, by kd times the speed: 0.5 * 2 N / 660 N s/m.
    """
    Path("rock.obj").write_text(TETRA.format(x=0.4))
    Path("rock.xml").write_text(ball("rock", radius=0.3, mass=40.0))
    made(*options, text=arm(joints))
    run = ffsm_mj.run("my.yaml", rerun=False)
    assert [check.name for check in all_checks(run) if not check.passes] == []
    assert run.outcome == "completed"
    assert not run.impacts
    assert not run.unhandled_contacts
    (grasp,) = run.grasps
    assert grasp.release_s is None
    assert [phase.name for phase in run.phases] == ["approach", "stand_off", "close_in", "detumble", "rest"]
    system = prepare("my.yaml").system
    ends = [run.qvel[-1][system.joint(name).dofs] for name in ("robot/bus_free", "target/free")]
    for end in ends:
        assert np.linalg.norm(end[:3]) < 0.5 * 2.0 / 600.0
        assert np.linalg.norm(end[3:]) < 1e-3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--wheels", "2"], "new: --wheels: 2 is not possible; allowed: 3 (along the axes), 4 (a pyramid) to 12"),
        (["--wheels", "13"], "new: --wheels: 13 is not possible; allowed: 3"),
        (["--thrusters", "10"], "new: --thrusters: 10 is not possible; allowed: 6, 8, 12, 16, 24"),
        (["--target", "rock.xml"], "ffsm new: --target has no effect without --wheels or --thrusters"),
        (["--wheels", "4", "--target", "rock.step"], "new: --target: rock.step is neither an MJCF or URDF (.xml"),
        (["--wheels", "4", "--target", "no.xml"], "new: --target: no such file: no.xml"),
        (["--wheels", "4", "--target", "rock.xml", "--target-mass", "5"], "new: --target-mass: rock.xml has its masses"),
        (["--wheels", "4", "--target", "rock.xml", "--grapple", "pin"], "new: --grapple: unknown site of the target 'pin'"),
        (["--wheels", "4", "--grapple", "pin"], "new: --grapple names a site of an MJCF or URDF given by --target"),
        (["--wheels", "4", "--base", "none"], "new: --base none has no effect with --wheels or --thrusters"),
        (["--wheels", "4", "--base-size", "1", "2"], "new: --base-size: 2 numbers; allowed: one edge for all, or three"),
        (["--wheels", "4", "--bus-mass", "0"], "argument --base-mass/--bus-mass: 0 is not a positive number"),
        (["--wheels", "4", "--target", "rock.xml", "--grapple", "centre"], "new: --target: no pose of the arm was found"),
        (["--wheels", "4", "--tip", "lift"], "new: 2 driven joints move the tip; a capture needs three or more"),
        (["--wheels", "4", "--robot", "floats.xml"], "new: --robot: floats.xml floats already; --wheels and --thr"),
        (["--wheels", "4", "--target", "stands.xml"], "stands.xml"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_told_in_a_line(tmp_path, monkeypatch, options, said, capfd):
    """And nothing is left of it."""
    monkeypatch.chdir(tmp_path)
    texts = {"arm.xml": arm(), "floats.xml": ARM, "rock.step": "", "rock.xml": ball("rock", radius=0.3)}
    texts["stands.xml"] = texts["rock.xml"].replace("<freejoint", '<joint type="slide" axis="1 0 0"')
    for name, text in texts.items():
        Path(name).write_text(text)
    assert main(["new", "my", "--robot", "arm.xml", *options]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert said in line
    assert {path.name for path in tmp_path.iterdir()} == set(texts)
