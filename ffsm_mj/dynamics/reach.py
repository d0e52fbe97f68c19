"""Reach of an arm: a sphere that its tip cannot leave, whatever the angles of its joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System

_SLIDE = mujoco.mjtJoint.mjJNT_SLIDE


@dataclass(frozen=True)
class Reach:
    """A sphere around the first joint of an arm, which contains every point that the tip can reach.

    Attributes:
        tip: Full name of the site at the end of the arm.
        joint: Full name of the first joint between the base and the tip.
        centre_m: Its anchor in world axes, (3,), m.
        radius_m: Radius, m; infinite if a slide joint has no limits.
    """

    tip: str
    joint: str
    centre_m: FloatArray
    radius_m: float


def reach_of(system: System, data: Any, site: int) -> Reach | None:
    """Reach of a site of the robot; None if no joint lies between it and the base.

    The radius is the sum of the distances between successive joint anchors, and from the last one to the site. These
    distances do not depend on the angles, so no pose is farther away (triangle inequality). Limits of hinges and collisions
    are not considered: the tip need not reach every point inside.

    Args:
        system: Robot and objects.
        data: MuJoCo data with current kinematics.
        site: Id of the site.
    """
    model = system.mj
    arm = (joint for joint in system.robot.joints if joint.body != system.robot.root)
    chain = [model.joint(joint.name).id for joint in arm if _carries(model, joint.body, site)]
    if not chain:
        return None
    points = np.vstack((data.xanchor[chain], data.site_xpos[site]))
    travel = sum(_travel(model, data, joint) for joint in chain)
    radius = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) + travel
    return Reach(model.site(site).name, model.joint(chain[0]).name, points[0].copy(), radius)


def _carries(model: Any, body: int, site: int) -> bool:
    """Whether a body is the body of a site or one of its ancestors."""
    other = int(model.site_bodyid[site])
    while other > body:  # MuJoCo numbers parents before their children
        other = int(model.body_parentid[other])
    return other == body


def _travel(model: Any, data: Any, joint: int) -> float:
    """Greatest distance in m by which a joint can shift the anchors after it; zero for a hinge."""
    if model.jnt_type[joint] != _SLIDE:
        return 0.0
    if not model.jnt_limited[joint]:
        return float("inf")
    return float(np.abs(model.jnt_range[joint] - data.qpos[model.jnt_qposadr[joint]]).max())
