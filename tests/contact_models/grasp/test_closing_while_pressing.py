"""A grasp closes by its bounds while the hand presses on what it takes: at a tick, inside a step, with others."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.grasp.latch_joints import relative_twist_rows
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from tests.contact_models.impact.test_fixed import slab
from tests.replays import proved
from tests.scenes import HEAD, ball, scene

pytestmark = pytest.mark.usefixtures("example_contact_models")

PUSH = {"kind": "pd", "joints": ["robot/x", "robot/y", "robot/z"], "kp": 3.0, "kd": 0.5, "target": [3.0, 0.0, 0.0]}
OFF = {"kind": "off"}
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


def plastic(folder, qpos, qvel):
    """Velocities after the plastic joining of hand and crate, from the minimum of the kinetic energy of the change."""
    objects = {path.stem: read_model(path) for path in folder.glob("*.xml") if path.stem not in ("robot", "floor")}
    system = compile_system(read_model(folder / "robot.xml"), objects, time_step_s=1e-3)
    model, data = system.mj, mujoco.MjData(system.mj)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    hand, crate = system.index("body", "robot/ball"), system.index("body", "crate/crate")
    J = relative_twist_rows(model, data, hand, crate, data.site_xpos[system.index("site", "crate/handle")])
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    saddle = np.block([[M, J.T], [J, np.zeros((6, 6))]])
    return np.linalg.lstsq(saddle, np.concatenate((M @ qvel, np.zeros(6))), rcond=None)[0][: model.nv]


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
    before, after = (np.concatenate(list(each.values())) for each in (capture.qvel_before, capture.qvel_after))
    np.testing.assert_allclose(after, plastic(tmp_path / "scene", capture.qpos, before), atol=1e-14)
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
