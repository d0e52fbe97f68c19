"""What wrenches on bodies do to the parties: the whole, the robot, the objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.dynamics import cross
from ffsm_mj.model.system import System
from ffsm_mj.records.wrench import Wrench

_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)


def rates_by_party(system: System, data: Any, wrenches: Sequence[Wrench]) -> FloatArray:
    """Power to (total, robot, objects) in W, and the wrench on the objects: force, moment about the world origin, (9,).

    Args:
        system: Says whose the bodies are.
        data: Its state, positions and velocities current.
        wrenches: What acts; equal and opposite ones within one party leave nothing of it.
    """
    rates, twist, robot = np.zeros(9), np.empty(6), system.robot.bodies
    for body, point, force, torque in wrenches:
        mujoco.mj_objectVelocity(system.mj, data, _BODY, body, twist, 0)
        power = force @ (twist[3:] + cross(twist[:3], point - data.xpos[body])) + torque @ twist[:3]
        rates[0] += power
        if body in robot:
            rates[1] += power
        else:
            rates[2] += power
            rates[3:6] += force
            rates[6:9] += cross(point, force) + torque
    return rates
