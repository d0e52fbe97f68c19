"""A floating robot with two arms that hold objects: the first grasp as a child body, the second one as a latch by rows."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.grasp.closing_condition import Sites
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.latch_joints import plastic_impulse
from ffsm_mj.contact_models.grasp.load import InterfaceLoad
from ffsm_mj.contact_models.grasp.loops import LoopForces, closing_pose, loop_latch
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat
from ffsm_mj.contact_models.impact.model import ImpactModel, ImpactRules
from ffsm_mj.contact_models.impact.rest_rule import RestRule
from ffsm_mj.contact_models.interface import EventTime, Scene
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.grasp import Grasp, LatchJoint
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.scenes import of_subtree

LINKS = ((1.2, ".25 0 0", ".03 .01 .03"), (0.9, ".2 0 0", ".02 .008 .02"), (0.5, ".1 0 0", ".005 .003 .005"))
OBJECT = """<mujoco><option gravity="0 0 0"/><worldbody><body name="{name}"><freejoint name="free"/>
  <inertial pos=".03 .02 0" mass="3" diaginertia=".05 .08 .06"/>{geom}
  <site name="at_l" pos="{left}"/><site name="at_r" pos="{right}"/></body></worldbody></mujoco>"""
PLANAR, SPATIAL = ("0 0 1",) * 3, ("0 0 1", "1 0 0", "0 0 1")
START = (0.3, -0.7, 0.2, -0.25, 0.6, -0.3)


def robot(axes, geoms=""):
    """A base of 10 kg with two arms of three hinges, at lengths 0, .5 and .9."""
    return (
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>'
        f'<inertial pos="0 0 0" mass="10" diaginertia=".8 .7 .9"/>{geoms}{arm("l", -1, axes)}{arm("r", 1, axes)}</body>'
        f"</worldbody><actuator>{''.join(f'<motor name={n!r} joint={n!r}/>' for n in _joints())}</actuator></mujoco>"
    )


def _joints():
    return [f"{name}{k}" for name in "lr" for k in range(3)]


def arm(name, sign, axes):
    """Three hinges at lengths 0, .5, .9 of an arm along y at x = +-.3, with a hand that weighs nothing."""
    text, ends = "", ""
    for k, (mass, centre, inertia) in enumerate(LINKS):
        along = centre.split()[0]
        pos = f"{sign * 0.3} 0 0" if k == 0 else f"0 {(0.5, 0.4)[k - 1]} 0"
        text += (
            f'<body name="{name}{k}" pos="{pos}"><joint name="{name}{k}" axis="{axes[k]}"/>'
            f'<inertial pos="0 {along} 0" mass="{mass}" diaginertia="{inertia}"/>'
        )
        ends += "</body>"
    return f'{text}<site name="hand_{name}"/><geom name="palm_{name}" type="sphere" size=".02" mass="0"/>{ends}'


class TwoHands:
    """Both hands at an object, or each at its own, in the state of the published example, before any grasp closes."""

    def __init__(
        self,
        folder,
        axes=SPATIAL,
        step_s=1e-3,
        joints=("rigid", "rigid"),
        objects=("target", "target"),
        geoms=("", ""),
        pairs=(),
    ):
        places = {}
        for side in "lr":  # the pose of the hands at the start is needed for the sites
            places[side] = hand(axes, side)
        at = {
            name: np.mean([places[s] for s, o in zip("lr", objects, strict=True) if o == name], axis=0) for name in objects
        }
        at = {name: place + np.array((0.0, 0.15, 0.0)) for name, place in at.items()}
        folder.mkdir(exist_ok=True)
        (folder / "robot.xml").write_text(robot(axes, geoms[0]))
        files = {}
        for name, place in at.items():
            sites = {key: " ".join(f"{x:.17g}" for x in places[s] - place) for key, s in (("left", "l"), ("right", "r"))}
            (folder / f"{name}.xml").write_text(OBJECT.format(name=name, geom=geoms[1], **sites))
            files[name] = read_model(folder / f"{name}.xml")
        models = read_model(folder / "robot.xml"), files
        self.step_s = step_s
        self.system = compile_system(*models, time_step_s=step_s)
        self.data = mujoco.MjData(self.system.mj)
        self.scene, self.free = Scene(self.system, self.data), Motion(self.system.mj, self.data)
        self.grasps = {
            side: Grasp(
                side, f"robot/hand_{side}", f"{name}/at_{side}", f"robot/{side}2", name, f"{name}/{name}", _joint(kind)
            )
            for side, name, kind in zip("lr", objects, joints, strict=True)
        }
        systems = {side: compile_system(*models, time_step_s=step_s, grasp=grasp) for side, grasp in self.grasps.items()}
        self.grasped_motion = {s: GraspedMotion(self.free, self.scene, systems[s], self.grasps[s]) for s in "lr"}
        self.data.qpos[7:13] = START
        for name, place in at.items():
            first = self.system.joints[f"{name}/free"].qpos.start
            self.data.qpos[first : first + 3] = place
        self.data.qvel[:] = 0.3 * np.random.default_rng(3).normal(size=self.system.mj.nv)
        mujoco.mj_forward(self.system.mj, self.data)
        self.pairs = [ContactPair(self.system, *pair) for pair in pairs]
        overlap, heat = DeepestOverlap(()), FrictionHeat()
        persistent = PersistentContactModel(self.scene, self.pairs, overlap, heat)
        rules = ImpactRules("blend", RestRule(step_s, 1e-4), 1000, stop_on_impact=False)
        impacts = ImpactModel(self.scene, self.pairs, rules, persistent, overlap, heat)
        self.loops, self.records = LoopForces(self.scene, (persistent,)), []
        models = (impacts, self.loops, persistent) if pairs else (self.loops,)
        self.persistent, self.integrator = persistent, EventDrivenIntegrator(self.free, models)

    def close_first(self, side):
        """Attach the object to a hand as a child body; returns the plastic impulse."""
        held, sites = self.grasped_motion[side], Sites(self.system, self.grasps[side])
        stopped = held.joints.stopped(self.data)
        found = plastic_impulse(self.system.mj, self.data, sites.link, sites.root, sites.point(self.data), stopped)
        self.data.qvel[:] += found.change
        mujoco.mj_forward(self.system.mj, self.data)
        held.hold()
        self.integrator.bind(held)
        return found

    def latch(self, side):
        grasp = self.grasps[side]
        return loop_latch(self.system, grasp, closing_pose(self.system, self.data, grasp))

    def close_further(self, side):
        """Close a latch by rows; returns the closing."""
        found = self.loops.close(side, self.latch(side))
        self.integrator.bind(self.integrator.motion)
        return found

    def close(self, first="l", second="r"):
        """Close both; returns rank and loss."""
        one, other = self.close_first(first), self.close_further(second)
        return one.rank + other.rank, one.loss_J + other.loss_J

    def run(self, duration_s, torques=None):
        """Advance, with joint torques as a function of time held over each step."""
        for _ in range(round(duration_s / self.step_s)):
            if torques is not None:
                self.data.ctrl[:] = torques(self.data.time)
            left = self.step_s
            while left > 1e-12:
                elapsed, source = self.integrator.advance(left)
                left -= elapsed
                self.integrator.exchanges(elapsed)
                if source is not None:
                    self._apply(source)

    def _apply(self, source):
        effect = self.integrator.act(source, EventTime(self.data.time, 0))
        if effect is not None:
            self.records += effect.records
        self.integrator.restart()

    def loads(self):
        """Loads of both grasps on the object, (6,) each."""
        loads = {}
        for side in "lr":
            site = self.system.index("site", self.grasps[side].object_site)
            if side == self.integrator.motion.grasp:
                held = self.grasped_motion[side]
                loads[side] = InterfaceLoad(held, self.data.site_xpos[site], self.data, (self.loops,)).now()
            else:
                loads[side] = self.loops.load(side)
        return loads

    def momentum(self):
        """P, and L about the origin, summed body by body."""
        return of_subtree(self.system.mj, self.data, 0)

    def energy(self):
        return kinetic_energy(mass_matrix(self.system.mj, self.data), self.data.qvel)

    def everything(self):
        return np.concatenate((self.data.qpos, self.data.qvel))


def _joint(kind):
    return LatchJoint(kind, () if kind in ("rigid", "ball") else (0.0, 0.0, 1.0))


def hand(axes, side):
    model = mujoco.MjModel.from_xml_string(robot(axes))
    data = mujoco.MjData(model)
    data.qpos[7:13] = START
    mujoco.mj_kinematics(model, data)
    return np.array(data.site(f"hand_{side}").xpos)
