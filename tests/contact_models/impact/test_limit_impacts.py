"""Impacts at joint limits: closed forms, Pinocchio, one problem with contacts of geoms, and the log of it all."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.impact.resolution import contact_jacobian
from ffsm_mj.errors import InputError
from ffsm_mj.impact import Contact, LimitContact, resolve
from ffsm_mj.replay import replay_log
from tests.changed_logs import with_records
from tests.conftest import MJCF
from tests.contact_models.limits import DRIVEN, INERTIA, SPAN, bounces, driven_by, failures, rotor
from tests.model.test_pinocchio import oracle, to_pinocchio
from tests.replays import proved
from tests.scenes import ARM, HEAD, ball, compile_paths, scene


def test_fifty_elastic_hits_between_two_stops(tmp_path):
    """Hit k is at (1 + 2 k) span / rate, to 1e-10: 50 hits, each located to 1e-14 rad, at 20 rad/s."""
    run = ffsm_mj.run(rotor(tmp_path, 1.0, duration_s=2.7))
    hits = run.records["limit_impacts"][:50]
    assert len(hits) == 50
    np.testing.assert_allclose([hit.time_s for hit in hits], [(1 + 2 * k) * SPAN / 20.0 for k in range(50)], atol=1e-10)
    assert [hit.side for hit in hits] == ["upper", "lower"] * 25
    for hit in hits:
        assert hit.separation_rate == pytest.approx(20.0, abs=1e-10)
        assert hit.impulse == pytest.approx(2 * INERTIA * 20.0, abs=1e-10)
        assert hit.value == pytest.approx(hit.limit, abs=1e-10)
        assert hit.unit == "rad"
    proved(run)


def test_fifty_hits_of_a_driven_rotor_that_loses_half_its_rate(tmp_path):
    """A torque that turns round every 0.3 s throws the rotor to and fro; the hits are joined parabolas, to 1e-10."""
    torques = np.repeat([1.5, -1.5] * 24, 3)
    law = driven_by(lambda t: torques[min(round(t / 0.1), len(torques) - 1)])
    changes = {"control_period_s": 0.1, "duration_s": 14.0, "impact": {"rest_interval_s": 0.0}, "phases": DRIVEN}
    run = ffsm_mj.run(rotor(tmp_path, 0.5, rate=3.0, **changes), controllers=law)
    hits = run.records["limit_impacts"][:50]
    expected = bounces(0.5, torques, 0.1, rate=3.0, count=50)
    assert len(hits) == 50
    np.testing.assert_allclose([hit.time_s for hit in hits], expected[:, 0], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose([hit.approach_rate for hit in hits], expected[:, 1], rtol=0.0, atol=1e-9)
    assert [hit.side for hit in hits] == ["lower" if side < 0.0 else "upper" for side in expected[:, 2]]
    proved(run)


def test_several_hits_within_one_step(tmp_path):
    """At 2000 rad/s the rotor hits a stop every 0.5 ms; steps of 10 ms miss none, and the joint never leaves its range."""
    run = ffsm_mj.run(rotor(tmp_path, 1.0, rate=2000.0, time_step_s=0.01, control_period_s=0.01, duration_s=0.1))
    assert len(run.records["limit_impacts"]) == math.floor((0.1 * 2000.0 / SPAN + 1) / 2)
    proved(run)


def test_limits_that_are_ignored_stop_nothing(tmp_path):
    path = rotor(tmp_path, 1.0, duration_s=0.2)
    path.write_text(
        path.read_text().replace('"robot.xml"', '"robot.xml", "limits": "ignore"').replace('"hinge": {"rest', '"x": {"rest')
    )
    with pytest.raises(InputError, match=r"joint_limits\.x: unknown joint 'x'"):
        ffsm_mj.run(path)
    path.write_text(path.read_text().replace('"joint_limits": {"x": {"restitution": 1.0}}', '"joint_limits": {}'))
    run = ffsm_mj.run(path)
    assert run["state.q_robot_hinge_rad"][-1] == pytest.approx(4.0)
    assert "limit_impacts" not in run.records
    proved(run)


ROBOTS = [("ffsm_3dof", "box_1m"), ("spacecraft_7dof", "satellite_defunct")]


@pytest.mark.parametrize(("robot", "target"), ROBOTS)
def test_pinocchio_agrees_on_contacts_and_limits_at_one_instant(robot, target, rng):
    """Stacked rows of one or two contacts and of two joints at their limits: plastic impacts with positive impulses.

    Pinocchio solves the equality J v+ = 0; where its impulses are positive that is the plastic impact. Both solutions have
    errors of 1e-16 times the condition of the stacked problem, some 1e3.
    """
    system = compile_paths(MJCF / f"{robot}.xml", {"object": MJCF / f"{target}.xml"})
    model = system.mj
    reference, _ = oracle(model)
    other, data = reference.createData(), mujoco.MjData(model)
    tip, root = int(model.site_bodyid[system.index("site", "tip")]), system.objects[0].root
    hinges = [joint.dofs.start for joint in system.robot.joints if joint.kind == "hinge" and joint.body != system.robot.root]
    planar = robot == "ffsm_3dof"
    compared = 0
    for _ in range(400):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-2, 2, model.nv), 1.0)
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        point, normal = rng.uniform(-1, 1, 3), rng.normal(size=3)
        if planar:
            point[2] = normal[2] = 0.0
        normal /= np.linalg.norm(normal)
        contacts = [
            Contact(tip, root, point, normal, 0.0),
            *(LimitContact(int(dof), float(rng.choice((-1.0, 1.0)))) for dof in rng.choice(hinges, 2, replace=False)),
        ]
        q, v, X = to_pinocchio(model, data.qpos, data.qvel)
        J = np.stack([contact_jacobian(model, data, contact) for contact in contacts]) @ np.linalg.inv(X)
        after = pin.impulseDynamics(reference, other, q, v, J, 0.0)
        if np.any(np.asarray(other.impulse_c) <= 0.0):
            continue
        impact = resolve(model, data, contacts)
        np.testing.assert_allclose(X @ impact.after.qvel, after, atol=1e-11 * (1.0 + np.abs(after).max()))
        np.testing.assert_allclose(impact.impulses, other.impulse_c, atol=1e-10 * (1.0 + np.abs(other.impulse_c).max()))
        compared += 1
    assert compared > 20


def at_once(folder, mu=0.0, law="blend", e=0.3):
    """At t = 0 the finger of an arm touches a ball that flies into it, and its elbow reaches the upper limit."""
    arm = ARM.replace('name="elbow" axis="0 0 1"', 'name="elbow" axis="0 0 1" range="-60 30"')
    system = compile_from(folder, arm)
    data = mujoco.MjData(system.mj)
    data.qpos[system.joint("shoulder").qpos], data.qpos[system.joint("elbow").qpos] = -0.4, math.radians(30.0)
    mujoco.mj_forward(system.mj, data)
    tip = data.geom_xpos[system.index("geom", "tip")]
    pair = {"between": ["tip", "ball/ball"], "restitution": e, "mu": mu}
    return scene(
        folder,
        arm,
        {"ball": ball("ball")},
        duration_s=0.05,
        initial={
            "joints": {
                "shoulder": -0.4,
                "elbow": math.radians(30.0),
                "ball/free": [*(tip + 0.15 * np.array((0.6, -0.8, 0.0))).tolist(), 1, 0, 0, 0],
            },
            "rates": {"elbow": 1.0, "ball/free": [-0.5, 0.9, 0.1, 0, 0, 2.0]},
        },
        contacts={"rules": [pair]},
        impact={"law": law},
        joint_limits={"elbow": {"restitution": e}},
    )


def compile_from(folder, robot):
    (folder / "alone.xml").write_text(robot)
    return compile_paths(folder / "alone.xml")


@pytest.mark.parametrize(
    ("mu", "law", "e"), [(0.0, "blend", 0.0), (0.0, "newton", 0.6), (0.0, "poisson", 0.6), (0.3, "blend", 0.3)]
)
def test_a_contact_and_a_limit_at_one_instant_are_one_problem(tmp_path, mu, law, e):
    """Records of both share the event; with Newton's law and equal e both separate at e times their approach."""
    run = ffsm_mj.run(at_once(tmp_path, mu, law, e))
    (hit,), (stop,) = run.impacts[:1], run.records["limit_impacts"][:1]
    assert (hit.event, hit.time_s, hit.qvel_before) == (stop.event, stop.time_s, stop.qvel_before)
    assert hit.impulse_N_s > 0.0
    assert stop.impulse > 0.0
    if law == "newton" or e == 0.0:
        assert hit.separation_speed_m_s == pytest.approx(e * hit.approach_speed_m_s, abs=1e-12)
        assert stop.separation_rate == pytest.approx(e * stop.approach_rate, abs=1e-12)
    assert hit.energy_change_J < 0.0
    proved(run)
    assert [each["event"] for each in run.summary()["limit_impacts"]][:1] == [0]


