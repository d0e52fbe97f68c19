"""Scenes in which joints reach their limits, and control laws that drive them there."""

from __future__ import annotations

import math

import numpy as np

from tests.laws import Law
from tests.scenes import HEAD, scene

SPAN = math.radians(30.0)
ROTOR = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/>
  <body name="rotor"><joint name="hinge" axis="0 0 1" range="-30 30"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.02"/></body></body></worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
"""A balanced rotor on a free base: the hinge sees the inertia 1 / (1 / 0.3 + 1 / 0.02) = 0.01875 kg m^2."""
INERTIA = 0.01875

GRIPPER = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/>
  <body name="left" pos="0.3 0.05 0"><joint name="left" type="slide" axis="0 -1 0" range="0 0.04"/>
    <inertial pos="0 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>
    <geom name="left" type="box" size="0.02 0.005 0.02" mass="0"/></body>
  <body name="right" pos="0.3 -0.05 0"><joint name="right" type="slide" axis="0 1 0" range="0 0.04"/>
    <inertial pos="0 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>
    <geom name="right" type="box" size="0.02 0.005 0.02" mass="0"/></body></body></worldbody>
  <actuator><motor name="left" joint="left"/><motor name="right" joint="right"/></actuator></mujoco>"""
"""Two parallel jaws that close on nothing."""

FLYWEIGHTS = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/>
  <body name="wheel"><joint name="wheel" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.02"/></body>
  <body name="a"><joint name="a" type="slide" axis="1 0 0" range="0.1 0.3"/>
    <inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body>
  <body name="b"><joint name="b" type="slide" axis="-1 0 0" range="0.1 0.3"/>
    <inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body></body></worldbody>
  <actuator><motor name="wheel" joint="wheel"/><motor name="a" joint="a"/><motor name="b" joint="b"/></actuator></mujoco>"""
"""Two weights that slide out on a spinning base, and a wheel that stops it."""

PANEL = f"""<mujoco>{HEAD}<worldbody><body name="target"><freejoint name="free"/>
  <inertial pos="0.03 -0.02 0.01" mass="3" diaginertia="0.04 0.05 0.06"/>
  <geom name="target" type="sphere" size="0.1" mass="0"/><site name="handle" pos="-0.1 0.01 0.02"/>
  <body name="panel" pos="0.1 0 0"><joint name="panel" axis="0 1 0" range="-20 40"/>
    <inertial pos="0.2 0 0" mass="0.4" diaginertia="2e-3 3e-3 4e-3"/></body></body></worldbody></mujoco>"""
"""A target with a panel on a limited hinge, which a hand can grasp."""


def driven_by(effort):
    """A control law whose efforts are a function of time, held over each control period."""

    class Driven(Law):
        kind = "driven"

        def control(self, observation, command):
            command.effort[:] = effort(observation.time_s)
            command.powered[:] = True

    return {"driven": Driven}


DRIVEN = [{"name": "drive", "until": "end", "controller": {"kind": "driven"}}]


def rotor(folder, restitution, rate=20.0, **changes):
    """The rotor between its stops, with an initial rate in rad/s."""
    limits = {"hinge": {"restitution": restitution}}
    return scene(folder, ROTOR, {}, **{"initial": {"rates": {"hinge": rate}}, "joint_limits": limits, **changes})


def bounces(restitution, torques, period_s, *, rate, count):
    """Times, rates towards the stop and sides of the first hits of the rotor, from parabolas joined in closed form.

    Args:
        restitution: Coefficient of restitution.
        torques: Torque in each control period, N m.
        period_s: Control period.
        rate: Rate at t = 0 in the middle, rad/s.
        count: How many hits.
    """
    hits, q, v = [], 0.0, rate
    for tick, torque in enumerate(torques):
        a, t, end = torque / INERTIA, tick * period_s, (tick + 1) * period_s
        while True:
            after, side = min((_time_to(side * SPAN - q, v, a, side), side) for side in (-1.0, 1.0))
            if t + after > end:
                q, v = q + v * (end - t) + 0.5 * a * (end - t) ** 2, v + a * (end - t)
                break
            t, q, v = t + after, side * SPAN, v + a * after
            hits.append((t, abs(v), side))
            v = -restitution * v
            if len(hits) == count:
                return np.array(hits)
    raise AssertionError(f"only {len(hits)} hits")


def _time_to(way, v, a, side):
    """Time at which v t + a t^2 / 2 reaches a stop on its side, from before it or as it leaves it."""
    if a == 0.0:
        return way / v if v * side > 0.0 else math.inf
    found = [t for t in np.roots((0.5 * a, v, -way)) if abs(t.imag) < 1e-12]
    return min((t.real for t in found if (v + a * t.real) * side > 1e-12 and t.real > 1e-12), default=math.inf)


def sentences(run):
    """Kind, time and joint of all events at joint limits, in order."""
    return [
        (type(each).__name__, round(each.time_s, 6), each.joint.split("/")[1], each.side)
        for each in run.log.events
        if hasattr(each, "side")
    ]


def failures(checks):
    """Names of the checks that fail."""
    return {check.name for check in checks if not check.passes}
