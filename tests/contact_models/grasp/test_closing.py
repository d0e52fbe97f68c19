"""A grasp closes while other things happen: the hand presses on what it takes, impacts, an arm on its joint stop."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.grasp.latch_joints import relative_twist_rows, stopped_components
from ffsm_mj.log.scenario import compile_log
from tests.contact_models.grasp.scenes import ARM, OFF, grasping
from tests.contact_models.impact.test_fixed import slab
from tests.contact_models.limits import driven_by
from tests.replays import proved
from tests.scenes import HEAD, ball, scene

pytestmark = pytest.mark.usefixtures("example_contact_models")

PUSH = {"kind": "pd", "joints": ["robot/x", "robot/y", "robot/z"], "kp": 3.0, "kd": 0.5, "target": [3.0, 0.0, 0.0]}
OWN = "ball-crate/crate"
CRATE = f"""<mujoco>{HEAD}<worldbody><body name="crate">
  <inertial pos="0.02 -0.01 0.015" mass="3" diaginertia="0.05 0.06 0.07"/><freejoint name="free"/>
  <geom name="crate" type="box" size="0.2 0.2 0.2" mass="0"/><site name="handle" pos="-0.2 0.02 0.03"/>
  </body></worldbody></mujoco>"""


def pushing(folder, within, *, restitution=0.0, others=None, fixed=None, pairs=(), **changes):
    """A hand with three motors pushes a free crate off its centre; a grasp is armed while it presses, and let go later."""
    folder.mkdir(exist_ok=True)
    return scene(
        folder,
        ball("ball", mass=2.0, joints="xyz"),
        {"crate": CRATE, **(others or {})},
        fixed=fixed,
        **{
            "duration_s": 0.12,
            "initial": {
                "joints": {"crate/free": [0.3004, -0.03, 0.04, 1, 0, 0, 0]},
                "rates": {"robot/x": 0.5, "robot/y": 0.05, "crate/free": [0, 0, 0, 0.02, 0.03, -0.01]},
            },
            "contacts": {"rules": [{"between": ["ball", "crate/crate"], "restitution": restitution}, *pairs]},
            "grasps": {"grasp": {"robot_site": "robot/centre", "object_site": "handle", "when": {"within": within}}},
            "phases": [
                {"name": "press", "for_s": 0.03, "controller": PUSH},
                {"name": "latch", "until": "grasp", "arm": ["grasp"], "for_s": 0.04, "controller": PUSH},
                {"name": "carry", "for_s": 0.03, "controller": PUSH},
                {"name": "leave", "until": "end", "release": ["grasp"], "controller": PUSH},
            ],
        }
        | changes,
    )


def stone(restitution=0.0, **initial):
    """A third body that the crate pushes before it."""
    return {
        "others": {"stone": ball("stone", mass=1.5)},
        "pairs": [{"name": "late", "between": ["crate/crate", "stone/stone"], "restitution": restitution}],
        "initial": {
            "joints": {"crate/free": [0.3, -0.03, 0.04, 1, 0, 0, 0], "stone/free": [0.6, 0.03, -0.02, 1, 0, 0, 0]},
            "rates": initial,
        },
    }


def floor(restitution=0.0):
    """A fixed floor on which the crate stands, and which the hand's push presses it on."""
    down = PUSH | {"target": [1.0, 0.0, -3.0]}
    return {
        "others": {"floor": slab("floor", "2 2 0.1")},
        "fixed": {"floor": {"position_m": [0, 0, -0.26]}},
        "pairs": [{"name": "late", "between": ["crate/crate", "floor/floor"], "restitution": restitution}],
        "initial": {"joints": {"robot/z": 0.34, "robot/x": 0.03, "crate/free": [0, 0, 0.04, 1, 0, 0, 0]}},
        "phases": [
            {"name": "press", "for_s": 0.03, "controller": down},
            {"name": "latch", "until": "grasp", "arm": ["grasp"], "for_s": 0.04, "controller": down},
            {"name": "carry", "for_s": 0.03, "controller": down},
            {"name": "leave", "until": "end", "release": ["grasp"], "controller": down},
        ],
    }


TICK, INSIDE = {"position_m": 0.2}, {"position_m": 0.1185}
SLIDES = {"crate/free": [0, 0, -0.2, 0, 0, 0]}
REST = {"joints": {"crate/free": [0.3, -0.03, 0.04, 1, 0, 0, 0]}, "rates": SLIDES}
CASES = {
    "at a tick": (TICK, {}),
    "inside a step": (INSIDE, {}),
    "inside a step, e = 1": (INSIDE, {"restitution": 1.0, "initial": REST}),
    "with a third body": (TICK, stone()),
    "on a floor": ({"position_m": 0.4}, floor()),
    "on a floor, e = 1": ({"position_m": 0.4}, {"restitution": 1.0} | floor(1.0)),
    "with a third body, e = 1, inside a step": (INSIDE, {"restitution": 1.0} | stone(1.0, **SLIDES)),
}
DEAR = [pytest.param(case, marks=pytest.mark.long) if "e = 1" in case else case for case in CASES]


