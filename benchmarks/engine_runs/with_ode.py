"""ODE by Py3ODE: maximal coordinates, direct LCP solver (``World.step``), double precision."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine_runs.scene import Body, Scene, initial_twists
from engine_runs.states import States


@dataclass(frozen=True)
class Recipe:
    """Error reduction of joints and contacts, and softness of constraints."""

    erp: float = 0.2
    cfm: float = 0.0


class World:
    """A scene in ODE."""

    def __init__(self, ode: Any, scene: Scene, recipe: Recipe) -> None:
        """Bodies, joints and shapes at the start."""
        self.ode, self.scene = ode, scene
        self.world, self.space, self.contacts = ode.World(), ode.SimpleSpace(), ode.JointGroup()
        self.world.setGravity((0, 0, 0))
        self.world.setERP(recipe.erp)
        self.world.setCFM(recipe.cfm)
        self.bodies: dict[str, Any] = {}
        self.joints: dict[str, Any] = {}
        self.shapes: dict[str, Any] = {}
        for body, twist in zip(scene.bodies, initial_twists(scene).values(), strict=True):
            self._add(body, twist)
        if scene.weld:
            self.joints["weld"] = weld = ode.FixedJoint(self.world)
            weld.attach(*(self.bodies[name] for name in scene.weld))
            weld.setFixed()

    def _add(self, body: Body, twist: tuple[np.ndarray, np.ndarray]) -> None:
        ode, mass = self.ode, self.ode.Mass()
        mass.setParameters(body.mass_kg, 0, 0, 0, *body.inertia_kg_m2, 0, 0, 0)
        self.bodies[body.name] = added = ode.Body(self.world)
        added.setMass(mass)
        added.setPosition(body.position_m)
        added.setLinearVel(tuple(map(float, twist[0])))
        added.setAngularVel(tuple(map(float, twist[1])))
        if any(body.name in pair for pair in self.scene.touching):
            size = tuple(2.0 * half for half in body.half_m or ())
            self.shapes[body.name] = (
                ode.GeomBox(self.space, size) if body.half_m else ode.GeomSphere(self.space, body.radius_m)
            )
            self.shapes[body.name].setBody(added)
        if body.joint is None:
            return
        parent = self.bodies[body.joint.parent] if body.joint.parent else ode.environment
        slides = body.joint.kind == "slide"
        self.joints[body.name] = joint = (ode.SliderJoint if slides else ode.HingeJoint)(self.world)
        joint.attach(added, parent)
        if not slides:
            joint.setAnchor(body.joint.anchor_m)
        joint.setAxis(body.joint.axis)

    def step(self, step_s: float, time_s: float) -> None:
        """Contacts, efforts, dampers and a step."""
        self.contacts.empty()
        for pair in self.scene.touching:
            for contact in self.ode.collide(*(self.shapes[name] for name in pair)):
                contact.setMode(self.ode.ContactBounce | self.ode.ContactApprox1)
                contact.setBounce(self.scene.restitution)
                contact.setBounceVel(0.0)
                contact.setMu(self.scene.mu)
                joint = self.ode.ContactJoint(self.world, self.contacts, contact)
                joint.attach(*(self.bodies[name] for name in pair))
        for name, (effort, begin) in self.scene.efforts.items():
            damping = self.scene.body(name).joint.damping
            damper = damping * self.joints[name].getPositionRate() if damping else 0.0
            self.joints[name].addForce((effort if time_s >= begin - 1e-12 else 0.0) - damper)
        self.world.step(step_s)

    def states(self) -> States:
        """Of every body."""
        bodies = [self.bodies[body.name] for body in self.scene.bodies]
        return States(
            *(
                np.array([getattr(body, f"get{what}")() for body in bodies])
                for what in ("Position", "Quaternion", "LinearVel", "AngularVel")
            )
        )


def run(scene: Scene, recipe: Recipe, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of the loop of collision detection and ``World.step``."""
    import ode

    world, found, spent, done = World(ode, scene, recipe), [], 0.0, 0
    for time_s in scene.times_s:
        steps = round(time_s / step_s)
        clock = time.process_time()
        for number in range(done, steps):
            world.step(step_s, number * step_s)
        spent += time.process_time() - clock
        done = steps
        found.append(world.states())
    return found, spent
