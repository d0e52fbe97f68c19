"""The least possible error of the tip: after an impact the robot drifts, and with it what it can reach.

Torques move neither the centre of mass of the robot nor its momentum. The tip of the planar robot can be at most R from that
centre, with the arm stretched in line with the base and the mount of the arm; so the error is at least |c(t) - y_d| - R.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mujoco
import numpy as np

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray

_MOUNT_M = math.hypot(0.9, 0.4)
REACH_M = _MOUNT_M + 6.0 - (2.0 * (3.0 * _MOUNT_M + 9.0) + _MOUNT_M + 6.0) / 12.0
"""Greatest distance of the tip from the centre of mass of the planar robot, m: base of 5 kg with the mount off its centre,
links of 2 m with 2, 2 and 2 kg and a gripper of 1 kg."""


def floor(run: Run, times: FloatArray) -> FloatArray:
    """Least possible error of the tip from the start of the phase ``regulate`` on, m; of the planar robot."""
    start_s = next(phase.start_s for phase in run.phases if phase.name == "regulate")
    row = int(np.searchsorted(run.time, start_s - 1e-9))
    model = _model()
    data = mujoco.MjData(model)
    data.qpos[:] = run.qpos[row]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    root = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "robot/base")
    mass = float(model.body_subtreemass[root])
    speed = np.array([run[f"momentum.robot_P_{axis}_N_s"][row] for axis in "xy"]) / mass
    target = np.array(run.summary()["tip"]["target_m"][:2])
    away = data.subtree_com[root][:2] - target + np.outer(times - run.time[row], speed)
    return np.asarray(np.maximum(np.hypot(*away.T) - REACH_M, 0.0))


def reach_end_s(run: Run) -> float:
    """Time at which the target leaves the reach, s, to 1 ms; infinite if it does not within a minute."""
    times = np.arange(0.0, 60.0, 1e-3) + float(run.time[0])
    beyond = np.flatnonzero(floor(run, times) > 0.0)
    later = beyond[times[beyond] > run.phases[-1].start_s]
    return float(times[later[0]]) if len(later) else math.inf


@cache
def _model() -> Any:
    return ffsm_mj.Scenario.load("baseline").system.mj
