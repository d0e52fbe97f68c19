"""Scenes in which something is grasped."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.contact_models.grasp.closing_condition import Sites
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.latch_joints import plastic_impulse, relative_twist_rows
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.grasp import RIGID, Grasp
from tests.scenes import ball, of_subtree, scene

ARM = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0.02 0.01 0" mass="8" diaginertia="0.5 0.6 0.7"/>
  <geom name="hull" type="box" size="0.29 0.15 0.15" mass="0"/>
  <body name="upper" pos="0.3 0 0"><joint name="shoulder" type="hinge" axis="0 0 1"/>
  <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.03"/>
  <body name="hand" pos="0.4 0 0"><joint name="elbow" type="hinge" axis="0 1 0"/>
  <inertial pos="0.1 0 0" mass="0.7" diaginertia="0.01 0.012 0.013"/>
  <geom name="hand" type="sphere" pos="0.2 0 0" size="0.05" mass="0"/><site name="grip" pos="0.25 0 0"/>
  </body></body></body></worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""

TARGET = """<mujoco><option gravity="0 0 0"/><worldbody><body name="target">
  <inertial pos="0.03 -0.02 0.01" mass="3" diaginertia="0.04 0.05 0.06"/><freejoint name="free"/>
  <geom name="target" type="sphere" size="0.1" mass="0"/><site name="handle" pos="-0.1 0.01 0.02"/>
  </body></worldbody></mujoco>"""

OFF = {"kind": "off"}
TOUCH = {"touch": ["hand-target/target"]}
BOUNDS = {"within": {"position_m": 0.1, "angle_rad": 0.5, "speed_m_s": 1.0, "rate_rad_s": 1.0}}
NEAR = {"within": {"position_m": 0.05, "angle_rad": 1.0, "speed_m_s": 1.0}}


def grasping(folder, when=TOUCH, others=None, phases=None, robot=ARM, **changes):
    """A tumbling ball drifts to the hand of a free-floating arm, is caught, held, and let go after 1.5 s."""
    folder.mkdir(exist_ok=True)
    return scene(
        folder,
        robot,
        {"target": TARGET, **(others or {})},
        **{
            "duration_s": 2.0,
            "initial": {
                "joints": {"target/free": [1.3, 0.03, 0.02, 1, 0, 0, 0]},
                "rates": {
                    "robot/free": [0, 0, 0, 0.02, -0.03, 0.05],
                    "target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3],
                    "shoulder": 0.1,
                },
            },
            "contacts": {"rules": [{"between": ["hand", "target/target"], "restitution": 0.5}]},
            "grasps": {"grasp": {"robot_site": "grip", "object_site": "handle", "when": when}},
            "phases": phases
            or [
                {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
                {"name": "hold", "for_s": 0.9, "controller": {"kind": "pd", "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}},
                {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
            ],
        }
        | changes,
    )


def closed_as_armed(folder):
    """A grasp that closes at the start, as it is armed; the next phase releases it at once, under other efforts."""
    (folder / "ramp.csv").write_text("time_s,elbow_N_m\n0,0.2\n0.02,0.3\n0.04,0.1\n")
    play = {"kind": "playback", "file": "ramp.csv", "after": "hold"}
    return grasping(
        folder,
        {"within": {"position_m": 5.0}},
        robot=ARM.replace("</mujoco>", '<sensor><actuatorfrc name="torque" actuator="elbow"/></sensor></mujoco>'),
        control_period_s=0.01,
        duration_s=0.1,
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "for_s": 0.05, "release": ["grasp"], "controller": play},
            {"name": "end", "until": "end", "controller": OFF},
        ],
    )


def stone(mass=0.5):
    """A ball that is thrown at what is held."""
    return ball("stone", mass=mass)


FLAT_ARM = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base">
  <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.4"/>
  <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" axis="0 0 1"/>
  <body name="hand" pos="0.5 0 0"><joint name="elbow" axis="0 0 1"/>
  <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.03"/>
  <geom name="hand" type="sphere" pos="0.4 0 0" size="0.05" mass="0"/><site name="grip" pos="0.4 0 0"/>
  </body></body></worldbody></mujoco>"""

FLAT_TARGET = """<mujoco><option gravity="0 0 0"/><worldbody><body name="target">
  <inertial pos="0.05 0.02 0" mass="3" diaginertia="0.1 0.1 0.2"/>
  <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" axis="0 0 1"/>
  <geom name="target" type="sphere" size="0.1" mass="0"/><site name="handle" pos="-0.1 0.02 0"/>
  </body></worldbody></mujoco>"""


class Bench:
    """An arm and a target without a scenario, free and held, to be put into any state."""

    def __init__(self, folder, robot=ARM, target=TARGET, time_step_s=1e-3, joint=RIGID):
        (folder / "robot.xml").write_text(robot)
        (folder / "target.xml").write_text(target)
        files = read_model(folder / "robot.xml"), {"target": read_model(folder / "target.xml")}
        self.system = compile_system(*files, time_step_s=time_step_s)
        self.grasp = Grasp("grasp", "robot/grip", "target/handle", "robot/hand", "target", "target/target", joint)
        self.held_system = compile_system(*files, time_step_s=time_step_s, grasp=self.grasp)
        self.model, self.data = self.system.mj, mujoco.MjData(self.system.mj)
        self.sites = Sites(self.system, self.grasp)
        self.motion = Motion(self.model, self.data)
        self.grasped_motion = GraspedMotion(self.motion, Scene(self.system, self.data), self.held_system, self.grasp)

    def draw(self, rng, speed=1.0):
        """Any state."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_integratePos(self.model, self.data.qpos, rng.normal(size=self.model.nv), 1.0)
        self.data.qvel[:] = speed * rng.normal(size=self.model.nv)
        mujoco.mj_forward(self.model, self.data)

    def impulse(self):
        """What joins the two here."""
        sites = self.sites
        stopped = self.grasped_motion.joints.stopped(self.data)
        return plastic_impulse(self.model, self.data, sites.link, sites.root, sites.point(self.data), stopped)

    def capture(self):
        """Join the two here; returns the impulse."""
        found = self.impulse()
        self.data.qvel[:] += found.change
        mujoco.mj_forward(self.model, self.data)
        self.grasped_motion.hold()
        return found

    def momentum(self):
        """P, and L about the origin, summed body by body."""
        return of_subtree(self.model, self.data, 0)

    def energy(self):
        """Kinetic, J."""
        return kinetic_energy(mass_matrix(self.model, self.data), self.data.qvel)

    def moduli(self):
        """Sums of the moduli of the terms that the momenta are made of: what they cannot be known better than."""
        model, data = self.model, self.data
        mujoco.mj_subtreeVel(model, data)
        linear = sum(m * np.linalg.norm(_velocity(model, data, b)) for b, m in enumerate(model.body_mass) if m)
        lever = max(np.linalg.norm(data.xipos[b]) for b in range(model.nbody))
        spin = sum(model.body_inertia[b].max() * np.linalg.norm(data.cvel[b][:3]) for b in range(1, model.nbody))
        return linear * (1.0 + lever) + spin

    def twist(self):
        """Relative twist of the two at the object's site, (6,)."""
        sites = self.sites
        return relative_twist_rows(self.model, self.data, sites.link, sites.root, sites.point(self.data)) @ self.data.qvel


def _velocity(model, data, body):
    jacobian = np.empty((3, model.nv))
    mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
    return jacobian @ data.qvel