def test_until_impact_and_stop_on_impact_wait_for_geoms(tmp_path):
    """A joint at its limit is no impact of the task; a hit of geoms is."""
    rod = ROD
    initial = {
        "joints": {"ball/free": [1.2, 0.0, 0.0, 1, 0, 0, 0]},
        "rates": {"hinge": 20.0, "ball/free": [-1.0, 0, 0, 0, 0, 0]},
    }
    off = {"kind": "off"}
    phases = [{"name": "wait", "until": "impact", "controller": off}, {"name": "after", "until": "end", "controller": off}]
    changes = {
        "initial": initial,
        "contacts": {"rules": [{"between": ["hull", "ball/ball"]}]},
        "joint_limits": {"hinge": {"restitution": 1.0}},
    }
    path = scene(tmp_path, rod, {"ball": ball("ball")}, duration_s=1.2, phases=phases, **changes)
    run = ffsm_mj.run(path)
    assert run.records["limit_impacts"][0].time_s < 0.1
    assert run.phases[1].start_s == run.impacts[0].time_s == pytest.approx(1.0, abs=1e-9)
    assert ffsm_mj.run(path, {"stop_on_impact": True}).time[-1] == run.impacts[0].time_s
    proved(run)


ROD = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/><geom name="hull" size="0.1" mass="0"/>
  <body name="rotor"><joint name="hinge" axis="0 0 1" range="-30 30"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.02"/></body></body></worldbody></mujoco>"""


