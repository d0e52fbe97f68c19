"""True values of sensors at a state, contact forces included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.wrench import Wrench
from ffsm_mj.sensing.sensor import Sensor

_DISABLED = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)


class SensorReader:
    """Evaluates all sensors of the model of a motion.

    Forces and torques at a site are those that the body of the site passes on to its parent, from the accelerations of all
    bodies beyond and the contact forces on them. A touch sensor adds the normal forces whose points are inside its site.
    """

    def __init__(self, sensors: Sequence[Sensor], motion: Motion, bodies_of: dict[str, tuple[int, int]]) -> None:
        """Bind to a motion.

        Args:
            sensors: The sensors, in the order of the values.
            motion: The motion; while an object is grasped, its model has the same sensors in another order.
            bodies_of: Bodies of the two geoms of each pair by its name, ids in the logged system.
        """
        self._model, self._data, self._motion, self._bodies_of = motion.model, motion.data, motion, bodies_of
        ids = [mujoco.mj_name2id(motion.model, mujoco.mjtObj.mjOBJ_SENSOR, sensor.name) for sensor in sensors]
        ends = list(np.cumsum([sensor.size for sensor in sensors]))
        self.parts = [slice(end - sensor.size, end) for end, sensor in zip(ends, sensors, strict=True)]
        self._values = np.full(int(ends[-1]) if ends else 0, np.nan)
        # A sensor of a joint that a closed grasp has removed has no id: there is nothing to measure.
        found = [(part, int(motion.model.sensor_adr[i])) for part, i in zip(self.parts, ids, strict=True) if i >= 0]
        self._there = np.array([k for part, _ in found for k in range(part.start, part.stop)], dtype=np.intp)
        self._order = np.array([start + k for part, start in found for k in range(part.stop - part.start)], dtype=np.intp)
        touching = [k for k, sensor in enumerate(sensors) if sensor.model.kind == "touch"]
        self._touch = [(self.parts[k], int(motion.model.sensor_objid[ids[k]])) for k in touching]
        self._needs_forces = any(sensor.model.kind in ("force", "torque") for sensor in sensors)

    def read(self, wrenches: Sequence[Wrench], contacts: Sequence[ActiveContact]) -> FloatArray:
        """Values of all sensors at the state in the motion's data, one after another, (sum of sizes,).

        Args:
            wrenches: Forces of contact models on bodies, ids in the logged system.
            contacts: Closed contacts.
        """
        with self._enabled(), self._pushed(wrenches):
            if self._needs_forces:
                mujoco.mj_rnePostConstraint(self._model, self._data)
            mujoco.mj_sensorPos(self._model, self._data)
            mujoco.mj_sensorVel(self._model, self._data)
            mujoco.mj_sensorAcc(self._model, self._data)
        values: FloatArray = self._values.copy()
        values[self._there] = self._data.sensordata[self._order]
        for part, site in self._touch:
            values[part] = sum(self._normal_force(contact, site) for contact in contacts)
        return values

    @contextmanager
    def _enabled(self) -> Iterator[None]:
        """Sensors are off while steps are integrated."""
        self._model.opt.disableflags &= ~_DISABLED
        try:
            yield
        finally:
            self._model.opt.disableflags |= _DISABLED

    @contextmanager
    def _pushed(self, wrenches: Sequence[Wrench]) -> Iterator[None]:
        """Wrenches as external forces, where interface forces are computed from."""
        external = self._data.xfrc_applied
        if not (wrenches and self._needs_forces):
            yield
            return
        before = external.copy()
        apply_wrenches(self._motion, self._data, wrenches)
        try:
            yield
        finally:
            external[:] = before

    def _normal_force(self, contact: ActiveContact, site: int) -> float:
        """Normal force of a contact if it acts inside a site on the body of the site, N."""
        body = int(self._model.site_bodyid[site])
        bodies = self._bodies_of.get(contact.pair, ())
        if body not in [self._motion.bodies[each] for each in bodies] or not self._is_inside(contact.point_m, site):
            return 0.0
        return max(0.0, float(contact.force_N.dot(contact.normal)))

    def _is_inside(self, point: FloatArray, site: int) -> bool:
        """Whether a point is inside a site, as MuJoCo's own touch sensor has it."""
        frame = self._data.site_xmat[site].reshape(3, 3)
        x, y, z = map(float, frame.T @ (point - self._data.site_xpos[site]))
        a, b, c = map(float, self._model.site_size[site])
        kind = int(self._model.site_type[site])
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            return x * x + y * y + z * z <= a * a
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            above = max(0.0, abs(z) - b)
            return x * x + y * y + above * above <= a * a
        if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            return x * x + y * y <= a * a and abs(z) <= b
        if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return (x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 <= 1.0
        return abs(x) <= a and abs(y) <= b and abs(z) <= c


def apply_wrenches(motion: Motion, data: Any, wrenches: Sequence[Wrench]) -> None:
    """Add wrenches on bodies of the logged system to the external forces in data of a motion's model."""
    for body, point, force, torque in wrenches:
        here = motion.bodies[body]
        data.xfrc_applied[here, :3] += force
        data.xfrc_applied[here, 3:] += torque + cross(point - data.xipos[here], force)
