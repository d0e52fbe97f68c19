"""What a force or torque sensor reads, in parts: contact, grasp and tool.

The sensor reads the wrench of the rest of the robot on the tool, which is all beyond its site but for what that holds. By
Newton and Euler it is the rate of change of the tool's momentum less all else that acts on the tool. The parts are

- ``contact``: the wrench with which the tool presses on what it touches, the negative of that of all contacts on it;
- ``grasp``: the load of all that it holds; what contacts exert on the held object comes through the latch, and is in it;
- ``tool``: the remainder: the inertia of the tool, less what external fields exert on it.

The recursion is linear: impulses and jumps of velocities have the same parts as forces and accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.records.contact_forces import Wrench
from ffsm_mj.sensing.sensor import Sensor


class WrenchPart:
    """Part of what a force or torque sensor reads in a motion."""

    def __init__(self, motion: Motion, sensor: Sensor) -> None:
        """Bind to a motion and to a sensor that has a ``part``."""
        model, self._motion = motion.model, motion
        self._part, self._turns = sensor.part or "", sensor.model.kind == "torque"
        self._site = int(model.sensor(sensor.name).objid[0])
        carrier, tree = int(model.site_bodyid[self._site]), motion.grasped_object
        grasped = {motion.bodies[body] for body in motion.grasped_bodies}
        if carrier in grasped:
            grasped.clear()  # on the object itself nothing is held: it is the tool
        beyond = {carrier}
        for body in range(1, model.nbody):  # parents come before their children
            if int(model.body_parentid[body]) in beyond:
                beyond.add(body)
        self._tool = frozenset(beyond - grasped)
        # What the robot holds on another of its links does not come through this sensor.
        self._object = motion.bodies[tree.root] if tree is not None and beyond & grasped else None

    def of(self, whole: FloatArray, data: Any, wrenches: Sequence[Wrench]) -> FloatArray:
        """The part in axes of the site, (3,), N or N m; N s or N m s of an event.

        Args:
            whole: What the sensor reads, (3,).
            data: Data of the motion's model, or of one at the same place, with forces between bodies up to date.
            wrenches: Wrenches on bodies of the logged system.
        """
        if self._part == "tool":
            return whole - self._by("contact", data, wrenches) - self._by("grasp", data, wrenches)
        return self._by(self._part, data, wrenches)

    def _by(self, part: str, data: Any, wrenches: Sequence[Wrench]) -> FloatArray:
        """Wrench of the tool on what it touches or holds, in axes of the site, (3,)."""
        place, total = data.site_xpos[self._site], np.zeros(3)
        for body, point, force, torque, by in wrenches:
            if by == part and self._motion.bodies[body] in self._tool:
                total -= torque + cross(point - place, force) if self._turns else force
        if part == "grasp" and self._object is not None:
            # MuJoCo's force between bodies acts on the child, about the mass centre of the whole tree.
            torque, force = np.split(data.cfrc_int[self._object], 2)
            centre = data.subtree_com[self._motion.model.body_rootid[self._object]]
            total += torque + cross(centre - place, force) if self._turns else force
        return np.asarray(total @ data.site_xmat[self._site].reshape(3, 3))
