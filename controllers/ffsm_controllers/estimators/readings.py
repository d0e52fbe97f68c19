"""What sensors say of coordinates and rates of a model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators.frames import Frame, axes_of, frame_of, root_frame
from ffsm_mj.controller_protocol import Fault, FloatArray, Measurement, ScenarioFaults, Sensor, Stateful, System

ORDER = ("attitude", "position", "twist")
"""Order in which samples of one time are written: positions of a point refer to the attitude, rates to both."""

_OF_JOINTS = ("jointpos", "jointvel", "ballquat", "ballangvel")

Write = Callable[[FloatArray, Any], None]
"""Writes a measured value into the coordinates or rates of MuJoCo data, whose kinematics are current."""


class Reading(Stateful):
    """A sensor that measures coordinates or rates of one joint.

    Attributes:
        sensor: Its full name.
        order: One of ``ORDER``.
        qpos: Coordinates that it determines.
        dofs: Rates that it determines.
        time_s: Time of the last sample that was used, s; NaN: none.
    """

    @dataclass
    class State:
        """Time of the last sample that was used, s, and rates from differences."""

        time_s: float
        rate: RateFilter.State | None

    def __init__(self, sensor: str, order: str, qpos: slice, dofs: slice, write: Write) -> None:
        """Nothing has been measured."""
        self.sensor, self.order, self.qpos, self.dofs, self._write = sensor, order, qpos, dofs, write
        self._rate: RateFilter | None = None
        self.forget()

    @property
    def measures_coordinates(self) -> bool:
        """Whether it determines coordinates, not rates."""
        return bool(self.qpos.stop > self.qpos.start)

    def forget(self) -> None:
        """Nothing has been measured."""
        self.time_s = math.nan
        if self._rate is not None:
            self._rate.forget()

    def differentiate(self, filter_s: float, rate_of: Callable[[FloatArray, FloatArray], FloatArray]) -> None:
        """Take the rates from differences of samples; ``rate_of`` gives the change from one coordinate value to another."""
        self._rate = RateFilter(filter_s, rate_of)

    def rate_gain(self, interval_s: float) -> float:
        """Variance of a rate over that of a sample, 1/s^2; 1 if rates are what it measures, 0 if it says nothing of them.

        Args:
            interval_s: Interval of its samples.
        """
        if self._rate is not None:
            return self._rate.gain(interval_s)
        return 0.0 if self.measures_coordinates else 1.0

    def is_new(self, sample: Measurement) -> bool:
        """Whether a sample is valid and has not been used."""
        return sample.valid and sample.time_s != self.time_s

    def write(self, sample: Measurement, data: Any) -> None:
        """Write a sample into a state at its time."""
        self._write(sample.value, data)
        if self._rate is not None:
            rate = self._rate.rate(sample.time_s, data.qpos[self.qpos].copy())
            if rate is not None:
                data.qvel[self.dofs] = rate
        self.time_s = sample.time_s


class RateFilter(Stateful):
    """Rate from differences of samples, with a first-order low-pass."""

    @dataclass
    class State:
        """Time, s, and value of the last sample, and the filtered rate."""

        last: tuple[float, FloatArray] | None
        value: FloatArray | None

    def __init__(self, filter_s: float, change: Callable[[FloatArray, FloatArray], FloatArray]) -> None:
        """Nothing has been measured."""
        self._filter_s, self._change = filter_s, change
        self.forget()

    def forget(self) -> None:
        """Nothing has been measured."""
        self._last: tuple[float, FloatArray] | None = None
        self._value: FloatArray | None = None

    def rate(self, time_s: float, value: FloatArray) -> FloatArray | None:
        """Filtered rate with another sample; None at the first one."""
        last, self._last = self._last, (time_s, value)
        if last is None or time_s <= last[0]:
            return self._value
        passed = time_s - last[0]
        raw = self._change(last[1], value) / passed
        self._value = raw if self._value is None else self._value + self._weight(passed) * (raw - self._value)
        return self._value

    def gain(self, interval_s: float) -> float:
        """Variance of the rate over that of the samples, whose errors are independent, 1/s^2.

        With the weight w of the last difference, (n_k - n_k-1) / T, the rate answers to an error of one sample by w / T,
        then by -w^2 (1 - w)^j / T for j = 0, 1, ...: the squares add up to 2 w^2 / ((2 - w) T^2).
        """
        weight = self._weight(interval_s)
        return 2.0 * (weight / interval_s) ** 2 / (2.0 - weight)

    def _weight(self, passed_s: float) -> float:
        return 1.0 if self._filter_s == 0.0 else 1.0 - math.exp(-passed_s / self._filter_s)


def readings_of(system: System, sensors: Mapping[str, Sensor], rate_filter_s: float) -> list[Reading]:
    """Readings of all sensors that measure something of the state, in the order in which they are written.

    Raises:
        ScenarioFaults: There are none.
    """
    readings = _readings(system, sensors, rate_filter_s)
    if not readings:
        raise ScenarioFaults([Fault("no sensor measures a joint or a floating body: the models need <sensor> elements")])
    return readings


def readings_of_joints(system: System, sensors: Mapping[str, Sensor], rate_filter_s: float) -> list[Reading]:
    """Readings of all sensors that measure joints, in the order in which they are written."""
    kinds = {name: system.sensors[name].kind for name in sensors}
    return _readings(system, {name: sensors[name] for name, kind in kinds.items() if kind in _OF_JOINTS}, rate_filter_s)


def _readings(system: System, sensors: Mapping[str, Sensor], rate_filter_s: float) -> list[Reading]:
    readings = [reading for name in sensors if (reading := _reading(system, sensors[name])) is not None]
    rated = {(reading.order, dof) for reading in readings for dof in range(reading.dofs.start, reading.dofs.stop)}
    for reading in readings:
        if reading.order != "twist" and ("twist", reading.dofs.start) not in rated:
            turns = reading.qpos.stop - reading.qpos.start == 4
            reading.differentiate(rate_filter_s, _turn if turns else _difference)
    return sorted(readings, key=lambda reading: ORDER.index(reading.order))


def _difference(before: FloatArray, after: FloatArray) -> FloatArray:
    return after - before


def _turn(before: FloatArray, after: FloatArray) -> FloatArray:
    """Rotation vector from one quaternion to another, in body axes."""
    turn = np.empty(3)
    mujoco.mju_subQuat(turn, after, before)
    return turn


def _reading(system: System, sensor: Sensor) -> Reading | None:
    """Reading of a sensor; None if it measures nothing of the state directly."""
    model, name, kind = system.mj, sensor.name, sensor.model.kind
    number = int(model.sensor(name).id)
    target = int(model.sensor_objid[number])
    if kind in _OF_JOINTS:
        return _of_joint(model, name, kind, target)
    if not (kind.startswith("frame") or kind in ("gyro", "velocimeter", "startracker")):
        return None
    frame = frame_of(model, int(model.sensor_objtype[number]), target)
    free = root_frame(model, frame)
    if free is None:
        return None
    reference = frame_of(model, int(model.sensor_reftype[number]), int(model.sensor_refid[number]))
    if reference.body and model.body_rootid[reference.body] == model.body_rootid[frame.body]:
        return None  # of one part of a model relative to another
    return _of_floating_body(model, sensor, frame, reference, free)


def _of_joint(model: Any, name: str, kind: str, joint: int) -> Reading:
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    ball = kind.startswith("ball")
    qpos, dofs = slice(q, q + (4 if ball else 1)), slice(v, v + (3 if ball else 1))

    def write_coordinates(value: FloatArray, data: Any) -> None:
        data.qpos[qpos] = value

    def write_rates(value: FloatArray, data: Any) -> None:
        data.qvel[dofs] = value

    if kind in ("jointpos", "ballquat"):
        return Reading(name, "attitude" if ball else "position", qpos, dofs, write_coordinates)
    return Reading(name, "twist", slice(q, q), dofs, write_rates)


def _of_floating_body(model: Any, sensor: Sensor, frame: Frame, reference: Frame, joint: int) -> Reading | None:
    """Reading of a frame that is fixed to a body with a free joint."""
    name, kind, stars = sensor.name, sensor.model.kind, axes_of(sensor.reference)
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    place, attitude = slice(q, q + 3), slice(q + 3, q + 7)
    linear, angular = slice(v, v + 3), slice(v + 3, v + 6)
    nothing = slice(q, q)

    def write_position(value: FloatArray, data: Any) -> None:
        origin, axes = reference.pose(data)
        data.qpos[place] = origin + axes @ value - axes_of(data.qpos[attitude]) @ frame.offset

    def write_attitude(value: FloatArray, data: Any) -> None:
        _, axes = reference.pose(data)
        data.qpos[attitude] = _quaternion(axes @ axes_of(value) @ frame.axes.T)

    def write_attitude_to_stars(value: FloatArray, data: Any) -> None:
        data.qpos[attitude] = _quaternion(stars.T @ axes_of(value) @ frame.axes.T)

    def write_velocity(value: FloatArray, data: Any) -> None:
        body = axes_of(data.qpos[attitude])
        lever = body @ frame.offset
        if kind == "velocimeter":
            point = body @ frame.axes @ value
        else:
            origin, axes = reference.pose(data)
            moved, turning = reference.twist(model, data)
            point = moved + np.cross(turning, data.qpos[place] + lever - origin) + axes @ value
        data.qvel[linear] = point - np.cross(body @ data.qvel[angular], lever)

    def write_angular(value: FloatArray, data: Any) -> None:
        if kind == "gyro":
            data.qvel[angular] = frame.axes @ value
            return
        _, axes = reference.pose(data)
        _, turning = reference.twist(model, data)
        data.qvel[angular] = axes_of(data.qpos[attitude]).T @ (turning + axes @ value)

    return {
        "framepos": Reading(name, "position", place, linear, write_position),
        "framequat": Reading(name, "attitude", attitude, angular, write_attitude),
        "startracker": Reading(name, "attitude", attitude, angular, write_attitude_to_stars),
        "framelinvel": Reading(name, "twist", nothing, linear, write_velocity),
        "velocimeter": Reading(name, "twist", nothing, linear, write_velocity),
        "frameangvel": Reading(name, "twist", nothing, angular, write_angular),
        "gyro": Reading(name, "twist", nothing, angular, write_angular),
    }.get(kind)


def _quaternion(axes: FloatArray) -> FloatArray:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).ravel())
    return quaternion