def pressed_until(run, time_s):
    """Whether the own pair presses in the last row before a time."""
    return run["contact.ball_crate_crate_mode"][np.searchsorted(run.time, time_s) - 1] == 2.0


@pytest.mark.long
@pytest.mark.parametrize("case", DEAR)
def test_a_pair_that_presses_is_on_one_rigid_body_from_there(tmp_path, case):
    """Its contact ends at that instant; the joining is the plastic one; what is let go at gap 0 presses again."""
    within, changes = CASES[case]
    run = proved(ffsm_mj.run(pushing(tmp_path / "scene", within, **changes)))
    (capture,) = run.records["grasp_impulses"]
    assert pressed_until(run, capture.time_s)
    assert ("inside" in case) == (abs(capture.time_s / 1e-3 - round(capture.time_s / 1e-3)) > 1e-3)
    assert next(each.time_s for each in run.records["contact_endings"] if each.pair == OWN) == capture.time_s
    holding = run["contact.grasp_closed"] == 1.0
    assert holding.sum() > 25
    assert not run["contact.ball_crate_crate_mode"][holding].any()
    system = compile_log(run.log)
    before, after = (rates(system, capture, which) for which in ("qvel_before", "qvel_after"))
    np.testing.assert_allclose(after, constrained(run, capture, before), rtol=0, atol=1e-13)
    (release,) = run.records["releases"]
    begun = [each for each in run.records["contact_beginnings"] if each.pair == OWN and each.time_s == release.time_s]
    assert begun[0].force_after_N > 1.0
    assert begun[0].qvel_after == release.qvel_after


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_dispersed_starts(tmp_path, seed):
    """Offsets, drifts and tumbles of the crate, and bounds that close at ticks and inside steps; every run is right."""
    rng = np.random.default_rng(seed)
    position = np.array((0.3004, 0.0, 0.0)) + rng.uniform(-1, 1, 3) * (1e-4, 0.06, 0.06)
    start = {
        "joints": {"crate/free": [*position.tolist(), 1, 0, 0, 0]},
        "rates": {
            "robot/x": 0.5,
            "robot/y": float(rng.uniform(-0.05, 0.05)),
            "crate/free": rng.uniform(-0.03, 0.03, 6).tolist(),
        },
    }
    offset = float(np.hypot(position[1] + 0.02, position[2] + 0.03))
    within = {"position_m": float(np.hypot(0.1, offset) * rng.uniform(0.975, 1.05))}
    run = proved(ffsm_mj.run(pushing(tmp_path / "scene", within, initial=start)))
    for capture in run.grasps:  # three slide past their bounds
        assert pressed_until(run, capture.time_s)
        assert capture.loss_J > 0.0


SITES = {"robot_site": "robot/centre", "object_site": "handle"}
STOPPED_ARM = ARM.replace(
    '<joint name="elbow" type="hinge" axis="0 1 0"/>', '<joint name="elbow" axis="0 1 0" range="-30 0"/>'
)


def rates(system, record, which):
    return np.concatenate([getattr(record, which)[name] for name in system.joints])


def constrained(run, capture, before, kind="rigid", rows=()):
    """Velocities nearest to some others in the norm of M that satisfy the rows of a grasp, and further ones."""
    system = compile_log(run.log)
    model, data = system.mj, mujoco.MjData(system.mj)
    data.qpos[:] = capture.qpos
    mujoco.mj_forward(model, data)
    robot, of_object = model.site(capture.robot_site), model.site(capture.object_site)
    point = data.site_xpos[of_object.id].copy()
    J = relative_twist_rows(model, data, int(robot.bodyid[0]), int(of_object.bodyid[0]), point)
    J = np.vstack((stopped_components(kind, np.zeros(3)) @ J, *rows))
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    saddle = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
    return np.linalg.lstsq(saddle, np.concatenate((M @ before, np.zeros(len(J)))), rcond=None)[0][: model.nv]


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_two_pairs_touch_at_one_instant_and_one_of_them_latches(tmp_path, restitution):
    """Hand and stone meet the crate from both sides at the same instant: one impact of both, then the joining.

    Where the stone then approaches the crate, which the latch has slowed down or not, a second impact of it alone follows
    at that instant, on hand and crate as one body.
    """
    stone = {"between": ["crate/crate", "stone/stone"], "restitution": restitution}
    path = pushing(
        tmp_path,
        {},
        restitution=restitution,
        others={"stone": ball("stone", mass=1.0)},
        pairs=[stone],
        grasps={"grasp": {**SITES, "when": {"touch": ["ball-crate/crate"]}}},
        initial={
            "joints": {"robot/x": -0.35, "crate/free": [0, 0, 0, 1, 0, 0, 0], "stone/free": [0.35, 0, 0, 1, 0, 0, 0]},
            "rates": {"robot/x": 0.5, "stone/free": [-0.5, 0, 0, 0, 0, 0]},
        },
        phases=[{"name": "all", "until": "end", "arm": ["grasp"], "controller": OFF}],
        duration_s=0.2,
    )
    run = proved(ffsm_mj.run(path))
    system, (capture,) = compile_log(run.log), run.records["grasp_impulses"]
    first, second, *later = run.records["impacts"]
    assert first.event == second.event
    assert first.time_s == second.time_s == capture.time_s == pytest.approx(0.1, abs=1e-9)
    assert capture.qvel_before == first.qvel_after
    before, after = rates(system, capture, "qvel_before"), rates(system, capture, "qvel_after")
    # The saddle system of the comparison has moments of 1e-3 beside masses of 3: some hundred roundings.
    np.testing.assert_allclose(after, constrained(run, capture, before), rtol=0, atol=1e-13)
    crate, others = system.joint("crate/free").dofs.start, system.joint("stone/free").dofs.start
    for hit in later:
        assert hit.time_s == capture.time_s
        assert set(hit.geoms) == {"crate/crate", "stone/stone"}
        after = rates(system, hit, "qvel_after")
    assert after[others] - after[crate] >= -1e-15
    assert np.all(np.diff(run["energy.total_J"]) <= 1e-14)


