"""True values of sensors: at a state, contact forces included, and the impulses that an event passes on through them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.fields.surroundings import Surroundings
from ffsm_mj.records.contact_forces import ActiveContact, Wrench
from ffsm_mj.sensing.parts import WrenchPart
from ffsm_mj.sensing.sensor import Sensor

_DISABLED = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_STAGES = {
    int(mujoco.mjtStage.mjSTAGE_POS): mujoco.mj_sensorPos,
    int(mujoco.mjtStage.mjSTAGE_VEL): mujoco.mj_sensorVel,
    int(mujoco.mjtStage.mjSTAGE_ACC): mujoco.mj_sensorAcc,
}


_OF_SURROUNDINGS = ("accelerometer", "magnetometer", "startracker", "horizon")
"""Kinds on sites whose values MuJoCo does not know, or not without the surroundings."""


class _Evaluation(NamedTuple):
    """What the values of some groups of sensors take.

    Attributes:
        stages: Functions of MuJoCo that evaluate them, in order.
        forces: Whether forces of contact models are needed there.
        touch: Values of touch sensors and their sites.
        surrounded: Sensors of the surroundings, their values and their sites.
        parts: Parts of forces and torques, and their values.
    """

    stages: tuple[Callable[[Any, Any], None], ...]
    forces: bool
    touch: tuple[tuple[slice, int], ...]
    surrounded: tuple[tuple[Sensor, slice, int], ...]
    parts: tuple[tuple[WrenchPart, slice], ...]


class SensorReader:
    """Evaluates sensors of the model of a motion, of some groups at a time.

    Forces and torques at a site are those that the body of the site passes on to its parent, from the accelerations of all
    bodies beyond and the contact forces and external fields on them. A touch sensor adds the normal forces whose points are
    inside its site. An accelerometer measures specific force: its acceleration less that of a free mass at its site.
    Magnetometers, horizon sensors and star trackers measure the surroundings in the axes of their sites.

    Attributes:
        parts: Values of each group among those of all.
    """

    def __init__(
        self,
        groups: Sequence[Sequence[Sensor]],
        motion: Motion,
        bodies_of: dict[str, tuple[int, int]],
        surroundings: Surroundings,
    ) -> None:
        """Bind to a motion.

        Args:
            groups: Groups of sensors, in the order of the values.
            motion: The motion; while an object is grasped, its model has the same sensors in another order.
            bodies_of: Bodies of the two geoms of each pair by its name, ids in the logged system.
            surroundings: What surrounds the scene.
        """
        self._model, self._data, self._motion, self._bodies_of = motion.model, motion.data, motion, bodies_of
        self._values, self._surroundings = motion.data.sensordata, surroundings
        self._groups = tuple(tuple(group) for group in groups)
        self.parts: list[slice] = []
        self._parts: dict[str, slice] = {}
        there: list[int] = []
        order: list[int] = []
        end = 0
        for group in self._groups:
            start = end
            for sensor in group:
                self._parts[sensor.name] = slice(end, end + sensor.size)
                # A sensor of a joint that a closed grasp has removed has no id: there is nothing to measure.
                if (number := self._id(sensor)) >= 0:
                    there += range(end, end + sensor.size)
                    address = int(motion.model.sensor_adr[number])
                    order += range(address, address + sensor.size)
                end += sensor.size
            self.parts.append(slice(start, end))
        self._missing = np.full(end, np.nan) if len(there) < end else None
        self._there, self._order = np.array(there, dtype=np.intp), np.array(order, dtype=np.intp)
        self._evaluations: dict[tuple[int, ...], _Evaluation] = {}

    def _id(self, sensor: Sensor) -> int:
        return int(mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_SENSOR, sensor.name))

    def read(
        self,
        due: tuple[int, ...],
        wrenches: Callable[[], Sequence[Wrench]],
        contacts: Callable[[], Sequence[ActiveContact]],
    ) -> FloatArray:
        """Values at the state in the motion's data, (sum of sizes,); those of groups that are not due may be old.

        Args:
            due: Groups to evaluate.
            wrenches: Forces of contact models on bodies, ids in the logged system.
            contacts: Closed contacts.
        """
        evaluation = self._evaluations.get(due)
        if evaluation is None:
            evaluation = self._evaluations[due] = self._evaluation(due)
        # Sensors are off while steps are integrated.
        options = self._model.opt
        options.disableflags &= ~_DISABLED
        try:
            forces = wrenches() if evaluation.forces else ()
            self._evaluate(evaluation, forces)
        finally:
            options.disableflags |= _DISABLED
        values: FloatArray = self._values[self._order]
        if self._missing is not None:
            whole = self._missing.copy()
            whole[self._there] = values
            values = whole
        for sensor, part, site in evaluation.surrounded:
            values[part] = self._of_surroundings(sensor, values[part], site)
        for of_whole, part in evaluation.parts:
            values[part] = of_whole.of(values[part], self._data, forces)
        if evaluation.touch:
            closed = contacts()
            for part, site in evaluation.touch:
                values[part] = sum(self._normal_force(contact, site) for contact in closed)
        return values

    def _evaluation(self, due: tuple[int, ...]) -> _Evaluation:
        """What the values of some groups take."""
        readings = [(sensor, self._id(sensor)) for g in due for sensor in self._groups[g]]
        there = [(sensor, number) for sensor, number in readings if number >= 0]
        needed = {int(self._model.sensor_needstage[number]) for _, number in there}
        at_sites = [(sensor, self._parts[sensor.name], int(self._model.sensor_objid[number])) for sensor, number in there]
        surrounding = {*_OF_SURROUNDINGS} - ({"magnetometer"} if self._surroundings.magnetic is None else set())
        return _Evaluation(
            tuple(evaluate for stage, evaluate in _STAGES.items() if stage in needed),
            any(sensor.sums for sensor, _ in there),
            tuple((part, site) for sensor, part, site in at_sites if sensor.model.kind == "touch"),
            tuple(one for one in at_sites if one[0].model.kind in surrounding),
            tuple((WrenchPart(self._motion, sensor), part) for sensor, part, _ in at_sites if sensor.part is not None),
        )

    def _evaluate(self, evaluation: _Evaluation, wrenches: Sequence[Wrench]) -> None:
        """Evaluate sensors with wrenches as external forces, where forces between bodies are computed from."""
        model, data = self._model, self._data
        external = data.xfrc_applied.copy() if wrenches else None
        try:
            if external is not None:
                apply_wrenches(self._motion, data, wrenches)
            data.flg_rnepost = (
                False  # MuJoCo then evaluates accelerations and forces between bodies where a sensor needs them
            )
            for evaluate in evaluation.stages:
                evaluate(model, data)
        finally:
            if external is not None:
                data.xfrc_applied[:] = external

    def _of_surroundings(self, sensor: Sensor, value: FloatArray, site: int) -> FloatArray:
        """Value of a sensor of the surroundings at a site, from MuJoCo's."""
        around, data, kind = self._surroundings, self._data, sensor.model.kind
        if kind == "startracker":
            attitude = np.empty(4)
            mujoco.mju_mulQuat(attitude, sensor.reference, value)
            return attitude
        where, axes = (data.time, data.site_xpos[site]), data.site_xmat[site].reshape(3, 3)
        if kind == "accelerometer":
            # MuJoCo's value has the uniform gravity of the model taken off, but no field: these are applied forces there.
            return np.asarray(value - around.free_fall(*where) @ axes)
        vector = around.nadir(*where) if kind == "horizon" or around.magnetic is None else around.magnetic.at(*where)
        return np.asarray(vector @ axes)

    def _normal_force(self, contact: ActiveContact, site: int) -> float:
        """Normal force of a contact if it acts inside a site on the body of the site, N."""
        body = int(self._model.site_bodyid[site])
        bodies = self._bodies_of.get(contact.pair, ())
        if body not in [self._motion.bodies[k] for k in bodies] or not self._is_inside(contact.point_m, site):
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
    for body, point, force, torque, _ in wrenches:
        motion_body = motion.bodies[body]
        data.xfrc_applied[motion_body, :3] += force
        data.xfrc_applied[motion_body, 3:] += torque + cross(point - data.xipos[motion_body], force)


