"""Scenes of dry friction: a slider on a floating bus, and an arm of two links on one."""

from __future__ import annotations

import ffsm_mj
from tests.replays import proved
from tests.scenes import HEAD, scene


def slider(friction, joint="", *, hull=True):
    """A bus of 5 kg with a mass of 2 kg that slides along its x axis: 10/7 kg between the two."""
    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.2 0.3 0.35"/>{'<geom name="bus" size="0.1" mass="0"/>' if hull else ""}
      <body name="mass"><joint name="s" type="slide" axis="1 0 0" frictionloss="{friction}" {joint}/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.01"/><geom name="mass" size="0.1" mass="0"/>
      </body></body></worldbody><actuator><motor name="m" joint="s"/></actuator></mujoco>"""


def arm(one=0.15, two=0.06, base='<freejoint name="free"/>'):
    """A bus with an arm of two links in its plane."""
    return f"""<mujoco>{HEAD}<worldbody><body name="bus">{base}
      <inertial pos="0 0 0" mass="6" diaginertia="0.3 0.3 0.3"/><geom size="0.1" mass="0"/>
      <body name="upper" pos="0.25 0 0"><joint name="one" axis="0 0 1" frictionloss="{one}"/>
      <inertial pos="0.2 0 0" mass="1.2" diaginertia="0.02 0.02 0.02"/>
      <body name="lower" pos="0.4 0 0"><joint name="two" axis="0 0 1" frictionloss="{two}"/>
      <inertial pos="0.15 0.03 0" mass="0.8" diaginertia="0.01 0.01 0.01"/>
      </body></body></body></worldbody>
      <actuator><motor name="one" joint="one"/><motor name="two" joint="two"/></actuator></mujoco>"""


def gear(a=0.2, b=0.03):
    """Two balanced wheels on a base, of which the first turns at a quarter of the second."""
    return f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="9" diaginertia="3 3 3"/><geom size="0.1" mass="0"/>
      <body name="A"><joint name="a" axis="0 0 1" frictionloss="{a}"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.4 0.4 0.4"/></body>
      <body name="B"><joint name="b" axis="0 0 1" frictionloss="{b}"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.05 0.05 0.05"/></body></body></worldbody>
      <equality><joint joint1="a" joint2="b" polycoef="0 0.25 0 0 0"/></equality></mujoco>"""


def grip(friction=0.5):
    """A palm of 2 kg with two fingers of 0.1 kg that close along y, 50 mm apart."""

    def finger(name, side):
        return f"""<body name="{name}" pos="0 {side * 0.04} 0">
          <joint name="{name}" type="slide" axis="0 {-side} 0" frictionloss="{friction}"/>
          <inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/><geom name="{name}" size="0.01" mass="0"/>
          </body>"""

    return f"""<mujoco>{HEAD}<worldbody><body name="palm"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>{finger("left", 1)}
      {finger("right", -1)}</body></worldbody>
      <actuator><motor name="left" joint="left"/><motor name="right" joint="right"/></actuator></mujoco>"""


def rubbing(folder, robot, step_s=1e-3, objects=None, **scenario):
    """The path of a scene whose control period is its step."""
    return scene(folder, robot, objects or {}, **{"time_step_s": step_s, "control_period_s": step_s} | scenario)


def run(folder, robot, step_s=1e-3, objects=None, **scenario):
    """A run that ends, in which every check passes and whose log agrees with its states."""
    made = ffsm_mj.run(rubbing(folder, robot, step_s, objects, **scenario))
    proved(made)
    return made


def changes(made):
    """Joint, time, and senses before and after each stop and each breakaway."""
    return [(r.joint.split("/")[1], r.time_s, r.sense_before, r.sense_after) for r in made.records["stick_slips"]]


def heat(made):
    """Heat of dry friction, J."""
    return made["balance.total_joint_friction_heat_J"]
