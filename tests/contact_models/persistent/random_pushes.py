"""Random scenes of bodies that are pushed against each other."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import StrictModel
from ffsm_mj.errors import InputError
from tests.laws import Law
from tests.scenes import HEAD, scene

STEPS_S = (5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
RESTITUTIONS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)


class PushesConfig(StrictModel):
    """Efforts of all motors, row by row, each held for some time."""

    kind: Literal["pushes"]
    efforts: tuple[tuple[float, ...], ...]
    hold_s: float


class Pushes(Law):
    """Whatever it is told: efforts that jump."""

    Config = PushesConfig

    def __init__(self, config, context):
        self._efforts, self._hold_s = config.efforts, config.hold_s
        self._motors = range(context.system.mj.nu)

    def control(self, observation, command):
        row = min(int(observation.time_s / self._hold_s + 1e-9), len(self._efforts) - 1)
        command.drive(list(self._motors), np.array(self._efforts[row]))


LAWS = {"pushes": Pushes}


def geom(rng, name, kind, size=0.1):
    """A geom of a kind and about this size, turned at will."""
    a, b, c = size * rng.uniform(0.5, 1.5, 3)
    several = f"{a} {b} {c}"
    sizes = {"sphere": f"{a}", "capsule": f"{a} {b}", "cylinder": f"{a} {b}", "box": several, "ellipsoid": several}[kind]
    turn = "0 0 0" if rng.random() < 0.4 else " ".join(str(x) for x in rng.uniform(-90, 90, 3))
    return f'<geom name="{name}" type="{kind}" size="{sizes}" euler="{turn}" mass="0"/>'


def drawn(rng, folder, *, step=None, steps=40, kinds=("sphere", "capsule", "box")):
    """The first of some scenes whose pairs do not overlap at the start."""
    while True:
        try:
            path = _drawn(rng, folder, step, steps, kinds)
            prepare(path, controllers=LAWS)
        except InputError as error:
            assert "overlap" in str(error)  # noqa: PT017 (the only refusal that there may be)
        else:
            return path


def _drawn(rng, folder, step, steps, kinds):
    """A free base with two pushers on slides, a free body before each or both, perhaps a fixed wall behind; 1 to 3 pairs."""
    step = step or float(rng.choice(STEPS_S))
    pick = lambda: str(rng.choice(kinds))  # noqa: E731
    body_kind = pick()
    rods = ""
    for side, y in (("left", 0.06), ("right", -0.06)):
        # A pad on the end of a hinge, or straight on the slide.
        joint = f'<joint name="{side}" type="slide" axis="1 0 0"/>'
        if rng.random() < 0.3:
            joint += f'<joint name="{side}_turn" axis="0 {rng.uniform(-1, 1)} 1"/>'
        rods += f"""<body name="{side}" pos="0 {y} 0"><inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.012 0.013"/>
          {joint}{geom(rng, side, pick(), 0.05)}</body>"""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="-0.3 0 0" mass="4" diaginertia="0.5 0.6 0.7"/>{rods}</body></worldbody>
      <actuator><motor name="push_left" joint="left"/><motor name="push_right" joint="right"/></actuator></mujoco>"""
    objects = {"block": free_body(rng, "block", body_kind, 0.15)}
    other = str(rng.choice(["none", "wall", "second", "second"]))
    fixed = {}
    start = {"block/free": [0.4, *rng.uniform(-0.05, 0.05, 2), *quaternion(rng)]}
    pairs = [("left", "block/block")]
    if rng.random() < 0.6:
        pairs.append(("right", "block/block"))
    if other == "wall":
        objects["wall"] = f'<mujoco>{HEAD}<worldbody><geom name="wall" type="box" size="0.1 2 2"/></worldbody></mujoco>'
        fixed["wall"] = {"position_m": [0.8, 0.0, 0.0]}
        pairs.append(("block/block", "wall/wall"))
    elif other == "second":
        objects["second"] = free_body(rng, "second", pick(), 0.1)
        start["second/free"] = [0.8, *rng.uniform(-0.05, 0.05, 2), *quaternion(rng)]
        pairs.append(("block/block", "second/second"))
    rates = {
        "left": rng.uniform(0, 1),
        "right": rng.uniform(0, 1),
        "block/free": [0.0, *rng.uniform(-0.1, 0.1, 2), *(rng.choice([0.0, 1.0]) * rng.uniform(-3, 3, 3))],
        "robot/free": list(rng.choice([0.0, 1.0]) * rng.uniform(-0.3, 0.3, 6)),
    }
    duration = steps * step
    scale = float(10.0 ** rng.uniform(0, 2))
    efforts = scale * (rng.uniform(-0.3, 1.0, (6, 2)))
    path = scene(
        folder,
        robot,
        objects,
        fixed=fixed,
        duration_s=duration,
        time_step_s=step,
        control_period_s=step,
        initial={
            "joints": start,
            "rates": {k: v if isinstance(v, float) else list(map(float, v)) for k, v in rates.items()},
        },
        contacts={"rules": [{"between": list(pair), "restitution": float(rng.choice(RESTITUTIONS))} for pair in pairs]},
        phases=[
            {
                "name": "push",
                "until": "end",
                "controller": {"kind": "pushes", "efforts": efforts.tolist(), "hold_s": duration / 6},
            }
        ],
    )
    approach(path, rng)
    return path