@pytest.mark.long
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("kind", ["rigid", "ball"])
def test_an_arm_on_its_stop_takes_what_pushes_it_further(tmp_path, kind, restitution):
    """The elbow is pressed on its stop; the object that is latched drives it further: an impact at the stop, at once.

    With e = 0 both together are one plastic impact on the rows of the latch and of the stop, in any order.
    """
    path = grasping(
        tmp_path,
        robot=STOPPED_ARM,
        grasps={
            "grasp": {"robot_site": "grip", "object_site": "handle", "joint": kind, "when": {"within": {"position_m": 0.05}}}
        },
        joint_limits={"elbow": {"restitution": restitution}},
        initial={
            "joints": {"target/free": [1.05, -0.01, 0.078, 1, 0, 0, 0]},
            "rates": {"target/free": [0.0, 0, -0.3, 0.2, -0.1, 0.1]},
        },
        phases=[{"name": "all", "until": "end", "arm": ["grasp"], "controller": {"kind": "driven"}}],
        duration_s=0.3,
    )
    run = proved(ffsm_mj.run(path, controllers=driven_by(lambda _: (0.0, 0.05))))
    system, (capture,) = compile_log(run.log), run.records["grasp_impulses"]
    assert capture.time_s > 0.1
    at = int(np.searchsorted(run.time, capture.time_s))
    assert run["contact.robot_elbow_limit"][at - 1] == 2.0  # pressed
    elbow = system.joint("elbow").dofs.start
    assert rates(system, capture, "qvel_after")[elbow] > 0.01  # past the stop, were there no impact
    stop = run.records["limit_impacts"][0]
    assert stop.time_s == capture.time_s
    assert stop.qvel_before == capture.qvel_after
    before, after = rates(system, capture, "qvel_before"), rates(system, stop, "qvel_after")
    if restitution == 0.0:
        row = np.eye(system.mj.nv)[elbow][None]
        np.testing.assert_allclose(after, constrained(run, capture, before, kind, [row]), rtol=0, atol=1e-13)
        assert run["contact.robot_elbow_limit"][at] in (1.0, 2.0)
    else:
        assert after[elbow] == pytest.approx(-0.5 * rates(system, capture, "qvel_after")[elbow], rel=1e-12)
    assert run["state.q_robot_elbow_rad"].max() <= 1e-9


@pytest.mark.parametrize("kind", ["ball", "cylindrical"])
def test_a_pair_that_presses_stays_active_in_a_latch_with_freedom(tmp_path, kind):
    """The hand pushes the crate along x: on a cylindrical latch along x by the contact alone, the latch cannot."""
    axis = {"axis": [1.0, 0.0, 0.0]} if kind == "cylindrical" else {}
    grasps = {"grasp": {**SITES, "joint": kind, **axis, "when": {"within": {"position_m": 0.1185}}}}
    run = proved(ffsm_mj.run(pushing(tmp_path, {}, grasps=grasps)))
    (capture,) = run.records["grasp_impulses"]
    assert pressed_until(run, capture.time_s)
    holding = run["contact.grasp_closed"] == 1.0
    if kind == "cylindrical":
        assert np.all(run["contact.ball_crate_crate_mode"][holding] == 2.0)
        assert np.abs(run["contact.grasp_force_x_N"]).max() < 1e-12
        assert run["contact.ball_crate_crate_force_N"][holding].min() > 1.0
