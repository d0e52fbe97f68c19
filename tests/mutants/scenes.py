"""The scenes in which mutants run: few and short, so that most of their time is that of starting Python.

All are spatial, off the origin and turning, so that axes, points and signs matter.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from tests.balance.test_driven_objects import berthing
from tests.balance.test_tendon_springs import REACH, cord
from tests.contact_models.grasp.test_moving_link import catching
from tests.contact_models.test_tendon_limits import TAUT
from tests.mechanisms.models import CHAIN
from tests.mechanisms.test_impacts import hit_rocker
from tests.scenes import HEAD, ball, scene

OFF = {"kind": "off"}
COAST = [{"name": "coast", "until": "end", "controller": OFF}]
TURN = [math.cos(0.4), 0.3 * math.sin(0.4), 0.4 * math.sin(0.4), math.sqrt(0.75) * math.sin(0.4)]


def box(name: str, *, mass: float, half: str, inertia: str, site: str = 'pos="0 0 0"', head: str = HEAD) -> str:
    """MJCF of a free box with its mass centre beside the middle, and a site."""
    return f"""<mujoco>{head}<worldbody><body name="{name}"><freejoint name="free"/>
      <inertial pos="0.01 -0.02 0.015" mass="{mass}" diaginertia="{inertia}"/>
      <geom name="{name}" type="box" size="{half}" mass="0"/><site name="handle" {site}/></body></worldbody></mujoco>"""


ARM = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0.02 0.01 0" mass="8" diaginertia="0.5 0.6 0.7"/>
  <geom name="hull" type="box" size="0.2 0.15 0.15" mass="0"/>
  <body name="upper" pos="0.25 0 0"><joint name="shoulder" axis="0 0 1"/>
    <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.03"/>
    <body name="hand" pos="0.4 0 0"><joint name="elbow" axis="0 1 0"/>
      <inertial pos="0.1 0 0" mass="0.7" diaginertia="0.01 0.012 0.013"/>
      <geom name="hand" size="0.05" pos="0.2 0 0" mass="0"/></body></body></body></worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""


def bounces(folder: Path) -> Path:
    """The hand of an arm hits a box, the box a ball, both with an e of their own; a slab lands flat on a wall."""
    wall = f'<mujoco>{HEAD}<worldbody><geom name="wall" type="box" size="0.1 2 2" mass="0"/></worldbody></mujoco>'
    rates = {"base": [0.3, 0.02, 0.0, 0.05, -0.1, 0.2], "elbow": -0.2}
    return scene(
        folder,
        ARM,
        {
            "box": box("box", mass=2.0, half="0.1 0.1 0.1", inertia="0.015 0.017 0.016"),
            "ball": ball("ball", mass=1.5),
            "slab": box("slab", mass=3.0, half="0.1 0.3 0.3", inertia="0.15 0.1 0.12"),
            "wall": wall,
        },
        fixed={"wall": {"position_m": [3.0, 3.0, 1.0]}},
        duration_s=0.4,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {
                "robot/free": [1.0, 0.5, 0.2, 1.0, 0.0, 0.0, 0.0],
                "box/free": [2.06, 0.53, 0.22, *TURN],
                "ball/free": [2.34, 0.54, 0.2, 1.0, 0.0, 0.0, 0.0],
                "slab/free": [2.77, 3.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            },
            "rates": {
                "robot/free": rates["base"],
                "elbow": rates["elbow"],
                "box/free": [-0.3, 0.0, 0.0, 0.3, -0.2, 0.4],
                "ball/free": [-0.5, 0.0, 0.0, 0.0, 0.0, 0.0],
                "slab/free": [0.4, 0.05, -0.03, 0.0, 0.0, 0.0],
            },
        },
        contacts={
            "rules": [
                {"between": ["robot/hand", "box/box"], "restitution": 0.8, "name": "hand"},
                {"between": ["box/box", "ball/ball"], "restitution": 0.5, "name": "behind"},
                {"between": ["slab/slab", "wall/wall"], "restitution": 0.6, "name": "landing"},
            ]
        },
    )


FALL = '<option gravity="0.2 0.1 -3"/>'
FLOOR = f'<mujoco>{FALL}<worldbody><geom name="floor" type="box" size="3 3 0.1" mass="0"/></worldbody></mujoco>'


def lands(folder: Path) -> Path:
    """Under gravity a spinning ball falls onto a floor with friction, bounces, comes to rest and rolls."""
    return scene(
        folder,
        ball("stone").replace(HEAD, FALL),
        {"floor": FLOOR},
        fixed={"floor": {"position_m": [1.0, 2.0, 0.4]}},
        conservative=False,
        duration_s=0.2,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {"robot/free": [0.4, 2.0, 0.605, 1.0, 0.0, 0.0, 0.0]},
            "rates": {"robot/free": [0.4, 0.1, -0.3, 0.0, -3.0, 1.0]},
        },
        contacts={"rules": [{"between": ["robot", "floor/floor"], "restitution": 0.4, "mu": 0.3, "name": "stone"}]},
        phases=COAST,
    )


def slides(folder: Path) -> Path:
    """Under gravity a block is set down on a floor with friction, slides on its face, turns, and sticks."""
    block = box("block", mass=2.0, half="0.15 0.12 0.1", inertia="0.013 0.02 0.025", head=FALL)
    return scene(
        folder,
        ball("stone").replace(HEAD, FALL),
        {"block": block, "floor": FLOOR},
        fixed={"floor": {"position_m": [1.0, 2.0, 0.4]}},
        conservative=False,
        duration_s=0.064,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {
                "robot/free": [0.4, 2.0, 5.0, 1.0, 0.0, 0.0, 0.0],
                "block/free": [1.4, 2.0, 0.60001, 1.0, 0.0, 0.0, 0.0],
            },
            "rates": {"block/free": [0.02, -0.015, -0.005, 0.0, 0.0, 0.1]},
        },
        contacts={"rules": [{"between": ["block/block", "floor/floor"], "restitution": 0.0, "mu": 0.25, "name": "block"}]},
        phases=COAST,
    )


def _played(folder: Path, **efforts: Any) -> dict[str, Any]:
    """A law that plays efforts: functions of the time by actuator, with a new value every 4 ms."""
    times = [0.004 * k for k in range(100)]
    lines = [",".join(["time_s", *efforts]), *(",".join(map(repr, [t, *(f(t) for f in efforts.values())])) for t in times)]
    (folder / "efforts.csv").write_text("\n".join(lines) + "\n")
    return {"kind": "playback", "file": "efforts.csv"}


def reaches(folder: Path) -> Path:
    """Joints run into their limits, rest there pressed and leave; a jaw comes to rest on a box and pushes it."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0.02 0.01 0.03" mass="5" diaginertia="0.3 0.25 0.35"/>
      <body name="rotor" pos="-0.2 0.1 0"><joint name="hinge" axis="0 0.6 0.8" range="-5 6"/>
        <inertial pos="0.05 0.02 0" mass="1" diaginertia="0.01 0.02 0.02"/></body>
      <body name="jaw" pos="0.3 0.1 0.05"><joint name="jaw" type="slide" axis="1 0 0" range="-0.02 0.06"/>
        <inertial pos="0 0.01 0" mass="0.4" diaginertia="3e-4 2e-4 3e-4"/>
        <geom name="jaw" type="box" size="0.02 0.04 0.03" mass="0"/><site name="jaw" quat="0.9 0.1 0.3 -0.2"/></body></body>
      </worldbody>
      <actuator><motor name="hinge" joint="hinge"/><motor name="jaw" joint="jaw"/></actuator></mujoco>"""
    law = _played(
        folder,
        hinge_N_m=lambda t: 0.4 if t < 0.2 else -0.6,
        jaw_N=lambda t: 4.0 if t < 0.25 else -3.0,
    )
    return scene(
        folder,
        robot,
        {"box": box("box", mass=1.2, half="0.1 0.15 0.12", inertia="0.01 0.008 0.012")},
        duration_s=0.4,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {
                "robot/free": [0.5, -0.4, 0.3, 1.0, 0.0, 0.0, 0.0],
                "box/free": [0.94, -0.3, 0.36, 1.0, 0.0, 0.0, 0.0],
            },
            "rates": {
                "robot/free": [0.1, 0.0, -0.1, 0.1, -0.05, 0.2],
                "hinge": 0.5,
                "box/free": [0.1, 0.0, -0.1, 0.0, 0.0, 0.1],
            },
        },
        sensors={"force": {"kind": "force", "of": "jaw"}, "acc": {"kind": "accelerometer", "of": "jaw"}},
        joint_limits={"hinge": {"restitution": 0.3}, "jaw": {"restitution": 0.0}},
        contacts={"rules": [{"between": ["jaw", "box/box"], "restitution": 0.2, "name": "jaw"}]},
        phases=[{"name": "play", "until": "end", "controller": law}],
    )


def flies(folder: Path) -> Path:
    """A tumbling base with on-off thrusters, a wheel, and a sprung and damped boom, which is all measured; late commands."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0.02 0.01 0.03" mass="6" diaginertia="0.3 0.25 0.35" quat="0.9 0.1 0.2 0.3"/>
      <site name="imu" pos="0.1 0.05 0.02" quat="0.9 0.3 -0.1 0.2"/>
      <site name="jet" pos="-0.2 0.1 0.05" quat="0.8 0.1 0.5 -0.2"/>
      <site name="side" pos="0 0.2 -0.1" quat="0.5 -0.5 0.1 0.7"/>
      <body name="wheel" pos="-0.1 0 0.05"><joint name="wheel" axis="0.6 0 0.8"/>
        <inertial pos="0 0 0" mass="0.5" diaginertia="0.002 0.002 0.002"/></body>
      <body name="boom" pos="0.3 0.1 0"><joint name="boom" axis="0 0.6 0.8" stiffness="3 0 8" damping="0.1 0.05"
        springref="3"/><inertial pos="0.2 0.02 0" mass="0.8" diaginertia="0.002 0.012 0.012"/><site name="root"/>
        <body name="arm" pos="0.4 0 0"><joint name="elbow" axis="1 0 1"/><site name="wrist"/>
          <inertial pos="0.1 0 0.02" mass="0.5" diaginertia="0.002 0.004 0.003"/></body></body></body></worldbody>
      <actuator><motor name="jet" site="jet" gear="1 0 0 0 0 0"/><motor name="side" site="side" gear="0 0.6 0.8 0 0 0.1"/>
        <motor name="wheel" joint="wheel"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""
    law = _played(
        folder,
        jet_N=lambda t: 3.0 if 0.02 < t < 0.09 else 0.0,
        side_N=lambda t: 2.0 if t > 0.05 else 0.0,
        wheel_N_m=lambda t: 0.1 * math.cos(30.0 * t),
        elbow_N_m=lambda t: 0.3 * math.sin(40.0 * t),
    )
    inertial = {"interval_s": 0.006, "first_s": 0.001, "delay_s": 0.004}
    return scene(
        folder,
        robot,
        {"goal": ball("goal")},
        duration_s=0.2,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {
                "robot/free": [1.0, -2.0, 0.5, *TURN],
                "boom": 0.3,
                "elbow": 0.2,
                "goal/free": [2.0, 1.0, 0, 1, 0, 0, 0],
            },
            "rates": {
                "robot/free": [0.1, 0.2, -0.1, 0.5, -0.7, 0.9],
                "wheel": 20.0,
                "boom": -0.5,
                "goal/free": [-0.2, 0.1, 0.3, 0.1, 0.2, 0.3],
            },
        },
        actuators={
            "jet": {"kind": "on_off", "force_N": 4.0, "threshold_N": 0.5, "delay_s": 0.003},
            "wheel": {"kind": "reaction_wheel", "max_torque_N_m": 0.08, "max_speed_rad_s": 100.0},
            "elbow": {"kind": "ideal", "delay_s": 0.007},
        },
        sensors={
            "gyro": {"kind": "gyro", "of": "imu", **inertial},
            "acc": {"kind": "accelerometer", "of": "imu", **inertial},
            "force": {"kind": "force", "of": "wrist", "interval_s": 0.005},
            "torque": {"kind": "torque", "of": "root", "interval_s": 0.005, "noise": 0.01},
            "spin": {"kind": "gyro", "of": "root"},
            "camera": {"kind": "framepos", "of": "goal/centre", "relative_to": "imu", "interval_s": 0.01, "delay_s": 0.013},
            "attitude": {"kind": "framequat", "of": "imu", "noise": 1e-3},
            "encoder": {"kind": "jointpos", "of": "elbow", "noise": 1e-3, "bias_walk": 1e-3},
            "tachometer": {"kind": "jointvel", "of": "wheel", "noise": 1e-2, "quantum": 1e-3},
        },
        seed=5,
        phases=[{"name": "play", "until": "end", "controller": law}],
    )


