"""A grasp in the model: the base of an object becomes a child of a link of the robot, without joints of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

_NO_TURN = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Grasp:
    """Sites and bodies that a grasp joins.

    Attributes:
        name: Name of the grasp in the scenario.
        robot_site: Full name of the site of the robot.
        object_site: Full name of the site of the object.
        link: Full name of the body of the robot's site.
        tree: Name of the object.
        root: Full name of the base of the object, the body of the object's site.
    """

    name: str
    robot_site: str
    object_site: str
    link: str
    tree: str
    root: str


def join(scene: Any, spec: Any, grasp: Grasp) -> None:
    """Attach an object to the link of a grasp, without the joints of its base. Its pose in the link is set at the capture.

    Args:
        scene: Specification of the scene, with the robot attached.
        spec: Specification of the object.
        grasp: The grasp.
    """
    base = spec.body(grasp.root.partition("/")[2])
    gone = {joint.name for joint in base.joints}
    for sensor in [each for each in spec.sensors if each.objtype == mujoco.mjtObj.mjOBJ_JOINT and each.objname in gone]:
        spec.delete(sensor)
    for joint in base.joints:
        spec.delete(joint)
    base.pos, base.quat = np.zeros(3), np.array(_NO_TURN)
    scene.body(grasp.link).add_frame().attach_body(base, f"{grasp.tree}/", "")
