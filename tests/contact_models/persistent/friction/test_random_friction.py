"""Random pushes with friction: every check passes, energy grows by efforts alone, and the log says what its states say."""

from __future__ import annotations

import dataclasses
import json
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.contact_models.persistent import random_pushes
from tests.contact_models.persistent.friction.scenes import load, loaded, steps
from tests.contact_models.persistent.random_pushes import LAWS, drawn, quaternion
from tests.contact_models.persistent.test_random_pushes import wrong
from tests.scenes import HEAD, scene

ROUND_MU = (0.01, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5)


def rubbed(seed, folder):
    """A scene of random pushes with a coefficient of friction for each pair: a round number, or an odd one."""
    path = drawn(np.random.default_rng(seed), folder)
    scenario, rng = json.loads(path.read_text()), np.random.default_rng(seed + 10**6)
    for rule in scenario["contacts"]["rules"]:
        rule["mu"] = float(rng.choice(ROUND_MU)) if rng.random() < 0.5 else float(rng.uniform(0, 1))
    path.write_text(json.dumps(scenario))
    return path


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("seed", [seed for seed in range(60) if seed not in (19, 53)])  # these take 7 s and more
def test_random_pushes_with_friction(tmp_path, seed):
    assert wrong(rubbed(seed, tmp_path)) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(300, 320))
def test_efforts_that_jump_at_every_tick(tmp_path, seed):
    assert wrong(random_pushes.jumping(rubbed(seed, tmp_path), np.random.default_rng(seed))) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5, 6, 7, 8, 9, 11, 12, 14, 16, 17, 18])  # the others take up to 40 s each
def test_turned_boosted_and_reordered_scenes_are_the_same(tmp_path, seed):
    """They differ by less than if a pad moves faster by 1e-9 m/s: ten times the gap rates that are left as drift."""
    rng = np.random.default_rng(seed)
    path = random_pushes.jumping(rubbed(seed, tmp_path), rng)

    def states(change):
        changed = tmp_path / "changed.yaml"
        changed.write_text(json.dumps(change(random_pushes.said_by(path))))
        return random_pushes.seen_by_the_robot(ffsm_mj.run(changed, controllers=LAWS))

    turn, velocity, own = quaternion(rng), rng.uniform(-1, 1, 3), states(dict)
    others = [lambda said: random_pushes.turned(said, turn), lambda said: random_pushes.reordered(said, tmp_path)]
    if "wall" not in random_pushes.said_by(path)["objects"]:
        others.append(lambda said: random_pushes.boosted(said, velocity))
    allowed = np.abs(states(lambda said: random_pushes.faster(said, 1e-9)) - own).max()
    assert 1e-10 < allowed < 1e-5
    for other in others:
        assert np.abs(states(other) - own).max() < allowed


def stated(path, folder, mu):
    """The same scene with a coefficient of friction in every rule."""
    scenario = json.loads(path.read_text())
    for rule in scenario["contacts"]["rules"]:
        rule["mu"] = mu
    other = folder / "stated.yaml"
    other.write_text(json.dumps(scenario))
    return other


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(6, 16))])
def test_mu_of_zero_is_bit_for_bit_the_run_without(tmp_path, seed):
    """Rows and records of scenes of up to three pairs that hit, press and open."""
    path = drawn(np.random.default_rng(seed), tmp_path)
    without = ffsm_mj.run(path, controllers=LAWS)
    zero = ffsm_mj.run(stated(path, tmp_path, 0.0), controllers=LAWS)
    assert without.keys == zero.keys
    np.testing.assert_array_equal(without.log.rows, zero.log.rows)
    for kind, records in without.records.items():
        for one, other in zip(records, zero.records[kind], strict=True):
            assert repr(dataclasses.asdict(one)) == repr(dataclasses.asdict(other))


ROUND, KINDS = ("cylinder", "cylinder", "ellipsoid"), ("cylinder", "cylinder", "ellipsoid", "capsule", "sphere", "box")
RIGHT_DEG = (0, 90, 90, 180, 45)
TILTS_RAD = (0.0, 0.0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-3, 0.1)
"""Bodies lie flat or along each other, or nearly so."""
STEPS_S = (5e-4, 1e-3, 2e-3)


class Pose(NamedTuple):
    """Where the two bodies start: orientations, and the position of the first from the second on a line towards it."""

    own: list[float]
    other: list[float]
    towards: np.ndarray
    place: np.ndarray