class ImpulseReader:
    """Impulses through force and torque sensors of a motion's model in an event.

    Newton-Euler recursion is linear in accelerations and external forces where nothing moves and nothing weighs: with the
    jump of the velocities in place of accelerations, and impulses in place of forces, it gives the impulses between bodies.

    Attributes:
        motion: The motion.
    """

    def __init__(self, motion: Motion, sensors: Iterable[Sensor]) -> None:
        """Bind to a motion and its force and torque sensors."""
        self.motion, self._still = motion, mujoco.MjData(motion.model)
        self._parts = {sensor.name: WrenchPart(motion, sensor) for sensor in sensors if sensor.part is not None}

    def read(self, jump: FloatArray, wrenches: Sequence[Wrench]) -> Callable[[str], FloatArray]:
        """Impulse through each sensor by its name, N s or N m s, (3,).

        Args:
            jump: Change of the velocities of the logged system, (nv,).
            wrenches: Impulses on its bodies, N s.
        """
        motion, still = self.motion, self._still
        model = motion.model
        mujoco.mj_resetData(model, still)
        still.qpos[:] = motion.data.qpos
        gravity, flags = model.opt.gravity.copy(), model.opt.disableflags
        model.opt.gravity[:] = 0.0
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        try:
            mujoco.mj_fwdPosition(model, still)
            mujoco.mj_fwdVelocity(model, still)
            still.qacc[:] = motion.model_rates(jump)
            apply_wrenches(motion, still, wrenches)
            mujoco.mj_rnePostConstraint(model, still)
            mujoco.mj_sensorAcc(model, still)
        finally:
            model.opt.gravity[:], model.opt.disableflags = gravity, flags

        def through(name: str) -> FloatArray:
            whole = np.array(still.sensor(name).data)
            part = self._parts.get(name)
            return whole if part is None else part.of(whole, still, wrenches)

        return through
