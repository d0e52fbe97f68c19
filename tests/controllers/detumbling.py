"""Small spacecraft with wheels, jets and a one-joint arm, for tests of the law ``detumble``."""

from __future__ import annotations

import numpy as np

import ffsm_mj
from tests.scenes import HEAD, scene

SPIN = 0.02
"""Axial inertia of each wheel, kg m^2."""
ORTHOGONAL = np.eye(3)
PYRAMID = np.array([[1.0, 0.0, 0.7], [-1.0, 0.0, 0.7], [0.0, 1.0, 0.7], [0.0, -1.0, 0.7]]) / np.hypot(1.0, 0.7)


def spacecraft(axes=ORTHOGONAL, *, jets="", arm=True, inertia=(2.0, 2.5, 3.0)):
    """MJCF of a hub of 40 kg with wheels along some axes of its frame, and an arm on its side."""
    wheels = "".join(
        f"""<body name="wheel_{i}" pos="0 0 {0.02 * i}"><joint name="wheel_{i}" axis="{" ".join(map(str, axis))}"/>
          <inertial pos="0 0 0" mass="1" quat="{" ".join(map(str, _turned_to(axis)))}"
            diaginertia="{0.6 * SPIN} {0.6 * SPIN} {SPIN}"/></body>"""
        for i, axis in enumerate(axes)
    )
    link = """<body name="link" pos="0.3 0 0"><joint name="shoulder" axis="0 0.6 0.8" armature="0.1"/>
      <inertial pos="0.3 0 0" mass="2" diaginertia="0.01 0.1 0.1"/><site name="tip" pos="0.6 0 0"/></body>"""
    motors = "".join(f'<motor name="wheel_{i}" joint="wheel_{i}"/>' for i in range(len(axes)))
    sites, thrusters = _jets() if jets == "couples" else ("", "")
    if jets == "alone":
        sites = '<site name="only" pos="0 -0.4 0"/>'
        thrusters = '<motor name="jet" site="only" gear="1 0 0 0 0 0" ctrlrange="0 100"/>'
    return f"""<mujoco>{HEAD}<worldbody><body name="hub"><freejoint name="base"/>
      <inertial pos="0 0 0" mass="40" diaginertia="{" ".join(map(str, inertia))}"/>
      <geom name="hub" type="box" size="0.2 0.2 0.2" mass="0"/>{sites}{wheels}{link if arm else ""}</body></worldbody>
      <actuator>{motors}{'<motor name="shoulder" joint="shoulder"/>' if arm else ""}{thrusters}</actuator></mujoco>"""


def _turned_to(axis):
    """Quaternion that turns z to an axis."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    quaternion = np.array([1.0 + z, -y, x, 0.0]) if z > -0.999 else np.array([0.0, 1.0, 0.0, 0.0])
    return (quaternion / np.linalg.norm(quaternion)).tolist()


def _jets():
    """Twelve jets in couples about each axis."""
    sites, motors = "", ""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for end in (1.0, -1.0):
            for push in (1.0, -1.0):
                place, gear = np.zeros(3), np.zeros(6)
                place[j], gear[k] = 0.4 * end, push
                name = f"jet_{i}_{'p' if end > 0 else 'n'}{'p' if push > 0 else 'n'}"
                sites += f'<site name="{name}" pos="{" ".join(map(str, place))}"/>'
                motors += f'<motor name="{name}" site="{name}" gear="{" ".join(map(str, gear))}" ctrlrange="0 100"/>'
    return sites, motors


JETS = [f"jet_{i}_{a}{b}" for i in range(3) for a in "pn" for b in "pn"]
RATES = [0.1, -0.2, 0.05, 0.3, -0.2, 0.25]
"""Velocity of the hub, m/s, and its angular velocity, rad/s."""
POSE = [1.0, 2.0, -1.0, 0.8, 0.2, -0.4, 0.4]


def detumbled(folder, law, *, robot=None, duration_s=20.0, **changes):
    """A run of the law on a tumbling spacecraft, in steps of 20 ms."""
    path = scene(
        folder,
        robot or spacecraft(),
        {},
        **{
            "duration_s": duration_s,
            "time_step_s": 0.02,
            "control_period_s": 0.02,
            "initial": {"joints": {"base": POSE}, "rates": {"base": RATES}},
            "phases": [{"name": "all", "until": "end", "controller": {"kind": "detumble", **law}}],
            **changes,
        },
    )
    return ffsm_mj.run(path)


def left(run):
    """|L| of the spacecraft without its wheels at the last row."""
    return ffsm_mj.angular_momentum(run)["stack_without_wheels_N_m_s"]
