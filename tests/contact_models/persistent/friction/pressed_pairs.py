"""Random scenes of two bodies, one of them round, that meet slowly and are pressed on each other by a constant force."""

from __future__ import annotations

import json
from typing import NamedTuple

import mujoco
import numpy as np

from ffsm_mj.assembly.prepare import prepare
from tests.contact_models.persistent.friction.scenes import load, loaded, steps
from tests.scenes import HEAD, scene

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
