"""Energy and impulse that wrenches between bodies exchange over a (sub-)step, by subsystem: total, robot and objects.

Power and resultants of the wrenches at a state are integrated by Simpson's rule with a cubic Hermite midpoint, as are
external forces, which keeps the order of the integrator. A pair of equal and opposite wrenches within one subsystem
exchanges nothing.

A grasped object counts as a part of the robot here, as in the equations of motion: the grasp enters everything the object
gains as given by the robot. An impulse of fixed bodies on it is entered as external to the objects, and subtracted from
what the robot gave.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.quadrature import hermite_midpoint, simpson
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.model.system import System
from ffsm_mj.records.contact_forces import Wrench

_NOTHING = np.zeros((2, 6))
_NOTHING.flags.writeable = False
_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)


class Exchange(NamedTuple):
    """Energy and impulse exchanged by contacts at an event or over a (sub-)step, by subsystem.

    Attributes:
        energy_J: Energy gained by (total, robot, objects), (3,).
        impulse: Impulse of the robot on the objects: force part in N s and moment about the world origin in N m s, (6,).
        outside: Impulse of fixed bodies, external to the system, on the robot and on the objects, (2, 6).
        friction_J: Work of contact forces plus heat of their friction in a trial step, J: truncation, as they should cancel.
    """

    energy_J: FloatArray
    impulse: FloatArray
    outside: FloatArray = _NOTHING
    friction_J: float = 0.0


class ExchangeIntegrator:
    """Integrates the wrenches of one contact model over steps."""

    def __init__(self, system: System, data: Any, wrenches: Callable[[Any], Sequence[Wrench]]) -> None:
        """Bind to the system's data and to the function that gives the wrenches at a state."""
        self._system, self._data, self._wrenches = system, data, wrenches
        self._scratch = mujoco.MjData(system.mj)

    def begin(self, grasped_bodies: frozenset[int]) -> None:
        """Begin a (sub-)step at the state in ``data``; ``grasped_bodies`` are the bodies of a grasped object."""
        self._grasped_bodies = grasped_bodies
        self._qpos, self._qvel = self._data.qpos.copy(), self._data.qvel.copy()
        self._first = self._rates(self._data)

    def end(self, duration_s: float) -> Exchange:
        """End the (sub-)step at the state in ``data``."""
        model, data, scratch = self._system.mj, self._data, self._scratch
        middle = hermite_midpoint(model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        scratch.qpos[:], scratch.qvel[:] = middle
        scratch.time = data.time - 0.5 * duration_s
        mujoco.mj_fwdPosition(model, scratch)
        mujoco.mj_fwdVelocity(model, scratch)
        done = simpson(self._first, self._rates(scratch), self._rates(data), duration_s)
        return Exchange(done[:3], done[3:9], done[9:].reshape(2, 6))

    def _rates(self, data: Any) -> FloatArray:
        return rates_by_subsystem(self._system, data, self._wrenches(data), self._grasped_bodies)


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
    for i, (body, point, force, torque, _) in enumerate(wrenches):
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