def pressed(rng, folder, *, friction, count=16):
    """A scene of so many steps."""
    kinds = [str(rng.choice(ROUND)), str(rng.choice(KINDS))]
    if rng.random() < 0.5:
        kinds.reverse()
    fixed = bool(rng.random() < 0.5)
    bodies = body(rng, "one", kinds[0], free=True), body(rng, "other", kinds[1], free=not fixed)
    pose = posed(rng)
    velocity = -rng.choice([0.0, 0.03, 0.2]) * pose.towards + rng.choice([0.0, 0.05]) * rng.normal(size=3)
    spin = rng.choice([0.0, 0.0, 0.5]) * rng.normal(size=3)
    press = -rng.uniform(3.0, 30.0) * pose.towards
    start = {"robot/free": [*pose.place.tolist(), *pose.own]}
    if not fixed:
        start["other/free"] = [0.0, 0.0, 0.0, *pose.other]
    mu = float(rng.choice([0.1, 0.3, 0.7, 1.0]) if rng.random() < 0.7 else rng.uniform(0, 1)) if friction else 0.0
    rule = {"name": "pair", "between": ["robot/one", "other/other"], "mu": mu}
    step = float(rng.choice(STEPS_S))
    path = scene(
        folder,
        bodies[0],
        {"other": bodies[1]},
        fixed={"other": {"position_m": [0.0, 0.0, 0.0], "quaternion": pose.other}} if fixed else {},
        contacts={"rules": [rule | {"restitution": float(rng.choice([0.0, 0.3, 0.5, 0.7]))}]},
        initial={"joints": start, "rates": {"robot/free": [*velocity.tolist(), *spin.tolist()]}},
        contact_models=loaded(load("robot/one", "other/other", force_N=[press.tolist()])),
        **steps(step, count * step),
    )
    approach(path, pose.towards, float(rng.choice([1e-12, 1e-5, 1e-4])))
    return path


def body(rng, name, kind, *, free):
    """MJCF of one body of some size."""
    a, b, c = 0.1 * rng.uniform(0.5, 1.5, 3)
    size = {"sphere": (a,), "capsule": (a, b), "cylinder": (a, b)}.get(kind, (a, b, c))
    mass = rng.uniform(0.5, 3.0)
    inertia = " ".join(map(str, mass * 0.005 * rng.uniform(0.8, 1.2, 3)))
    return f"""<mujoco>{HEAD}<worldbody><body name="{name}">{'<freejoint name="free"/>' if free else ""}
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/>
      <geom name="{name}" type="{kind}" size="{" ".join(map(str, size))}" mass="0"/></body></worldbody></mujoco>"""


def posed(rng):
    """Orientations that differ by right angles and a small tilt, or at will; a line through the second body."""
    other = turn([1, 0, 0], 0.0) if rng.random() < 0.4 else unit(rng.normal(size=4))
    angles = rng.choice(RIGHT_DEG, 3) if rng.random() < 0.7 else rng.uniform(-180, 180, 3)
    own = other
    for axis, angle in zip(np.eye(3), np.radians(angles), strict=True):
        own = product(own, turn(axis, angle))
    own = unit(product(own, turn(unit(rng.normal(size=3)), float(rng.choice(TILTS_RAD)))))
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, other)
    local = rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)] if rng.random() < 0.7 else unit(rng.normal(size=3))
    towards = matrix.reshape(3, 3) @ local
    aside = matrix.reshape(3, 3) @ (rng.uniform(-0.08, 0.08, 3) * rng.choice([0.0, 1.0]))
    return Pose(own.tolist(), other.tolist(), towards, 0.6 * towards + aside - aside @ towards * towards)


def turn(axis, angle):
    """Quaternion of a turn about an axis, rad."""
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.asarray(axis, float), float(angle))
    return quaternion


def product(p, q):
    """Product of two quaternions."""
    both = np.empty(4)
    mujoco.mju_mulQuat(both, p, q)
    return both


def unit(vector):
    """A vector of length 1."""
    return vector / np.linalg.norm(vector)


def approach(path, towards, wanted):
    """Move the first body towards the second to a gap in m, or past it if they miss each other."""
    said = json.loads(path.read_text())
    parts = prepare(path).assemble()
    model, data = parts.system.mj, parts.data
    at, place = model.joint("robot/free").qposadr[0], np.array(said["initial"]["joints"]["robot/free"][:3])
    geoms = model.geom("robot/one").id, model.geom("other/other").id

    def excess(shift):
        data.qpos[at : at + 3] = place - shift * towards
        mujoco.mj_kinematics(model, data)
        return mujoco.mj_geomDistance(model, data, *geoms, 9.0, None) - wanted

    low = high = 0.0
    while excess(high) > 0.0 and high < 0.6:
        low, high = high, high + 0.01
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    said["initial"]["joints"]["robot/free"][:3] = (place - low * towards).tolist()
    path.write_text(json.dumps(said))


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("seed", range(60))
def test_pressed_pairs(tmp_path, seed, friction):
    """Round bodies that are pressed on each other or on boxes: nothing but the end of the run ends it."""
    assert wrong(pressed(np.random.default_rng(seed), tmp_path, friction=friction), completes=True) == []
