"""Bullet by PyBullet: reduced coordinates, sequential impulses, double precision."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from engine_runs.mjcf import frame_of
from engine_runs.scene import Body, Joint, Scene, initial_twists
from engine_runs.states import States

Link = tuple[int, int]


@dataclass(frozen=True)
class Recipe:
    """Arguments of ``setPhysicsEngineParameter``, and of ``changeDynamics`` for every link."""

    parameters: dict[str, Any] = field(default_factory=dict)
    dynamics: dict[str, Any] = field(default_factory=dict)


def _link(scene: Scene, body: Body) -> str:
    """URDF of a link whose frame lies in its joint, or in its centre of mass."""
    centre = np.array(body.position_m) - frame_of(body)
    at = f'<origin xyz="{centre[0]} {centre[1]} {centre[2]}"/>'
    x, y, z = body.inertia_kg_m2
    shape = ""
    if any(body.name in pair for pair in scene.touching):
        size = " ".join(str(2 * half) for half in body.half_m or ())
        kind = f'<box size="{size}"/>' if body.half_m else f'<sphere radius="{body.radius_m}"/>'
        shape = f"<collision>{at}<geometry>{kind}</geometry></collision>"
    return (
        f'<link name="{body.name}"><inertial>{at}<mass value="{body.mass_kg}"/>'
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>{shape}</link>'
    )


def _joint(scene: Scene, body: Body, joint: Joint) -> str:
    """URDF of the joint of a link."""
    kind = {"hinge": "continuous", "slide": "prismatic"}[joint.kind]
    origin = frame_of(scene.body(joint.parent)) if joint.parent else np.zeros(3)
    x, y, z = np.array(joint.anchor_m) - origin
    axis = " ".join(map(str, joint.axis))
    return (
        f'<joint name="{body.name}" type="{kind}"><parent link="{joint.parent or "ground"}"/><child link="{body.name}"/>'
        f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/><limit lower="1" upper="-1" effort="1e9" velocity="1e9"/>'
        f'<dynamics damping="{joint.damping}"/></joint>'
    )


def _tree(p: Any, scene: Scene, bodies: list[Body]) -> list[Link]:
    """One tree, from URDF: ``createMultiBody`` takes no inertia of links without geometry."""
    grounded = bodies[0].joint is not None
    links = "".join(_link(scene, body) for body in bodies)
    joints = "".join(_joint(scene, body, body.joint) for body in bodies if body.joint)
    ground = '<link name="ground"/>' if grounded else ""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "tree.urdf"
        path.write_text(f'<robot name="{bodies[0].name}">{ground}{links}{joints}</robot>')
        place = (0.0, 0.0, 0.0) if grounded else bodies[0].position_m
        number = p.loadURDF(str(path), place, useFixedBase=grounded, flags=p.URDF_USE_INERTIA_FROM_FILE)
    numbers = {p.getJointInfo(number, i)[1].decode(): i for i in range(p.getNumJoints(number))}
    return [(number, numbers.get(body.name, -1)) for body in bodies]


def _set(p: Any, scene: Scene, body: Body, link: Link, twist: tuple[np.ndarray, np.ndarray], recipe: Recipe) -> None:
    """Material, no damping, and velocities at the start; Bullet multiplies restitution and friction of both bodies."""
    p.changeDynamics(
        *link,
        linearDamping=0.0,
        angularDamping=0.0,
        restitution=np.sqrt(scene.restitution),
        lateralFriction=np.sqrt(scene.mu),
        rollingFriction=0.0,
        spinningFriction=0.0,
        maxJointVelocity=1e9,
        **recipe.dynamics,
    )
    p.changeDynamics(*link, activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)
    if body.joint is None:
        p.resetBaseVelocity(link[0], *(part.tolist() for part in twist))
    else:
        p.resetJointState(*link, 0.0, body.joint.rate)
        p.setJointMotorControl2(*link, p.VELOCITY_CONTROL, force=0.0)


def built(p: Any, scene: Scene, recipe: Recipe, step_s: float) -> dict[str, Link]:
    """The scene at its start; links by name of the body."""
    p.resetSimulation()
    p.setGravity(0, 0, 0)
    p.setTimeStep(step_s)
    p.setPhysicsEngineParameter(numSubSteps=0, deterministicOverlappingPairs=1, **recipe.parameters)
    trees: dict[str, list[Body]] = {}
    root: dict[str, str] = {}
    for body in scene.bodies:
        above = body.joint.parent if body.joint else ""
        root[body.name] = root[above] if above else body.name
        trees.setdefault(root[body.name], []).append(body)
    links: dict[str, Link] = {}
    for tree in trees.values():
        links |= dict(zip([body.name for body in tree], _tree(p, scene, tree), strict=True))
    for body, twist in zip(scene.bodies, initial_twists(scene).values(), strict=True):
        _set(p, scene, body, links[body.name], twist, recipe)
    if scene.weld:
        first, second = scene.weld
        place = np.array(scene.body(second).position_m) - np.array(scene.body(first).position_m)
        weld = p.createConstraint(
            links[first][0], -1, links[second][0], -1, p.JOINT_FIXED, (0, 0, 0), place.tolist(), (0, 0, 0)
        )
        p.changeConstraint(weld, maxForce=1e9)
    return links


def states(p: Any, scene: Scene, links: dict[str, Link]) -> States:
    """Of every body."""
    rows: list[list[np.ndarray]] = [[], [], [], []]
    for body in scene.bodies:
        number, link = links[body.name]
        if link < 0:
            (place, turn), (v, w) = p.getBasePositionAndOrientation(number), p.getBaseVelocity(number)
        else:
            found = p.getLinkState(number, link, computeLinkVelocity=1, computeForwardKinematics=1)
            place, turn, v, w = found[0], found[1], found[6], found[7]
        for row, value in zip(rows, (place, np.array(turn)[[3, 0, 1, 2]], v, w), strict=True):
            row.append(np.array(value))
    return States(*(np.array(row) for row in rows))


def run(scene: Scene, recipe: Recipe, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of the loop of ``stepSimulation``."""
    import pybullet as p

    p.connect(p.DIRECT)
    try:
        links = built(p, scene, recipe, step_s)
        found, spent, done = [], 0.0, 0
        marks = {*scene.times_s, *(begin for _, begin in scene.efforts.values() if begin > 0.0)}
        for time_s in sorted(marks):
            steps = round(time_s / step_s) - done
            pushed = [
                (*links[name], effort) for name, (effort, begin) in scene.efforts.items() if done * step_s >= begin - 1e-12
            ]
            clock = time.process_time()
            for _ in range(steps):
                for number, link, effort in pushed:
                    p.setJointMotorControl2(number, link, p.TORQUE_CONTROL, force=effort)
                p.stepSimulation()
            spent += time.process_time() - clock
            done += steps
            if time_s in scene.times_s:
                found.append(states(p, scene, links))
        return found, spent
    finally:
        p.disconnect()
