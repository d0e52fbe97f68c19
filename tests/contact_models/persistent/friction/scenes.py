"""Scenes of persistent contact with friction, with the loads that press and push."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from ffsm_mj.config import StrictModel
from ffsm_mj.contact_models.interface import ContactModel, ForceSource
from ffsm_mj.records.contact_forces import Wrench
from tests.contact_models.impact.test_fixed import slab
from tests.scenes import HEAD, ball, box, scene

EARTH = "slab/slab"
"""The fixed body of scenes with weight."""


def load(on, reaction=EARTH, **what):
    """One load; see :class:`LoadConfig`."""
    return {"on": on, "reaction": reaction, **what}


def loaded(*loads):
    """Loads as the contact models of a scenario."""
    return [{"kind": "loads", "loads": list(loads)}]


def steps(step_s, duration_s):
    """Times of a scenario: a control tick at every step."""
    return {"time_step_s": step_s, "control_period_s": step_s, "duration_s": duration_s}


def on_slab(folder, robot, *, geom, mu, weight, step, duration, loads=(), restitution=0.0, **scenario):
    """A robot whose geom ``geom`` touches a fixed slab with its top at z = 0, with a weight in N along -z at its centre."""
    return scene(
        folder,
        robot,
        {"slab": slab("slab", "20 20 0.5")},
        fixed={"slab": {"position_m": [0, 0, -0.5]}},
        contacts={"rules": [{"name": "foot", "between": [geom, "slab/slab"], "restitution": restitution, "mu": mu}]},
        contact_models=loaded(load(f"robot/{geom}", force_N=[[0, 0, -weight]]), *loads),
        **steps(step, duration),
        **scenario,
    )


def pulled(folder, step, force_N, *, mu=0.5, weight=1.0, duration=0.6, velocity=(0.0, 0.0)):
    """A foot of 1 kg on three slides, pulled by a force with these coefficients in time."""
    return on_slab(
        folder,
        ball("foot", mass=1.0, joints="xyz"),
        geom="foot",
        mu=mu,
        weight=weight,
        step=step,
        duration=duration,
        initial={"joints": {"robot/z": 0.1}, "rates": {"robot/x": velocity[0], "robot/y": velocity[1]}},
        loads=[load("robot/foot", force_N=force_N)],
    )


def sphere(folder, *, mu, velocity, spin=(0.0, 0.0, 0.0), step, duration, **scenario):
    """A sphere of 1 kg and 1 m radius (inertia 0.4 kg m^2) on the slab, under 1 N: L1, L5, L6 and E1."""
    initial = {"joints": {"robot/free": [0, 0, 1, 1, 0, 0, 0]}, "rates": {"robot/free": [*velocity, *spin]}}
    robot = ball("ball", mass=1.0, radius=1.0)
    return on_slab(folder, robot, geom="ball", mu=mu, weight=1.0, step=step, duration=duration, initial=initial, **scenario)


def block(folder, *, mu, velocity, spin=0.0, weight=1.0, half=(0.2, 0.1, 0.05), step, duration, **scenario):
    """A block of 1 kg on its four corners on the slab: S6."""
    initial = {
        "joints": {"robot/free": [0, 0, half[2], 1, 0, 0, 0]},
        "rates": {"robot/free": [*velocity, 0, 0, spin]},
    }
    robot = box("box", mass=1.0, half=half)
    return on_slab(
        folder, robot, geom="box", mu=mu, weight=weight, step=step, duration=duration, initial=initial, **scenario
    )


BALL_TIP, PLATE, PAD = 'type="sphere" size="0.02"', 'type="box" size="0.04 0.01 0.04"', 'type="box" size="0.02 0.01 0.02"'
_THICK_M = {BALL_TIP: 0.02, PLATE: 0.01, PAD: 0.01}


def gripper(tip, *, base_kg, finger_kg, half_m, inertia=(0.8, 0.9, 1.0)):
    """MJCF of a free base with two fingers on slides along y, whose tips touch faces at y = half_m and -half_m."""
    away = half_m + _THICK_M[tip]

    def finger(name, y):
        return f"""<body name="{name}" pos="0 {y} 0">
        <inertial pos="0 {-y} 0" mass="{finger_kg}" diaginertia="1e-9 1e-9 1e-9"/>
        <joint name="{name}" type="slide" axis="0 1 0"/><geom name="{name}" {tip} mass="0"/></body>"""

    turning = " ".join(str(each) for each in inertia)
    return f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="{base_kg}" diaginertia="{turning}"/>
      {finger("left", away)}{finger("right", -away)}</body></worldbody>
      <actuator><motor name="close_left" joint="left"/><motor name="close_right" joint="right"/></actuator></mujoco>"""


def cube(mass, half_m, inertia, centre=(0.0, 0.0, 0.0)):
    """MJCF of a free cube with its mass centre somewhere in it."""
    at, size = (" ".join(str(each) for each in vector) for vector in (centre, (half_m,) * 3))
    return f"""<mujoco>{HEAD}<worldbody><body name="cube"><freejoint name="free"/>
      <inertial pos="{at}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom name="cube" type="box" size="{size}" mass="0"/></body></worldbody></mujoco>"""


