"""Whether a path keeps the limits of its joints: positions, speeds, and the efforts that it needs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import ControllerContext, DrivenJoints, FloatArray, MinimumJerk
from ffsm_mj.task_model import JointModel

_SAMPLES, _SAMPLES_BETWEEN = 200, 40
"""Least number of instants at which efforts are predicted: on the path, and between two waypoints."""
_ROUNDING = 1e-9
"""Relative excess that is rounding: a path may touch its limits."""


class Bounds(NamedTuple):
    """Limits of the joints, (n,) each: least and greatest position in rad or m, greatest speed, greatest effort."""

    low: FloatArray
    high: FloatArray
    speed: FloatArray
    effort: FloatArray


class PathLimits:
    """Checks paths against limits."""

    def __init__(self, context: ControllerContext, joints: DrivenJoints, model: JointModel | None, bounds: Bounds) -> None:
        """Bind to the joints.

        Args:
            context: What the law is made for.
            joints: The joints.
            model: Their reduced dynamics; None: servos drive them, whose efforts are not predicted.
            bounds: Limits of the joints; efforts are limited by their actuators as well.
        """
        self._mj, self._limits, self._model, self._bounds = context.system.mj, context.limits, model, bounds
        self._joints, self._actuators = joints, joints.actuators
        self._gear = self._mj.actuator_gear[self._actuators, 0]
        self._data = mujoco.MjData(self._mj)

    def faults(self, path: MinimumJerk, data: Any) -> list[str]:
        """Sentences for the limits that a path exceeds, with the worst value of each joint; empty if it keeps them.

        Args:
            path: The path, from the state in ``data``.
            data: State of the system where it begins.
        """
        bounds, worst = self._bounds, _Worst(self._joints.names, self._units())
        for time_s, positions in path.extremes(0):
            worst.look("position", time_s, positions, bounds.low, bounds.high)
        for time_s, rates in path.extremes(1):
            worst.look("speed", time_s, rates, -bounds.speed, bounds.speed)
        for time_s, effort, low, high in self._efforts(self._model, path, data) if self._model is not None else ():
            worst.look("effort", time_s, effort, low, high)
        return worst.sentences()

    def _efforts(
        self, model: JointModel, path: MinimumJerk, data: Any
    ) -> Iterator[tuple[float, FloatArray, FloatArray, FloatArray]]:
        """Time, efforts that the path needs, and their bounds, along the predicted motion with all other motors off."""
        mj, scratch, joints = self._mj, self._data, self._joints
        scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
        samples = max(_SAMPLES_BETWEEN, _SAMPLES // (len(path.times) - 1))
        times = np.interp(np.arange(samples * (len(path.times) - 1) + 1) / samples, np.arange(len(path.times)), path.times)
        for time_s, step_s in zip(times.tolist(), np.diff(times, append=times[-1]).tolist(), strict=True):
            positions, rates, accelerations = path.at(time_s)
            scratch.qpos[joints.qpos], scratch.qvel[joints.dofs], scratch.time = positions, rates, data.time + time_s
            model.close(scratch)
            mujoco.mj_fwdVelocity(mj, scratch)
            model.update(scratch)
            effort = model.M_c.dot(accelerations) + model.c_c
            yield time_s, effort, *self._effort_bounds(rates)
            # Base and all else that floats: the joints follow the path, so a step of the first order shows what they need.
            scratch.qvel += step_s * (model.coasting + effort.dot(model.mobility))
            mujoco.mj_integratePos(mj, scratch.qpos, scratch.qvel, step_s)

    def _effort_bounds(self, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        most = self._bounds.effort
        if self._limits is None:
            return -most, most
        velocity = np.zeros(self._mj.nu)
        velocity[self._actuators] = self._gear * rates
        low, high = self._limits.bounds(velocity)
        return np.maximum(low[self._actuators], -most), np.minimum(high[self._actuators], most)

    def _units(self) -> Mapping[str, list[str]]:
        """Units of each joint by what is limited."""
        slides = self._mj.jnt_type[self._mj.dof_jntid[self._joints.dofs]] == int(mujoco.mjtJoint.mjJNT_SLIDE)
        units = {"position": ("rad", "m"), "speed": ("rad/s", "m/s"), "effort": ("N m", "N")}
        return {what: [pair[int(slide)] for slide in slides] for what, pair in units.items()}


class _Worst:
    """The greatest excess of each joint over each kind of limit."""

    def __init__(self, names: Sequence[str], units: Mapping[str, list[str]]) -> None:
        self._names, self._units = names, units
        self._excesses: dict[tuple[str, int], tuple[float, str]] = {}

    def look(self, what: str, time_s: float, values: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Compare the values of all joints at a time with their bounds."""
        for i, (value, least, most) in enumerate(zip(values.tolist(), low.tolist(), high.tolist(), strict=True)):
            bound = most if value > most else least
            excess = max(value - most, least - value)
            if excess > _ROUNDING * max(abs(bound), 1.0) and excess > self._excesses.get((what, i), (-math.inf, ""))[0]:
                unit = self._units[what][i]
                allowed = f"[{least:.6g}, {most:.6g}]" if what != "speed" else f"at most {most:.6g}"
                text = f"{self._names[i]}: {what} {value:.6g} {unit} at {time_s:.4g} s, allowed {allowed}"
                self._excesses[what, i] = excess, text

    def sentences(self) -> list[str]:
        """What was exceeded, in the order of looking."""
        return [text for _, text in self._excesses.values()]
