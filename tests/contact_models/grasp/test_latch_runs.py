"""Whole runs with latches that leave some motion free: soft and hard capture, impacts, sensors, logs, saved states."""

from __future__ import annotations

from typing import ClassVar, Literal

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.config import StrictModel
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.replay import replay_log
from tests.contact_models.grasp.scenes import OFF, grasping, stone
from tests.contact_models.limits import driven_by
from tests.laws import Law
from tests.replays import proved
from tests.scenes import HEAD, scene

AXIS = [2.0, -3.0, 6.0]
KINDS = {"ball": {}, "hinge": {"axis": AXIS}, "slide": {"axis": AXIS}, "cylindrical": {"axis": AXIS}}
ANY = {"within": {"position_m": 0.5}}
SITES = {"robot_site": "grip", "object_site": "handle"}
LOADS = [f"contact.grasp_{load}" for load in ("force_{}_N", "torque_{}_N_m")]
WAGGLE = {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}


def docking(folder, kind, **changes):
    """A tumbling ball at the hand: latched softly at once, hard after 0.1 s, and let go after 0.2 s."""
    grasps = {
        "soft": {**SITES, "joint": kind, **KINDS[kind], "when": ANY},
        "hard": {**SITES, "when": {"within": {"position_m": 0.5}}},
    }
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["soft"], "controller": OFF},
        {"name": "swing", "for_s": 0.1, "controller": WAGGLE},
        {"name": "lock", "for_s": 0.1, "arm": ["hard"], "controller": WAGGLE},
        {"name": "leave", "until": "end", "release": ["hard"], "controller": OFF},
    ]
    return grasping(
        folder,
        **{
            "grasps": grasps,
            "phases": phases,
            "duration_s": 0.25,
            "initial": {
                "joints": {"target/free": [1.06, 0.03, 0.02, 1, 0, 0, 0]},
                "rates": {"robot/free": [0, 0, 0, 0.02, -0.03, 0.05], "target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3]},
            },
        }
        | changes,
    )


def loads(run):
    """Force and torque on the object, (n, 6)."""
    return np.column_stack([run[key.format(x)] for key in LOADS for x in "xyz"])


@pytest.mark.parametrize("kind", KINDS)
def test_soft_capture_hard_capture_and_release(tmp_path, kind):
    """All checks, in the run and from its log; no load along what is free; the grasp that takes over ends the first."""
    run = proved(ffsm_mj.run(docking(tmp_path, kind)))
    soft, hard = run.records["grasp_impulses"]
    assert (soft.joint, soft.replaces, soft.rank) == (kind, "", {"ball": 3, "cylindrical": 4}.get(kind, 5))
    assert (hard.joint, hard.replaces, hard.rank) == ("rigid", "soft", 6)
    assert (hard.axis, hard.axis_angle_rad) == ((0.0, 0.0, 0.0), 0.0)
    assert hard.time_s == pytest.approx(0.1)
    assert hard.loss_J > 1e-6  # of the motion that was free
    (release,) = run.records["releases"]
    first, second = run.grasps
    assert (first.grasp, first.release_s, second.grasp, second.release_s) == ("soft", hard.time_s, "hard", release.time_s)
    number = run["contact.grasp_closed"]
    np.testing.assert_array_equal(number[[50, 150, 240]], [1.0, 2.0, 0.0])
    frames = sites(run, np.flatnonzero(number == 1.0))
    force, torque = np.split(loads(run)[number == 1.0], 2, axis=1)
    axis = frames @ soft.axis
    scale = 1.0 + np.abs(force).max()
    assert np.abs(force).max() > 0.1
    if kind == "ball":
        assert np.abs(torque).max() < 1e-12 * scale
    if kind in ("slide", "cylindrical"):
        assert np.abs((force * axis).sum(axis=1)).max() < 1e-12 * scale
    if kind in ("hinge", "cylindrical"):
        assert np.abs((torque * axis).sum(axis=1)).max() < 1e-12 * scale


def sites(run, rows):
    """Axes of the robot's site in some rows, (n, 3, 3)."""
    system = compile_log(run.log)
    data, found = mujoco.MjData(system.mj), []
    coordinates = [key for key in run.keys if key.startswith("state.q_")]
    for row in rows:
        data.qpos[:] = [run[key][row] for key in coordinates]
        mujoco.mj_forward(system.mj, data)
        found.append(data.site("robot/grip").xmat.reshape(3, 3).copy())
    return np.array(found)


BODY = """<mujoco><option gravity="0 0 0"/><worldbody><body name="{0}"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="{1}" diaginertia="{2} {2} {2}"/><site name="site" pos="{3} 0 0"/>
  </body></worldbody></mujoco>"""
SPIN = np.array((0.1, 0.2, 3.0))


@pytest.mark.long
@pytest.mark.parametrize("let_go_s", [0.6, 1.6, 2.6])
def test_a_ball_that_turns_past_half_a_turn_keeps_the_sign_of_its_attitude(tmp_path, let_go_s):
    """A sphere that is latched at its centre spins on: (cos, sin n) of half its angle, all around the double cover.

    Rows hold it as a second grasp, and its own joint once the first grasp has let go, before or after half a turn (1.04 s).
    """
    names = "stiff", "loose"
    path = scene(
        tmp_path,
        BODY.format("hub", 10, 1, 0.4),
        {name: BODY.format(name, 2, 0.02, 0) for name in names},
        duration_s=4.0,
        time_step_s=2e-3,
        control_period_s=1e-2,
        initial={
            "joints": {f"{name}/free": [0.4, 0, 0, 1, 0, 0, 0] for name in names},
            "rates": {"loose/free": [0, 0, 0, *SPIN]},
        },
        grasps={
            name: {"robot_site": "robot/site", "object_site": f"{name}/site", "when": ANY, "joint": joint}
            for name, joint in zip(names, ("rigid", "ball"), strict=True)
        },
        phases=[
            {"name": "first", "for_s": 0.1, "arm": ["stiff"], "controller": OFF},
            {"name": "second", "for_s": let_go_s - 0.1, "arm": ["loose"], "controller": OFF},
            {"name": "rest", "until": "end", "release": ["stiff"], "controller": OFF},
        ],
    )
    run = ffsm_mj.run(path)
    rate = np.linalg.norm(SPIN)
    half = 0.5 * rate * run.time
    turned = np.column_stack((np.cos(half), *np.outer(SPIN / rate, np.sin(half))))
    logged = np.column_stack([run[f"state.q_loose_free_q{part}"] for part in "wxyz"])
    # 2000 steps, each of which rounds four components of at most 1.
    np.testing.assert_allclose(logged, turned, rtol=0, atol=2000 * 4e-16)
    again = replay_log(run.log)
    assert again.agrees, again.worst
    assert again.worst["motion"].size < 1e-12


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("kind", ["rigid", "ball"])
def test_a_stone_hits_what_is_latched(tmp_path, kind):
    """The impact acts on both bodies through the joint: checks of energy, friction and momenta, in the run and replayed.

    A run that goes on from an instant between the closing and the impact passes them too: its log has no record of
    the closing.
    """
    path = docking(
        tmp_path / "scene",
        "ball",
        grasps={"soft": {**SITES, "joint": kind, "when": ANY}},
        others={"stone": stone()},
        phases=[{"name": "swing", "until": "end", "arm": ["soft"], "controller": WAGGLE}],
        initial={
            "joints": {"target/free": [1.06, 0.03, 0.02, 1, 0, 0, 0], "stone/free": [1.4, 0.06, 0.02, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "stone/free": [-2.0, 0, 0, 0, 0, 0]},
        },
        contacts={"rules": [{"between": ["stone/stone", "target/target"], "restitution": 0.5, "mu": 0.3}]},
    )
    run = proved(ffsm_mj.run(path, out=tmp_path / "run"))
    proved(ffsm_mj.resume(tmp_path / "run", 0.04, out=tmp_path / "on"))
    (hit,) = run.records["impacts"]
    twist = [np.array(rates["target/free"][3:]) - rates["robot/free"][3:] for rates in (hit.qvel_before, hit.qvel_after)]
    assert kind == "rigid" or np.linalg.norm(twist[1] - twist[0]) > 0.1


def test_a_latch_is_refused_with_its_place(tmp_path):
    for changes, message in (
        ({"joint": "hinge"}, "joint: hinge needs 'axis: [x, y, z]', not all zero, in the frame of robot_site"),
        ({"joint": "slide", "axis": [0, 0, 0]}, "joint: slide needs 'axis"),
        ({"joint": "ball", "axis": [1, 0, 0]}, "joint: ball has no axis; leave out 'axis'"),
        ({"joint": "screw"}, "rigid"),
    ):
        grasps = {"soft": {**SITES, "when": ANY, **changes}}
        with pytest.raises(InputError) as error:
            prepare(docking(tmp_path, "ball", grasps=grasps))
        assert len(error.value.lines) == 1
        assert "grasps.soft" in error.value.lines[0]
        assert message in error.value.lines[0]


class Sees(Law):
    """A control law that notes angle and rate of the latch, and the pose of the object."""

    seen: ClassVar[list] = []

    def __init__(self, _, context):
        self._system = context.system

    def control(self, observation, _):
        if observation.grasps == ("soft",):
            joint, root = self._system.joint("target/soft_hinge"), self._system.index("body", "target/target")
            place = [observation.data.xpos[root], observation.free.xpos[4]]
            np.testing.assert_allclose(*place, rtol=0, atol=1e-13)
            self.seen.append((observation.data.qpos[joint.qpos][0], observation.data.qvel[joint.dofs][0]))


class Still(Law):
    """An estimator to which nothing ever moves."""

    class Config(StrictModel):
        """Its kind."""

        kind: Literal["still"]

    def update(self, time_s, measured, events, data):
        pass


def test_control_laws_see_the_joint(tmp_path):
    """Its angle is that between the sites about the axis, 0 at the start; also by a controller model and an estimate."""
    phases = [{"name": "all", "until": "end", "arm": ["soft"], "controller": {"kind": "sees"}}]
    own = {"controller_model": {"target": {"target": {"mass_kg": 5.0}}}}
    found = []
    for k, changes in enumerate(({}, own, {"estimator": {"kind": "still"}})):
        Sees.seen.clear()
        path = docking(tmp_path / str(k), "hinge", phases=phases, duration_s=0.05, **changes)
        run = ffsm_mj.run(path, controllers={"sees": Sees}, estimators={"still": Still})
        assert run.outcome == "completed", run.message
        found.append(np.array(Sees.seen))
    truth, believed, still = found
    np.testing.assert_array_equal(believed, truth)
    assert truth[0, 0] == 0.0
    np.testing.assert_allclose(np.diff(truth[:, 0]), 1e-3 * truth[:-1, 1], rtol=1e-2)
    assert np.abs(still[:, 0]).max() == 0.0


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_an_object_that_swings_into_the_hand_bounces_off_it(tmp_path, kind):
    """Pairs of the two bodies stay active: the latch is no licence to overlap, and a release finds them apart."""
    axis = {"axis": [0.0, 0.0, 1.0]} if kind == "hinge" else {}
    path = docking(
        tmp_path,
        "ball",
        grasps={"soft": {**SITES, "joint": kind, **axis, "when": ANY}},
        phases=[
            {"name": "swing", "for_s": 0.35, "arm": ["soft"], "controller": OFF},
            {"name": "leave", "until": "end", "release": ["soft"], "controller": OFF},
        ],
        initial={
            "joints": {"target/free": [1.053, 0.0, 0.0, 1, 0, 0, 0]},
            "rates": {"target/free": [0.0, 0, 0, 0.0, 0.0, 3.0]},
        },
        duration_s=0.5,
    )
    run = proved(ffsm_mj.run(path))
    hits = [hit for hit in run.records["impacts"] if hit.time_s < 0.35]
    assert hits
    assert all(set(hit.geoms) == {"robot/hand", "target/target"} for hit in hits)


START = {
    "joints": {"target/free": [1.08, 0.0, 0.0, 1, 0, 0, 0]},
    "rates": {
        "robot/free": [0, 0, 0, 0.02, -0.03, 0.05],
        "shoulder": 1.5,
        "elbow": -1.0,
        "target/free": [-0.1, 0.3, 0.5, 0.4, -2.0, 1.0],
    },
}


def swinging(folder, kind, limit=None, **changes):
    """A ball on a latch whose load changes as it swings; nothing is driven."""
    axis = {"axis": [0.0, 1.0, 0.3]} if kind == "hinge" else {}
    grasp = {**SITES, "joint": kind, **axis, "when": ANY, **({"load_limit": limit} if limit else {})}
    return docking(
        folder,
        "ball",
        grasps={"grasp": grasp},
        phases=[
            {"name": "swing", "until": "release", "arm": ["grasp"], "controller": OFF},
            {"name": "leave", "until": "end", "controller": OFF},
        ],
        contacts={"rules": []},
        **{"duration_s": 0.4, "initial": START, **changes},
    )


def _plain(values):
    return values.tolist() if len(values) > 1 else float(values[0])


def reversed_end(run):
    """The end of a run with all rates reversed: a start of the same motion backwards."""
    joints = compile_log(run.log).joints
    q, v = run.qpos[-1], -run.qvel[-1]
    return {
        "joints": {name: _plain(q[joint.qpos]) for name, joint in joints.items()},
        "rates": {name: _plain(v[joint.dofs]) for name, joint in joints.items()},
    }


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("kind", ["rigid", "hinge"])
def test_it_opens_at_the_root_of_the_load(tmp_path, kind):
    """The object swings inwards: its load grows, and reaches the limit between two samples of the run without one.

    The instant is the root whatever the step, to the truncation of the motion, and the logged load there is the limit.
    """
    start = reversed_end(ffsm_mj.run(swinging(tmp_path / "before", kind)))
    free = proved(ffsm_mj.run(swinging(tmp_path / "free", kind, initial=start)))
    force, at = np.linalg.norm(loads(free)[:, :3], axis=1), 250
    assert np.all(np.diff(force[2:]) > 0.0)
    limit_N = float(0.3 * force[at - 1] + 0.7 * force[at])
    times = []
    for step_s in (1e-3, 0.5e-3):
        changes = {"time_step_s": step_s, "control_period_s": 1e-3, "initial": start}
        run = proved(ffsm_mj.run(swinging(tmp_path / f"{step_s}", kind, {"force_N": limit_N}, **changes)))
        (release,) = run.records["releases"]
        assert release.reason == "load_limit"
        assert release.force_N == pytest.approx(limit_N, rel=1e-12)
        assert release.force_N >= limit_N
        assert release.qvel_before == release.qvel_after
        assert free.time[at - 1] < release.time_s < free.time[at]
        assert [phase.reason for phase in run.phases] == ["start", "release"]
        assert run.grasps[0].release_s == release.time_s
        assert run.grasps[0].peak_force_N <= limit_N
        times.append(release.time_s)
    assert times[0] == pytest.approx(times[1], abs=1e-9)


PAIR = """<mujoco>{head}<worldbody><body name="{body}"><joint name="x" type="slide" axis="1 0 0"/>
  <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/><site name="{site}"/></body></worldbody>{motor}</mujoco>"""


def test_it_opens_at_the_tick_whose_efforts_are_too_large(tmp_path):
    """A force f on 3 kg that hold 1 kg gives a load of f / 4: with 1 N more at each tick 2.1 N are exceeded at 9 N."""
    motor = '<actuator><motor name="x" joint="x"/></actuator>'
    path = scene(
        tmp_path,
        PAIR.format(head=HEAD, body="cart", mass=3, site="hook", motor=motor),
        {"load": PAIR.format(head=HEAD, body="load", mass=1, site="ring", motor="")},
        duration_s=0.15,
        control_period_s=0.01,
        grasps={"grasp": {"robot_site": "hook", "object_site": "ring", "when": ANY, "load_limit": {"force_N": 2.1}}},
        contacts={"rules": []},
        phases=[{"name": "pull", "until": "end", "arm": ["grasp"], "controller": {"kind": "driven"}}],
    )
    run = proved(ffsm_mj.run(path, controllers=driven_by(lambda time_s: (1.0 + round(time_s / 0.01),))))
    (release,) = run.records["releases"]
    assert release.time_s == pytest.approx(0.08, abs=1e-12)
    assert release.force_N == pytest.approx(9.0 / 4.0, rel=1e-13)
    assert run["contact.grasp_closed"][-1] == 0.0


def test_a_limit_that_is_not_reached_changes_nothing(tmp_path):
    one, other = (
        ffsm_mj.run(swinging(tmp_path / str(k), "hinge", limit)) for k, limit in enumerate((None, {"force_N": 1e3}))
    )
    for key in one.keys:
        np.testing.assert_array_equal(one[key], other[key])


def test_a_limit_states_something(tmp_path):
    with pytest.raises(InputError, match=r"grasps.grasp.load_limit.* needs one limit at least: force_N, torque_N_m"):
        prepare(swinging(tmp_path, "rigid", {"force_N": None}))