def gripped(folder, tip, held, *, mu, grip_N, loads, step, duration, base_kg=8.0, finger_kg=1.0, half_m=0.05, **scenario):
    """A gripper around a cube at the origin of its base, pressed by constant forces between base and fingers.

    ``mu`` is that of both pads, or of the left and the right one.
    """
    left, right = mu if isinstance(mu, tuple) else (mu, mu)
    closing = [
        load(f"robot/{name}", "robot/base", force_N=[[0, sign * grip_N, 0]], axes="robot/base")
        for name, sign in (("left", -1), ("right", 1))
    ]
    far = {"anchor": ball("anchor", radius=0.01).replace('<freejoint name="free"/>', "")}
    return scene(
        folder,
        gripper(tip, base_kg=base_kg, finger_kg=finger_kg, half_m=half_m),
        {"cube": held, **far},
        fixed={"anchor": {"position_m": [50, 50, 50]}},
        contacts={
            "rules": [
                {"name": name, "between": [name, "cube/cube"], "restitution": 0.0, "mu": each}
                for name, each in (("left", left), ("right", right))
            ]
        },
        contact_models=loaded(*closing, *loads),
        **steps(step, duration),
        **scenario,
    )


def thrust(*force_N, at_m=(0.0, 0.0, 0.0)):
    """An outside force on the base of a gripper: coefficients of the powers of time."""
    return load("robot/base", "anchor/anchor", force_N=list(force_N), at_m=list(at_m))


Vector = tuple[float, float, float]
Powers = Annotated[tuple[Vector, ...], Field(max_length=4)]


class LoadConfig(StrictModel):
    """A force and a torque on a body, and their reaction on another."""

    on: str
    """Geom or body on whose body the load acts."""
    reaction: str
    """Geom or body whose body takes the reaction; a fixed one makes it an outside load."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Where the force acts, in the frame of the body."""
    force_N: Powers = ()
    """Coefficients of 1, t, t^2, ... in N, N/s, ..."""
    torque_N_m: Powers = ()
    """The same of the torque."""
    axes: str | None = None
    """Body in whose axes the coefficients are; left out: world axes."""


class LoadsConfig(StrictModel):
    """Loads of a scene."""

    kind: Literal["loads"]
    loads: tuple[LoadConfig, ...]


class Loads(ContactModel, ForceSource):
    """Forces and torques that depend on time alone."""

    kind = "loads"
    Config = LoadsConfig
    active = True

    def __init__(self, config: LoadsConfig, scene: Any) -> None:
        super().__init__(config, scene)
        model = scene.system.mj
        self._loads = [
            (
                _body(model, load.on),
                _body(model, load.reaction),
                np.array(load.at_m),
                _powers(load.force_N),
                _powers(load.torque_N_m),
                None if load.axes is None else _body(model, load.axes),
            )
            for load in config.loads
        ]

    def wrenches(self, data):
        found = []
        for body, reaction, at, forces, torques, axes in self._loads:
            turn = np.eye(3) if axes is None else data.xmat[axes].reshape(3, 3)
            powers = data.time ** np.arange(4)
            force, torque = turn @ (powers @ forces), turn @ (powers @ torques)
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ at
            found += [Wrench(body, point, force, torque), Wrench(reaction, point, -force, -torque)]
        return found


def _powers(coefficients):
    """Coefficients of the powers 0 to 3, (4, 3)."""
    full = np.zeros((4, 3))
    full[: len(coefficients)] = np.array(coefficients).reshape(-1, 3)
    return full


def _body(model: Any, name: str) -> int:
    for geom in range(model.ngeom):
        if model.geom(geom).name == name:
            return int(model.geom_bodyid[geom])
    return int(model.body(name).id)


def heat(run):
    """Heat of friction until the end, J."""
    return float(run["balance.friction_heat_J"][-1])


def final(run, column):
    """Last values of all columns that begin so: ``q_robot_free`` is x, y, z and a quaternion, ``v_...`` six rates."""
    keys = [key for key in run.keys if key.startswith(f"state.{column}")]
    assert keys, f"no column begins with state.{column}"
    return np.array([run[key][-1] for key in keys])


def at(run, time_s, column):
    """The same at a row."""
    row = int(np.argmin(np.abs(run.time - time_s)))
    assert abs(run.time[row] - time_s) < 1e-9
    return np.array([run[key][row] for key in run.keys if key.startswith(f"state.{column}")])


def yaw(run, column):
    """Turn about z at the end, rad, of a body that turns about z, but for little."""
    w, _, _, z = final(run, column)[3:]
    return 2.0 * math.atan2(z, w)


def slips(run):
    """Times at which pairs begin to slip, s."""
    return [record.time_s for record in run.records["contact_slips"]]


def sticks(run):
    """Times at which pairs begin to stick, s."""
    return [record.time_s for record in run.records["contact_sticks"]]
