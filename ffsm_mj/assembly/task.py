"""The task of a scenario: the tip, its target, and how the target moves."""

from __future__ import annotations

import numpy as np

from ffsm_mj.controller_protocol import Task
from ffsm_mj.dynamics.site_motion import MovingFrame
from ffsm_mj.dynamics.trajectories import PathMotion, SiteTarget, TargetMotion
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.task_config import TaskConfig

_AXES = {"x": 0, "y": 1, "z": 2}


def task_of(scenario: ScenarioConfig, system: System) -> Task | None:
    """Task of a scenario; None if it has none.

    Raises:
        ScenarioFaults: There is no such tip, or no such site to follow.
    """
    config = scenario.task
    if config is None:
        return None
    try:
        site = system.index("site", config.tip)
    except LookupError as error:
        raise ScenarioFaults([Fault(str(error.args[0]), ("task", "tip"))]) from error
    axes = tuple(_AXES[axis] for axis in config.axes)
    return Task(site, axes, np.array(config.target_m, dtype=np.float64), _motion(config, axes, scenario, system))


def _motion(config: TaskConfig, axes: tuple[int, ...], scenario: ScenarioConfig, system: System) -> TargetMotion | None:
    """How the target moves.

    Raises:
        ScenarioFaults: There is no such site to follow, or it is of the robot or of an object that may be grasped.
    """
    given = config.trajectory
    if given is None:
        return None
    if given.site is not None:
        frame = MovingFrame(system.mj, _site(given.site, scenario, system), np.array(given.offset_m))
        return SiteTarget(frame, axes)
    waypoints = given.waypoints or ()
    times = [given.start_s, *(waypoint.at_s for waypoint in waypoints)]
    return PathMotion(times, np.array([config.target_m, *(waypoint.position_m for waypoint in waypoints)]))


def _site(name: str, scenario: ScenarioConfig, system: System) -> int:
    """Id of the site that a target is fixed to.

    Raises:
        ScenarioFaults: See :func:`_motion`.
    """
    path = ("task", "trajectory", "site")
    try:
        full = system.resolve("site", name)
    except LookupError as error:
        raise ScenarioFaults([Fault(str(error.args[0]), path)]) from error
    tree, _, _ = full.partition("/")
    if tree == "robot":
        raise ScenarioFaults([Fault(f"{full} is a site of the robot; a site of an object is needed", path)])
    if any(system.resolve("site", grasp.object_site).startswith(f"{tree}/") for grasp in scenario.grasps.values()):
        message = (
            f"{tree} may be grasped, and would then carry the target with the tip; use the law 'track' or 'impedance' "
            "with 'object_site', which know of grasps"
        )
        raise ScenarioFaults([Fault(message, path)])
    return system.index("site", full)
