"""The paper's main result as an experiment: what the arm alone can and cannot do with momentum in the robot.

Joint torques are internal: the robot's mass centre moves at P / m whatever they do. The tip is never farther from the mass
centre than with the arm straight, so with P not zero there is a time after which no arm controller holds any point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.validation.cases.seed_paper.runs import state_at

_EVERY = 50  # rows


@dataclass(frozen=True)
class DriftExperiment:
    """A long run seen from the robot's mass centre.

    Attributes:
        time_s: Times, (n,).
        error_m: Distance of the tip from its target, (n,).
        bound_m: What it is at least, wherever the arm is, (n,): distance of mass centre and target minus the reach.
        momentum_N_s: Linear momentum of the robot at the end, magnitude.
        mass_kg: Mass of the robot.
        rate_m_s: Speed of the mass centre over the last phase, by a straight line through its positions.
        lost_s: When the bound leaves zero for good; infinite where it does not, at this momentum.
    """

    time_s: FloatArray
    error_m: FloatArray
    bound_m: FloatArray
    momentum_N_s: float
    mass_kg: float
    rate_m_s: float
    lost_s: float


def drift(run: Run, system: System) -> DriftExperiment:
    """A run, with a system of its models, seen from the robot's mass centre."""
    model, root = system.mj, system.robot.root
    centres = _mass_centres(run, system)
    task = logged_task(run.log.header.metadata)
    goal = np.zeros(3) if task is None else task.point_m
    time = run.time[::_EVERY]
    last = time >= run.phases[-1].start_s
    line = np.polyfit(time[last] - time[last][0], centres[last], 1)
    momentum = np.array([run[f"momentum.robot_P_{axis}_N_s"][-1] for axis in "xyz"])
    farthest = reach(system)
    bound = np.maximum(np.linalg.norm(centres - goal, axis=1) - farthest, 0.0)
    mass = float(model.body_subtreemass[root])
    lost = _lost(centres[last][0] - goal, momentum / mass, farthest)
    return DriftExperiment(
        time,
        run.tip_error()[::_EVERY],
        bound,
        float(np.linalg.norm(momentum)),
        mass,
        float(np.linalg.norm(line[0])),
        float(time[last][0]) + lost,
    )


def _mass_centres(run: Run, system: System) -> FloatArray:
    data = mujoco.MjData(system.mj)
    centres = []
    for row in run.log.rows[::_EVERY]:
        data.qpos[:] = row[1 : 1 + system.mj.nq]
        mujoco.mj_kinematics(system.mj, data)
        mujoco.mj_comPos(system.mj, data)
        centres.append(data.subtree_com[system.robot.root].copy())
    return np.array(centres)


def reach(system: System) -> float:
    """Largest distance of the tip from the robot's mass centre, m: all links in line with the arm's mount.

    The distance is the length of a sum of the segments with positive weights, so it is largest where they are parallel.
    """
    mount = system.mj.body("robot/link_1").pos
    qpos = np.zeros(system.mj.nq)
    qpos[system.joint("joint_1").qpos] = math.atan2(mount[1], mount[0])
    data = state_at(system, qpos, np.zeros(system.mj.nv))
    tip = data.site_xpos[system.index("site", "tip")]
    return float(np.linalg.norm(tip - data.subtree_com[system.robot.root]))


def _lost(offset: FloatArray, velocity: FloatArray, reach: float) -> float:
    """Time until a straight motion from inside leaves a ball of the reach, s."""
    a, b, c = float(velocity @ velocity), float(offset @ velocity), float(offset @ offset) - reach**2
    return math.inf if a == 0.0 else (-b + math.sqrt(max(b * b - a * c, 0.0))) / a
