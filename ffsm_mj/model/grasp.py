"""A grasp: an object's body becomes a child of a body of the robot, and its own joint is gone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

_NO_TURN = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Grasp:
    """Which two bodies are joined.

    Attributes:
        name: What the scenario calls it.
        robot_site: Full name of the site of the robot.
        object_site: Full name of the site of the object.
        link: Full name of the body that the robot's site is on.
        tree: Name of the object.
        root: Full name of the object's base, which the object's site is fixed to.
    """

    name: str
    robot_site: str
    object_site: str
    link: str
    tree: str
    root: str


def join(scene: Any, spec: Any, grasp: Grasp) -> None:
    """Attach an object to the link that holds it, its base's joints taken away; where it is held is written later.

    Args:
        scene: Specification that the robot is attached to already.
        spec: That of the object.
        grasp: Who holds it.
    """
    base = spec.body(grasp.root.partition("/")[2])
    for joint in base.joints:
        spec.delete(joint)
    base.pos, base.quat = np.zeros(3), np.array(_NO_TURN)
    scene.body(grasp.link).add_frame().attach_body(base, f"{grasp.tree}/", "")
