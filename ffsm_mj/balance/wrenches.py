"""Power and resultants of wrenches on bodies, by subsystem: total, robot and objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.model.system import System
from ffsm_mj.records.wrench import Wrench

_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)


def rates_by_subsystem(
    system: System, data: Any, wrenches: Sequence[Wrench], grasped_bodies: frozenset[int] = frozenset()
) -> FloatArray:
    """Power by subsystem, and resultant wrenches between subsystems and from fixed bodies, (21,).

    Power to (total, robot, objects) in W, then wrenches (force, moment about the world origin): of the robot on the objects,
    of fixed bodies on the robot, of fixed bodies on the objects.

    Args:
        system: Robot and objects.
        data: Their state, positions and velocities current.
        wrenches: Wrenches on bodies; equal and opposite ones within one subsystem cancel. A wrench on a fixed body is
            adjacent to its reaction: first and second, third and fourth.
        grasped_bodies: Bodies of a grasped object, which count as the robot's; wrenches of fixed bodies on them stay
            external, on the objects, and are subtracted from the robot's.
    """
    rates, twist, fixed = np.zeros(21), np.empty(6), system.fixed_bodies
    robot = grasped_bodies.union(system.robot.bodies)
    for i, (body, point, force, torque) in enumerate(wrenches):
        if body in fixed:
            continue  # a fixed body takes no power
        mujoco.mj_objectVelocity(system.mj, data, _BODY, body, twist, 0)
        power = force @ (twist[3:] + cross(twist[:3], point - data.xpos[body])) + torque @ twist[:3]
        rates[0] += power
        rates[1 if body in robot else 2] += power
        outside = bool(fixed) and _answers(wrenches, i, fixed)
        if not outside and body in robot:
            continue
        wrench = np.concatenate((force, cross(point, force) + torque))
        if not outside:
            rates[3:9] += wrench
        elif body in grasped_bodies:
            rates[15:] += wrench
            rates[3:9] -= wrench
        elif body in robot:
            rates[9:15] += wrench
        else:
            rates[15:] += wrench
    return rates


def _answers(wrenches: Sequence[Wrench], i: int, fixed: frozenset[int]) -> bool:
    """Whether a wrench is the reaction to one on a fixed body."""
    other = i + 1 if i % 2 == 0 else i - 1
    return other < len(wrenches) and wrenches[other].body in fixed
