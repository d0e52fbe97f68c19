"""A cube between two fingers on slides, each finger a body of its own: a slide latch as a child body, and one by rows.

The thrust on the base grows as 48 t. By hand: the cube slips from t* = 2 mu N (8 + 1 + 1 + 2) / (48 * 2) = 0.5 s on; 0.1 s
later its speed relative to the base is -0.024 m/s, its way -0.0008 m, and the heat 0.0032 J.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.loops import LoopForces, closing_pose, loop_latch
from ffsm_mj.contact_models.impact.columns import DeepestOverlap, FrictionHeat
from ffsm_mj.contact_models.impact.model import ImpactModel, ImpactRules
from ffsm_mj.contact_models.impact.rest_rule import RestRule
from ffsm_mj.contact_models.interface import EventTime, ForceSource, Scene
from ffsm_mj.contact_models.persistent.model import PersistentContactModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.grasp import Grasp, LatchJoint
from ffsm_mj.records.contact_forces import Wrench
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from tests.scenes import HEAD

BASE = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="8" diaginertia=".8 .9 1"/><site name="rail"/></body></worldbody></mujoco>"""
PART = f"""<mujoco>{HEAD}<worldbody><body name="{{0}}"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="{{1}}" diaginertia="{{2}} {{2}} {{2}}"/><site name="rail"/>
  <geom name="pad" type="box" size=".05 {{3}} .05" mass="0"/></body></worldbody></mujoco>"""
MU, PRESS_N = 0.4, 5.0


class Drive(ForceSource):
    """Closing forces between base and fingers, and the thrust on the base."""

    active = True

    def wrenches(self, data):
        bodies = [self.scene.system.index("body", name) for name in ("robot/base", "left/left", "right/right")]
        y, zero = np.array((0.0, PRESS_N, 0.0)), np.zeros(3)
        given = ((1, y), (0, -y), (2, -y), (0, y), (0, np.array((0.0, 0.0, 48.0 * data.time))))
        return [Wrench(bodies[i], data.xpos[bodies[i]].copy(), force, zero) for i, force in given]


class Grip:
    def __init__(self, folder, step_s):
        parts = {"base": BASE}
        parts |= {
            name: PART.format(name, *rest)
            for name, *rest in (("left", 1, 0.001, 0.01), ("right", 1, 0.001, 0.01), ("cube", 2, 0.004, 0.05))
        }
        for name, text in parts.items():
            (folder / f"{name}.xml").write_text(text)
        base, *others = (read_model(folder / f"{name}.xml") for name in parts)
        models = base, dict(zip(("left", "right", "cube"), others, strict=True))
        self.step_s, self.system = step_s, compile_system(*models, time_step_s=step_s)
        system, self.data = self.system, mujoco.MjData(self.system.mj)
        for name, y in (("left", -0.06), ("right", 0.06)):
            self.data.qpos[system.joints[f"{name}/free"].qpos.start + 1] = y
        mujoco.mj_forward(system.mj, self.data)
        scene, free = Scene(system, self.data), Motion(system.mj, self.data)
        joint = LatchJoint("slide", (0.0, 1.0, 0.0))
        left, right = (
            Grasp(name, "robot/rail", f"{name}/rail", "robot/base", name, f"{name}/{name}", joint)
            for name in ("left", "right")
        )
        held = GraspedMotion(free, scene, compile_system(*models, time_step_s=step_s, grasp=left), left)
        pairs = [ContactPair(system, name, f"{name}/pad", "cube/pad", 0.0, MU) for name in ("left", "right")]
        overlap, self.heat, drive = DeepestOverlap(()), FrictionHeat(), Drive(scene)
        persistent = PersistentContactModel(scene, pairs, overlap, self.heat)
        rules = ImpactRules("blend", RestRule(step_s, 1e-4), 1000, stop_on_impact=False)
        impacts = ImpactModel(scene, pairs, rules, persistent, overlap, self.heat)
        self.loops, self.records = LoopForces(scene, (persistent, drive)), []
        self.integrator = EventDrivenIntegrator(free, (impacts, self.loops, persistent, drive))
        held.hold()
        self.integrator.bind(held)
        self.closing = self.loops.close("right", loop_latch(system, right, closing_pose(system, self.data, right)))
        self.integrator.bind(held)
        persistent.restore_state()
        self.integrator.bind(held)

    def run(self, until_s):
        while self.data.time < until_s - 1e-12:
            left = min(self.step_s, until_s - self.data.time)
            elapsed, source = self.integrator.advance(left)
            self.integrator.exchanges(elapsed)
            if source is None:
                continue
            effect = self.integrator.act(source, EventTime(self.data.time, 0))
            self.records += effect.records if effect is not None else ()
            self.integrator.restart()

    def relative(self):
        """Way and speed of the cube along z, relative to the base."""
        joints = self.system.joints
        cube, base = joints["cube/free"], joints["robot/free"]
        q, v = self.data.qpos, self.data.qvel
        return q[cube.qpos.start + 2] - q[base.qpos.start + 2], v[cube.dofs.start + 2] - v[base.dofs.start + 2]


@pytest.mark.long
def test_a_cube_slips_between_fingers_on_slide_latches(tmp_path):
    """RK4 integrates polynomials in time exactly: the digits are those by hand, to rounding, at 4 ms."""
    grip = Grip(tmp_path, 4e-3)
    assert grip.closing.rank == 5
    grip.run(0.6)
    way, speed = grip.relative()
    assert speed == pytest.approx(-0.024, abs=1e-11)
    assert way == pytest.approx(-0.0008, abs=1e-11)
    assert float(grip.heat.total_J[0]) == pytest.approx(0.0032, abs=1e-11)
    slips = [record.time_s for record in grip.records if "Slip" in type(record).__name__]
    assert slips[0] == pytest.approx(0.5, abs=1e-9)
    # What is held by rows moves as what is a child body: both fingers stay at equal distances.
    places = [grip.data.qpos[grip.system.joints[f"{name}/free"].qpos.start + 1] for name in ("left", "right")]
    assert abs(sum(places)) < 1e-11
    assert np.abs(grip.loops.motion.loops.errors()).max() < 1e-11
