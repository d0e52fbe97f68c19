"""A grasp in the model: the base of an object becomes a child of a link of the robot.

The joints of the base are removed. Those of the latch, if it leaves some relative motion free, take their place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

_NO_TURN = (1.0, 0.0, 0.0, 0.0)

LatchKind = Literal["rigid", "ball", "hinge", "slide", "cylindrical"]
JOINTS: dict[str, tuple[str, ...]] = {
    "rigid": (),
    "ball": ("ball",),
    "hinge": ("hinge",),
    "slide": ("slide",),
    "cylindrical": ("slide", "hinge"),
}
"""MuJoCo joints of each kind of latch, in their order on the object's base."""
WRITTEN = ("body_pos", "body_quat", "jnt_pos", "jnt_axis")
"""Fields of a model with a grasped object that are written when the grasp closes."""


@dataclass(frozen=True)
class LatchJoint:
    """Relative motion that a closed grasp leaves free.

    Attributes:
        kind: ``rigid`` (none), ``ball``, ``hinge``, ``slide`` or ``cylindrical`` (a hinge and a slide on one axis).
        axis: Unit vector along the axis in the frame of the robot's site, for kinds that have one. The axis passes through
            the object's site.
    """

    kind: LatchKind = "rigid"
    axis: tuple[float, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """Its MuJoCo joints."""
        return JOINTS[self.kind]


RIGID = LatchJoint()


@dataclass(frozen=True)
class Grasp:
    """Sites and bodies that a grasp joins.

    Attributes:
        name: Name of the grasp in the scenario.
        robot_site: Full name of the site of the robot.
        object_site: Full name of the site of the object.
        link: Full name of the body of the robot's site.
        tree: Name of the object.
        root: Full name of the body of the object's site: the base of the object, or a link that moves relative to it.
        joint: Relative motion that it leaves free.
        max_force_N: Force at which it opens by itself, N; infinite without a limit.
        max_torque_N_m: Torque about the object's site at which it opens by itself, N m.
    """

    name: str
    robot_site: str
    object_site: str
    link: str
    tree: str
    root: str
    joint: LatchJoint = RIGID
    max_force_N: float = math.inf
    max_torque_N_m: float = math.inf

    def joins_sites_of(self, other: Grasp) -> bool:
        """Whether another grasp joins the same two sites."""
        return (self.robot_site, self.object_site) == (other.robot_site, other.object_site)

    def joint_name(self, kind: str) -> str:
        """Full name of one of its joints in a system in which it is closed."""
        return f"{self.tree}/{self.name}_{kind}"


def join(scene: Any, spec: Any, grasp: Grasp) -> None:
    """Attach an object to the link of a grasp, by the joints of the latch in place of those of its base.

    The pose on the link, the axis and the point of the joints are written at closing.

    Args:
        scene: Specification of the scene, with the robot attached.
        spec: Specification of the object.
        grasp: The grasp.
    """
    base = spec.body(grasp.root.partition("/")[2])
    gone = {joint.name for joint in base.joints}
    for sensor in [
        candidate
        for candidate in spec.sensors
        if candidate.objtype == mujoco.mjtObj.mjOBJ_JOINT and candidate.objname in gone
    ]:
        spec.delete(sensor)
    for joint in base.joints:
        spec.delete(joint)
    for kind in grasp.joint.joints:
        joint = base.add_joint(name=grasp.joint_name(kind).partition("/")[2])
        joint.type = getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}")
        # Defaults of the object's file are for its own joints: a latch has no friction, spring, limit or inertia.
        joint.damping, joint.stiffness, joint.frictionloss, joint.armature = np.zeros(3), np.zeros(3), 0.0, 0.0
        joint.ref, joint.springref, joint.limited = 0.0, 0.0, mujoco.mjtLimited.mjLIMITED_FALSE
    base.pos, base.quat = np.zeros(3), np.array(_NO_TURN)
    scene.body(grasp.link).add_frame().attach_body(base, f"{grasp.tree}/", "")