_FRAME = 'quat="0.8 0.2 -0.5 0.3"'
LATCHES = {
    "rigid": {},
    "ball": {"joint": "ball"},
    "hinge": {"joint": "hinge", "axis": [0.2, 0.9, 0.3]},
    "slide": {"joint": "slide", "axis": [1.0, 0.2, -0.1]},
    "cylindrical": {"joint": "cylindrical", "axis": [0.8, -0.3, 0.4]},
}


def holds(folder: Path) -> Path:
    """Five links of a robot grasp an object each, by latches of every kind, and let go of two; a sixth object flies by."""
    links, objects, joints, rates, grasps = "", {}, {}, {}, {}
    base = (0.4, 0.3, -0.2)
    for k, (kind, freedom) in enumerate(LATCHES.items()):
        at = (0.5, 0.6 * (k - 2), 0.1 * k)
        links += f"""<body name="link{k}" pos="{at[0] - 0.3} {at[1]} {at[2]}"><joint name="j{k}" axis="0.3 0.1 1"/>
          <inertial pos="0.2 0.01 0" mass="0.8" diaginertia="0.01 0.02 0.02"/>
          <site name="hand{k}" pos="0.3 0 0" {_FRAME}/></body>"""
        objects[kind] = box(
            kind, mass=1.0 + 0.3 * k, half="0.1 0.1 0.1", inertia="0.01 0.012 0.014", site=f'pos="-0.1 0.02 0.01" {_FRAME}'
        )
        place = [base[i] + at[i] + (0.13, -0.02, 0.0)[i] for i in range(3)]
        joints[f"{kind}/free"] = [*place, 1.0, 0.0, 0.0, 0.0]
        rates[f"{kind}/free"] = [-0.3 - 0.1 * k, 0.02, 0.03, 0.3, -0.2, 0.4]
        when = {"within": {"position_m": 0.025, "angle_rad": 0.3}}
        grasps[kind] = {"robot_site": f"hand{k}", "object_site": f"{kind}/handle", "when": when, **freedom}
    objects["stray"] = box("stray", mass=1.0, half="0.1 0.1 0.1", inertia="0.01 0.012 0.014")
    joints["stray/free"], rates["stray/free"] = [1.0, 1.7, 0.3, 1, 0, 0, 0], [-1.0, -0.1, 0.0, 0.1, 0.2, 0.3]
    grasps["missed"] = grasps["rigid"] | {"robot_site": "hand4", "object_site": "stray/handle"}
    motors = "".join(f'<motor name="j{k}" joint="j{k}"/>' for k in range(len(LATCHES)))
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0.02 0.01 0.03" mass="9" diaginertia="0.9 0.7 0.8"/>{links}</body></worldbody>
      <actuator>{motors}</actuator></mujoco>"""
    law = _played(folder, **{f"j{k}_N_m": lambda t, k=k: math.sin(9.0 * t + k) for k in range(len(LATCHES))})
    return scene(
        folder,
        robot,
        objects,
        duration_s=0.3,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {"robot/free": [*base, 1.0, 0.0, 0.0, 0.0], **joints},
            "rates": {"robot/free": [0.0, 0.0, 0.0, 0.1, -0.1, 0.2], **rates},
        },
        grasps=grasps,
        phases=[
            {"name": "meet", "for_s": 0.2, "arm": [*grasps], "controller": law},
            {"name": "leave", "until": "end", "release": ["rigid", "slide"], "controller": law},
        ],
    )


def serves(folder: Path) -> Path:
    """An arm grasps a spacecraft that drives itself by thrusters, wheels and a motor of its panel."""
    return berthing(folder, "ball", duration_s=0.2)


def links(folder: Path) -> Path:
    """An arm grasps the panel of a tumbling object whose bus swings at it."""
    return catching(folder, latch="ball", duration_s=0.2)


def hits(folder: Path) -> Path:
    """A ball hits the rocker of a closed four-bar linkage."""
    return hit_rocker(folder, 0.6, crank=1.0, duration_s=0.2)


def curves(folder: Path) -> Path:
    """A joint of a chain follows another one by a polynomial."""
    rates = {"robot/base": [0.05, -0.03, 0.02, 0.2, -0.1, 0.15], "j1": 3.0, "j2": -0.9}
    initial = {"joints": {"j1": 0.5, "j2": -0.4, "robot/base": [1.0, 0.5, 0.2, *TURN]}, "rates": rates}
    return scene(folder, CHAIN, {}, duration_s=0.2, time_step_s=2e-3, control_period_s=4e-3, initial=initial, phases=COAST)


def tautens(folder: Path) -> Path:
    """A cord from the tip of an arm to its base becomes taut, and stays so for a while."""
    return scene(
        folder,
        REACH.format(cord(TAUT), ""),
        {},
        duration_s=0.6,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={"joints": {"a": 0.3, "b": -1.6}, "rates": {"robot/free": [0.1, -0.2, 0.05, 0.2, -0.1, 0.3], "b": 1.5}},
        joint_limits={"cord": {"restitution": 0.0}},
        phases=COAST,
    )


ASTEROID = {
    "orbit": {
        "body": {"mu_km3_s2": 10.0, "radius_km": 5.0},
        "kind": "elliptic",
        "semi_major_axis_km": 9.0,
        "eccentricity": 0.2,
        "true_anomaly_deg": 40.0,
    },
    "world_axes": "lvlh",
}
"""An orbit of 0.12 rad/s about a body denser than any: tides of 0.03 m/s^2 at 1 m, so that each part is seen."""


def orbits(folder: Path) -> Path:
    """In orbit an arm grasps a box, and measures how it moves it; a ball hits another box."""
    # Heavy axes of inertia that differ: gradient torques of 0.01 N m.
    box_in_hand = box("box", mass=2.0, half="0.1 0.1 0.1", inertia="0.1 0.3 0.35", site=f'pos="-0.1 0.02 0.01" {_FRAME}')
    robot = ARM.replace("</body></body></body>", f'<site name="hand" pos="0.3 0 0" {_FRAME}/></body></body></body>')
    law = _played(folder, shoulder_N_m=lambda t: math.sin(9.0 * t), elbow_N_m=lambda t: 0.5 * math.cos(7.0 * t))
    return scene(
        folder,
        robot,
        {"box": box_in_hand, "ball": ball("ball"), "far": box("far", mass=3.0, half="0.1 0.2 0.2", inertia="0.1 0.3 0.2")},
        environment=ASTEROID,
        duration_s=0.3,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {
                "robot/free": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
                "box/free": [1.09, -0.02, 0.0, 1.0, 0.0, 0.0, 0.0],
                "ball/free": [4.0, 3.0, 1.0, 1.0, 0.0, 0.0, 0.0],
                "far/free": [4.25, 3.05, 1.0, *TURN],
            },
            "rates": {
                "robot/free": [0.0, 0.0, 0.0, 0.1, -0.1, 0.2],
                "box/free": [-0.3, 0.02, 0.03, 0.3, -0.2, 0.4],
                "ball/free": [0.6, 0.0, 0.1, 0.0, 0.0, 0.0],
                "far/free": [0.0, 0.0, 0.0, 0.2, -0.3, 0.4],
            },
        },
        sensors={kind: {"kind": kind, "of": "robot/hand"} for kind in ("force", "torque", "accelerometer")},
        grasps={"grasp": {"robot_site": "hand", "object_site": "box/handle", "when": {"within": {"position_m": 0.05}}}},
        contacts={"rules": [{"between": ["ball/ball", "far/far"], "restitution": 0.5, "name": "far"}]},
        phases=[{"name": "meet", "until": "end", "arm": ["grasp"], "controller": law}],
    )


def coils(folder: Path) -> Path:
    """In low orbit magnetorquers turn a tumbling box, which sees stars, nadir and the magnetic field."""
    robot = box("box", mass=5.0, half="0.2 0.2 0.2", inertia="0.1 0.12 0.15", site=f'pos="20 30 -25" {_FRAME}')
    coils = {f"coil_{axis}": {"kind": "magnetorquer", "site": "handle", "axis": axis} for axis in "xy"}
    sensors = {
        "stars": {"kind": "startracker", "axes": "eci"},
        "nadir": {"kind": "horizon"},
        "field": {"kind": "magnetometer"},
    }
    return scene(
        folder,
        robot,
        {},
        environment={
            "orbit": {"altitude_km": 400.0, "inclination_deg": 97.0, "raan_deg": 40.0, "argument_of_latitude_deg": 25.0},
            "epoch": "2027-03-01T12:00:00Z",
            "magnetic_field": {"kind": "dipole"},
        },
        duration_s=0.3,
        time_step_s=2e-3,
        control_period_s=4e-3,
        initial={
            "joints": {"robot/free": [0.0, 0.0, 0.0, *TURN]},
            "rates": {"robot/free": [0.0, 0.0, 0.0, 0.1, -0.1, 0.2]},
        },
        sensors={name: keys | {"of": "handle"} for name, keys in sensors.items()},
        actuators={name: keys | {"max_dipole_A_m2": 100.0} for name, keys in coils.items()},
        phases=[
            {
                "name": "turn",
                "until": "end",
                "controller": _played(folder, coil_x_A_m2=lambda _: 80.0, coil_y_A_m2=lambda _: -50.0),
            }
        ],
    )