def test_a_changed_log_is_detected(tmp_path):
    run = ffsm_mj.run(rotor(tmp_path, 0.5, duration_s=0.3))
    log = run.log
    first, *rest = log.records["limit_impacts"]
    assert replay_log(log).agrees
    for changed in (
        replace(first, impulse=first.impulse * (1 + 1e-8)),
        replace(first, separation_rate=first.separation_rate + 1e-8),
        replace(first, side="lower"),
        replace(first, restitution=0.4),
        replace(first, joint="robot/free"),
        replace(first, qvel_after=first.qvel_before),
    ):
        records = {**log.records, "limit_impacts": (changed, *rest)}
        assert not replay_log(with_records(log, records)).agrees
    # A missing hit, and one that was not.
    assert not replay_log(with_records(log, {"limit_impacts": tuple(rest)})).agrees
    more = replace(rest[-1], event=rest[-1].event + 1, time_s=0.29, step=289)
    assert not replay_log(with_records(log, {"limit_impacts": (first, *rest, more)})).agrees
    # The work that the record claims is checked against the change of energy.
    forged = replace(first, impulse=first.impulse * 1.01)
    run = ffsm_mj.Run(with_records(log, {"limit_impacts": (forged, *rest)}))
    assert failures(all_checks(run)) == {"impact energy"}
