"""What an impact does to an estimate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ffsm_controllers.estimators.mekf.config import MekfConfig
from ffsm_controllers.estimators.mekf.estimate import Estimate
from ffsm_controllers.estimators.mekf.grasped import GraspedScene
from ffsm_controllers.estimators.mekf.layout import FloatingBody, Layout
from ffsm_mj.controller_protocol import System


def is_jump(event: Any) -> bool:
    """Whether velocities jump at an event: an impact of geoms or at a joint limit, or the closing of a grasp.

    Their records, and no others, state energies before and after, although the numbers are not reported to the robot.
    """
    return hasattr(event, "energy_before_J")


def inflate(estimate: Estimate, names: Iterable[str], config: MekfConfig, grasped: Mapping[str, GraspedScene]) -> None:
    """Inflate the covariance at an event at which velocities of some floating bodies jump; the estimate itself stays.

    To the variances of velocity and angular velocity of each body those of ``impact_velocity_m_s`` and
    ``impact_rate_rad_s`` are added: the jump is taken to be of zero mean, independent of what was, in any direction. An
    object that is grasped moves with the robot.
    """
    more = np.zeros(estimate.layout.size)
    for body in _moving([estimate.layout.named(name) for name in names], estimate, grasped):
        more[body.velocity] = config.impact_velocity_m_s**2
        more[body.rate] = config.impact_rate_rad_s**2
    estimate.covariance = estimate.covariance + np.diag(more)


def _moving(bodies: list[FloatingBody], estimate: Estimate, grasped: Mapping[str, GraspedScene]) -> list[FloatingBody]:
    """Bodies whose errors are not those of others: the base of the robot in place of an object that it holds."""
    if estimate.grasped is None or (scene := grasped[estimate.grasped.grasp]).object not in bodies:
        return bodies
    carrier = scene.carrier.name if scene.carrier is not None else ""
    return [body for body in estimate.layout.bodies if body.name == carrier or (body in bodies and body is not scene.object)]


def involved(event: Any, system: System, layout: Layout) -> tuple[str, ...]:
    """Names of the floating bodies with one of the geoms, the sites or the joint of an event; all if it names none."""
    model = system.mj
    if getattr(event, "robot_site", None):  # a grasp that leaves motion free: its record calls the kind of latch its joint
        ids = [int(model.site(name).bodyid[0]) for name in (event.robot_site, event.object_site)]
    else:
        ids = [int(model.geom(name).bodyid[0]) for name in getattr(event, "geoms", ())]
        ids += [system.joint(event.joint).body] if getattr(event, "joint", None) else []
    return tuple(body.name for body in layout.bodies if not ids or any(body_id in body.tree.bodies for body_id in ids))
