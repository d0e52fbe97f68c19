"""The filter."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators.mekf.closing import GraspClosing
from ffsm_controllers.estimators.mekf.config import InitialConfig, MekfConfig
from ffsm_controllers.estimators.mekf.estimate import Estimate, GraspedPose
from ffsm_controllers.estimators.mekf.frame_measurement import KINDS, FrameMeasurement, measurement_of, missing_measurements
from ffsm_controllers.estimators.mekf.grasped import GraspedScene
from ffsm_controllers.estimators.mekf.history import Entry, History
from ffsm_controllers.estimators.mekf.impacts import inflate, involved, is_jump
from ffsm_controllers.estimators.mekf.joints import encoder_errors, joint_values, white_noise, write_joint
from ffsm_controllers.estimators.mekf.layout import FloatingBody, Layout, floating_bodies
from ffsm_controllers.estimators.mekf.propagation import Propagation
from ffsm_controllers.estimators.mekf.report import report_signals, report_values
from ffsm_controllers.estimators.mekf.update import Innovation, update
from ffsm_controllers.estimators.readings import Reading, readings_of_joints
from ffsm_mj.controller_protocol import (
    ControllerContext,
    ControllerError,
    Fault,
    Faults,
    FieldForces,
    FloatArray,
    Measurement,
    Sensor,
    Signal,
    Stateful,
    System,
    kind_named,
    unknown_name,
)

_JOINTS, _FIRST_FRAME, _SET, _JUMP = 0, 1, 8, 9
"""Ranks of entries of one time: a sample at an impact is of the state before it."""
_SET_BEYOND = 1e-12
"""An estimate that differs by more than this from what the filter left has been set by others."""


class Mekf(Stateful):
    """Multiplicative error-state Kalman filter of pose and twist of every floating body, with biases of gyros.

    - Attitudes are quaternions; their errors are rotation vectors in body axes, whose mean is zero after every update
      (Markley and Crassidis 2014, 6.2; Sola 2017, 5 and 6).
    - Floating bodies move as the model predicts it under the efforts held; see :class:`~.propagation.Propagation`.
    - ``framepos``, ``framequat``, ``startracker``, ``framelinvel``, ``frameangvel``, ``gyro`` and ``velocimeter`` update
      them, of frames on any body of their trees, relative to the world or to frames of other trees: relative ones correct
      both.
    - Joints are as measured last, with a stated filter on rates from differences; the errors of their coordinates are noise
      of the places and attitudes that are measured across them, see :class:`~.joints.EncoderErrors`.
    - Samples are used at their own time, late ones too; see :class:`~.history.History`. Of several samples of a sensor that
      arrive between two calls, only the newest is shown and used.
    - An object in a rigid grasp moves with the hand, and the robot with its load; see :class:`~.closing.GraspClosing` and
      :class:`~.grasped.GraspedScene`.
    - A body whose estimate others set, as that of an object in another latch, begins anew there: with the initial
      deviations, independent of all else.
    """

    @dataclass
    class State:
        """Past estimates, times of the last samples that were used, innovations of the last call, and readings of joints."""

        history: History.State
        used_s: dict[str, float]
        innovations: list[Innovation]
        joints: list[Reading.State]

    Config = MekfConfig
    telemetry_signals: tuple[Signal, ...]

    def __init__(self, config: MekfConfig, context: ControllerContext) -> None:
        """Find what each sensor measures.

        Raises:
            ScenarioFaults: No body floats, something of one is not measured, or a name is unknown.
        """
        system, model = context.system, context.system.mj
        bodies = floating_bodies(system)
        measurements = [measurement_of(model, bodies, sensor) for sensor in context.sensors.values()]
        self._frames = [measurement for measurement in measurements if measurement is not None]
        joints = readings_of_joints(system, context.sensors, config.rate_filter_s)
        used = [frame.sensor for frame in self._frames] + [joint.sensor for joint in joints if joint.measures_coordinates]
        with Faults() as faults:
            believed = _believed_noise(system, used, config, faults)
            faults.collected += _faults(bodies, self._frames, config)
        self._system, self._config, sensors = system, config, context.sensors
        biased = [frame.sensor for frame in self._frames if frame.kind == "gyro" and config.gyro_bias_rad_s is not None]
        self._layout = Layout(bodies, biased)
        self._deviations = {
            frame.sensor: _deviations(sensors[frame.sensor], believed.get(frame.sensor), config) for frame in self._frames
        }
        self._joints = joints
        self._encoders = encoder_errors(joints, sensors, believed)
        self._largest_nis = math.inf if config.gate is None else _chi_square_quantile(config.gate)
        self._estimate = Estimate(self._layout, mujoco.MjData(model), np.zeros((self._layout.size, self._layout.size)))
        shown = [sensors[name] for name in (*self._deviations, *(reading.sensor for reading in self._joints))]
        longest_s = max(configured.delay_s + configured.delay_jitter_s for configured in shown) + context.control_period_s
        self._grasped, self._closings = self._of_grasps(context.grasped, context.grasped_fields)
        propagation = Propagation(model, self._layout, config, sensors, self._grasped, context.external_field)
        self._history = History(self._estimate, propagation, longest_s, self._apply)
        self._scratch = mujoco.MjData(model)
        self._used_s: dict[str, float] = {}
        self._innovations: list[Innovation] = []
        self.telemetry_signals = report_signals(self._layout)

    def start(self, data: Any) -> None:
        """Begin at the initial state, with the initial covariance."""
        estimate, config = self._estimate, self._config
        deviations = np.full(self._layout.size, config.gyro_bias_rad_s or 0.0)
        for body in self._layout.bodies:
            deviations[body.error] = np.repeat(_initial(config, body), 3)
        estimate.covariance, estimate.biases = np.diag(deviations**2), np.zeros_like(estimate.biases)
        estimate.grasped = None
        estimate.data.qpos[:], estimate.data.qvel[:], estimate.data.ctrl[:] = data.qpos, data.qvel, data.ctrl
        self._used_s.clear()
        for reading in self._joints:
            reading.forget()
        self._history.begin(float(data.time))

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        super().set_state(state)
        self._innovations = [Innovation(*innovation) for innovation in self._innovations]

    def update(self, time_s: float, measured: Mapping[str, Measurement], events: Sequence[Any], data: Any) -> None:
        """See :class:`~ffsm_mj.controller_protocol.Estimator`."""
        new = [*self._set_entries(data), *self._of_joints(measured), *self._of_frames(measured)]
        new += [entry for event in events if (entry := self._of_event(event)) is not None]
        self._innovations = self._history.advance(time_s, data.ctrl, new)
        data.qpos[:], data.qvel[:] = self._estimate.data.qpos, self._estimate.data.qvel

    def telemetry(self) -> FloatArray:
        """Values of ``telemetry_signals`` after the last call."""
        return report_values(self._estimate, self._innovations)

    def covariance(self, body: str) -> FloatArray:
        """Covariance of the error of a body, (12, 12): position, rotation vector, velocity, angular velocity.

        Args:
            body: ``robot``, or the name of an object; see :class:`~.layout.FloatingBody` for frames and units.
        """
        part = self._layout.named(body).error
        return self._estimate.covariance[part, part].copy()

    def _of_grasps(
        self, systems: Mapping[str, System], fields: Mapping[str, FieldForces]
    ) -> tuple[dict[str, GraspedScene], dict[str, GraspClosing]]:
        """Systems with a grasped object, and what the closing of their grasps does to an estimate, by name."""
        scenes, closings = {}, {}
        free, layout, encoders = self._system, self._layout, self._encoders
        for name, system in systems.items():
            grasp = system.grasp
            if grasp is None or grasp.joint.joints:
                continue  # the relative motion that such a latch leaves free is not part of the error state
            scene = scenes[name] = GraspedScene(free, system, layout, encoders, fields.get(name))
            closings[name] = GraspClosing(free, grasp, scene, layout, encoders, self._config.floor)
        return scenes, closings

    def _of_event(self, event: Any) -> Entry | None:
        """What an event does to an estimate; None: nothing.

        Raises:
            ControllerError: A grasp closes while another is closed.
        """
        kind = {kind_named(name).record: name for name in ("grasp", "release")}.get(type(event), "")
        if kind == "grasp" and event.place > 1:
            raise ControllerError(f"the grasp {event.grasp!r} closes while another is closed: kind mekf knows one at a time")
        if kind == "grasp" and event.grasp in self._closings:
            relative_pose = np.array(event.object_position_m), np.array(event.object_quaternion)
            return Entry(event.time_s, _JUMP, "grasp", (event.grasp,), relative_pose)
        if kind == "release":
            return Entry(event.time_s, _JUMP, "release", (event.grasp,))
        if is_jump(event):
            return Entry(event.time_s, _JUMP, "impact", involved(event, self._system, self._layout))
        return None

    def _apply(self, entry: Entry, estimate: Estimate) -> Innovation | None:
        """Do to an estimate what an entry says; returns the innovation of a measurement of a floating body."""
        names, values = entry.names, entry.values
        match entry.kind:
            case "frame":
                return self._measure(names[0], values[0], estimate)
            case "joint":
                write_joint(estimate, next(joint for joint in self._joints if joint.sensor == names[0]), *values)
            case "given":
                self._begin_anew(estimate, self._layout.named(names[0]), *values)
            case "grasp":
                self._closings[names[0]].apply(estimate, GraspedPose(names[0], *values))
            case "release":
                _release(estimate, names[0])
            case "impact":
                inflate(estimate, names, self._config, self._grasped)
        return None

    def _of_joints(self, measured: Mapping[str, Measurement]) -> list[Entry]:
        samples = [(reading, measured[reading.sensor]) for reading in self._joints]
        return [
            Entry(sample.time_s, _JOINTS, "joint", (reading.sensor,), joint_values(reading, sample, self._scratch))
            for reading, sample in samples
            if reading.is_new(sample)
        ]

    def _of_frames(self, measured: Mapping[str, Measurement]) -> list[Entry]:
        ranks, entries = list(KINDS), []
        for frame in self._frames:
            sample = measured[frame.sensor]
            if sample.valid and sample.time_s != self._used_s.get(frame.sensor):
                self._used_s[frame.sensor] = sample.time_s
                rank = _FIRST_FRAME + ranks.index(frame.kind)
                entries.append(Entry(sample.time_s, rank, "frame", (frame.sensor,), (sample.value,)))
        return entries

    def _measure(self, sensor: str, value: FloatArray, estimate: Estimate) -> Innovation:
        size, noise = self._layout.size, np.diag(self._deviations[sensor] ** 2)
        frame = next(candidate for candidate in self._frames if candidate.sensor == sensor)
        dofs = self._encoders.dofs if frame.by_joints else ()
        innovation, slope = frame.innovation(self._system.mj, estimate, value, dofs)
        if len(dofs):
            noise += (slope[:, size:] * self._encoders.variances) @ slope[:, size:].T
        return update(estimate, innovation, slope[:, :size], noise, self._largest_nis)

    def _set_entries(self, data: Any) -> list[Entry]:
        """What others have set in the estimate since the last call."""
        relative_pose = self._estimate.grasped
        following = (
            self._grasped[relative_pose.grasp].object if relative_pose is not None else None
        )  # it is known to rounding
        return [
            Entry(
                self._history.time_s,
                _SET,
                "given",
                (body.name,),
                (data.qpos[body.qpos].copy(), data.qvel[body.dofs].copy()),
            )
            for body in self._layout.bodies
            if body is not following and self._is_set(data, body)
        ]

    def _is_set(self, data: Any, body: FloatingBody) -> bool:
        """Whether the state of a body is not that which the filter has left."""
        left = self._estimate.data
        coordinates, rates = data.qpos[body.qpos] - left.qpos[body.qpos], data.qvel[body.dofs] - left.qvel[body.dofs]
        return bool(max(np.abs(coordinates).max(), np.abs(rates).max()) > _SET_BEYOND)

    def _begin_anew(self, estimate: Estimate, body: FloatingBody, pose: FloatArray, twist: FloatArray) -> None:
        """Let a body begin anew at a given state."""
        estimate.data.qpos[body.qpos], estimate.data.qvel[body.dofs] = pose, twist
        covariance = estimate.covariance.copy()
        covariance[body.error, :] = covariance[:, body.error] = 0.0
        covariance[body.error, body.error] = np.diag(np.repeat(_initial(self._config, body), 3) ** 2)
        estimate.covariance = covariance


def _release(estimate: Estimate, grasp: str) -> None:
    """Let go of what a grasp holds: it begins with the errors that it had in the hand."""
    if estimate.grasped is not None and estimate.grasped.grasp == grasp:
        estimate.grasped = None


def _initial(config: MekfConfig, body: FloatingBody) -> tuple[float, float, float, float]:
    """Initial standard deviations of position, attitude, velocity and angular velocity."""
    special = config.bodies.get(body.name)
    initial: InitialConfig = config.initial if special is None or special.initial is None else special.initial
    return initial.position_m, initial.attitude_rad, initial.velocity_m_s, initial.rate_rad_s


def _faults(bodies: Sequence[FloatingBody], frames: Sequence[FrameMeasurement], config: MekfConfig) -> list[Fault]:
    """What keeps the filter from working."""
    if not bodies:
        return [Fault("no body floats: there is nothing to filter", ("kind",))]
    names = [body.name for body in bodies]
    unknown = [Fault(unknown_name("body", name, names), ("bodies", name)) for name in config.bodies if name not in names]
    return [*unknown, *missing_measurements(bodies, frames)]


def _believed_noise(system: System, used: Collection[str], config: MekfConfig, faults: Faults) -> dict[str, float]:
    """Standard deviations that the configuration states, by full name of the sensor; faults of them are collected."""
    variances = {}
    for name, value in config.noise.items():
        with faults.below("noise", name):
            full = system.resolve("sensor", name)
            variances[full] = value
            if full not in used:
                faults.add(
                    f"the filter takes no noise from {full!r}: it measures no place of a body or joint", "noise", name
                )
    return variances


def _deviations(sensor: Sensor, believed: float | None, config: MekfConfig) -> FloatArray:
    """Standard deviation of each component of a sample, (3,): white noise and rounding, at least the floor."""
    noise = white_noise(sensor) if believed is None else np.full(3, believed)
    return np.maximum(noise, float(getattr(config.floor, KINDS[sensor.model.kind])))


def _chi_square_quantile(probability: float) -> float:
    """Value that the square of an innovation of three components does not exceed with this probability."""
    from scipy.special import chdtri  # a third of a second to import: only filters with a gate pay

    return float(chdtri(3.0, 1.0 - probability))
