"""The same scene of random pushes seen from elsewhere: turned, boosted, with its bodies and pairs in another order."""

from __future__ import annotations

import json
import re
from pathlib import Path

import mujoco
import numpy as np

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