def approach(path, rng):
    """Move the block along x towards the pads, and what is behind it towards the block, to a gap that is drawn."""
    said = json.loads(path.read_text())
    parts = prepare(path, controllers=LAWS).assemble()
    model, data = parts.system.mj, parts.data
    block = model.joint("block/free").qposadr[0]

    def gap(*pairs):
        mujoco.mj_kinematics(model, data)
        return min(mujoco.mj_geomDistance(model, data, model.geom(a).id, model.geom(b).id, 9.0, None) for a, b in pairs)

    def moved(address, *pairs):
        wanted, x = float(rng.choice([1e-12, 1e-4, 3e-3, 1e-2])), data.qpos[address]

        def excess(shift):
            data.qpos[address] = x + shift
            return gap(*pairs) - wanted

        near = min((s for s in np.linspace(-0.6, 0.6, 121) if excess(s) > 0.0), key=excess)
        low = near - 0.02
        if excess(low) < 0.0 < excess(near):
            for _ in range(60):
                middle = 0.5 * (low + near)
                low, near = (low, middle) if excess(middle) > 0.0 else (middle, near)
        data.qpos[address] = x + near
        return float(data.qpos[address])

    named = [tuple(pair["between"]) for pair in said["contacts"]["rules"]]
    before = [pair for pair in named if pair[1] == "block/block"]
    start = said["initial"]["joints"]
    start["block/free"][0] = moved(block, *((f"robot/{a}", b) for a, b in before))
    if "wall" in said["objects"]:
        mujoco.mj_kinematics(model, data)
        said["objects"]["wall"]["pose"]["position_m"][0] -= gap(("block/block", "wall/wall")) - float(
            rng.choice([1e-12, 1e-4, 3e-3])
        )
    elif "second" in said["objects"]:
        address = model.joint("second/free").qposadr[0]
        start["second/free"][0] = moved(address, ("block/block", "second/second"))
    path.write_text(json.dumps(said))


def free_body(rng, name, kind, size):
    inertia = " ".join(str(x) for x in 0.02 * rng.uniform(0.8, 1.2, 3))
    return f"""<mujoco>{HEAD}<worldbody><body name="{name}"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="{rng.uniform(0.5, 3)}" diaginertia="{inertia}"/>{geom(rng, name, kind, size)}
      </body></worldbody></mujoco>"""


def quaternion(rng):
    if rng.random() < 0.4:
        return [1.0, 0.0, 0.0, 0.0]
    q = rng.normal(size=4)
    return list(map(float, q / np.linalg.norm(q)))


JOINTS = ("robot/free", "block/free", "second/free")
"""Free joints of the scenes; not every scene has the last."""
SIDES = ("left", "right")
"""Pads of the robot."""


def said_by(path):
    """A scenario."""
    return json.loads(path.read_text())


def jumping(path, rng):
    """Change the efforts at every control tick instead of six times."""
    said = said_by(path)
    law, ticks = said["phases"][0]["controller"], round(said["duration_s"] / said["control_period_s"])
    largest = np.abs(law["efforts"]).max()
    law["efforts"] = (largest * rng.uniform(-0.3, 1.0, (ticks, len(law["efforts"][0])))).tolist()
    law["hold_s"] = said["control_period_s"]
    path.write_text(json.dumps(said))
    return path


def turned(said, turn):
    """A scenario whose scene is turned about the origin by a unit quaternion."""
    initial = said["initial"]
    for joint in JOINTS:
        if joint in ("robot/free", *initial["joints"]):
            place = initial["joints"].get(joint, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
            initial["joints"][joint] = [*_rotated(turn, place[:3]), *_product(turn, place[3:])]
        if joint in initial["rates"]:
            rates = initial["rates"][joint]
            initial["rates"][joint] = [*_rotated(turn, rates[:3]), *rates[3:]]  # the spin is in axes of the body
    for item in said["objects"].values():
        if "pose" in item:
            position = item["pose"]["position_m"]
            item["pose"] = {"position_m": _rotated(turn, position), "quaternion": list(map(float, turn))}
    return said


def boosted(said, velocity):
    """A scenario whose bodies all have a velocity more; one without a fixed body."""
    for joint in JOINTS:
        if joint in ("robot/free", *said["initial"]["joints"]):
            rates = said["initial"]["rates"].get(joint, [0.0] * 6)
            said["initial"]["rates"][joint] = [*np.add(rates[:3], velocity).tolist(), *rates[3:]]
    return said


def reordered(said, folder: Path):
    """A scenario with the pads of the robot, the objects and the pairs in reverse order; writes an MJCF."""
    robot = (folder / "robot.xml").read_text()
    left, right = (re.search(rf'<body name="{side}".*?</body>', robot, re.DOTALL).group() for side in SIDES)
    (folder / "reordered.xml").write_text(robot.replace(left, "LEFT").replace(right, left).replace("LEFT", right))
    said["robot"]["mjcf"] = "reordered.xml"
    said["objects"] = dict(reversed(said["objects"].items()))
    said["contacts"]["rules"].reverse()
    return said


def faster(said, m_s):
    """A scenario in which one pad moves faster."""
    said["initial"]["rates"]["left"] += m_s
    return said


def seen_by_the_robot(run):
    """What of the states does not depend on the frame: joint angles and rates, spins in axes of the bodies, (rows, k)."""
    own = (*SIDES, "_wx_", "_wy_", "_wz_")
    keys = sorted(key for key in run.keys if key.startswith("state.") and any(part in key for part in own))
    return np.stack([run[key] for key in keys], axis=1)


def _rotated(turn, vector):
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, np.array(vector, dtype=float), np.array(turn))
    return out.tolist()


def _product(turn, other):
    out = np.zeros(4)
    mujoco.mju_mulQuat(out, np.array(turn), np.array(other, dtype=float))
    return out.tolist()
