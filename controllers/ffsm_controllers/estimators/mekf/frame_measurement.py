"""What a sensor on a floating body should measure at an estimate, and how that depends on the error of the estimate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators.frames import Frame, axes_of, frame_of
from ffsm_controllers.estimators.mekf.estimate import Estimate
from ffsm_controllers.estimators.mekf.frame_motion import FrameMotion, frame_motion
from ffsm_controllers.estimators.mekf.layout import FloatingBody
from ffsm_mj.controller_protocol import Fault, FloatArray, Sensor, skew

KINDS = {
    "framequat": "attitude_rad",
    "startracker": "attitude_rad",
    "framepos": "position_m",
    "framelinvel": "velocity_m_s",
    "velocimeter": "velocity_m_s",
    "frameangvel": "rate_rad_s",
    "gyro": "rate_rad_s",
}
"""What a sensor measures, by its kind, in the order in which samples of one time are used."""
_ATTITUDES = ("framequat", "startracker")


@dataclass(frozen=True)
class FrameMeasurement:
    """A sensor that measures a frame on one tree relative to the world or to a frame on another tree.

    Attributes:
        sensor: Its full name.
        kind: Its element in MJCF.
        frame: What it measures.
        reference: Relative to which frame.
        body: Floating body of the frame; None: it is fixed.
        other: Floating body of the reference; None: it is fixed.
        stars: World axes in those in which a star tracker measures, as columns, (3, 3); None for other sensors.
    """

    sensor: str
    kind: str
    frame: Frame
    reference: Frame
    body: FloatingBody | None
    other: FloatingBody | None
    stars: FloatArray | None = None

    @property
    def by_joints(self) -> bool:
        """Whether its dependence on coordinates of joints is known: that of places and attitudes."""
        return self.kind in ("framepos", *_ATTITUDES)

    def innovation(
        self, model: Any, estimate: Estimate, value: FloatArray, dofs: Sequence[int] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Measured less expected, (3,), for rotations the vector between; and the derivative of the expected value.

        Args:
            model: MuJoCo model.
            estimate: The estimate.
            value: What was measured.
            dofs: Degrees of freedom of joints whose coordinates have errors, (n,).

        Returns:
            The innovation, and its derivative by the error state, then by these coordinates, (3, size + n).
        """
        data, size = estimate.data, estimate.layout.size
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        frame = frame_motion(model, data, self.frame, self.body, size, dofs)
        reference = frame_motion(model, data, self.reference, self.other, size, dofs)
        expected, slope = _EXPECTED[self.kind](frame, reference)
        if self.kind in _ATTITUDES:
            return _turn(expected if self.stars is None else self.stars @ expected, value), slope
        if (bias := estimate.layout.bias_of(self.sensor)) is not None:
            expected = expected + estimate.biases[bias.value]
            slope[:, bias.error] = np.eye(3)
        return value - expected, slope


def measurement_of(model: Any, bodies: Sequence[FloatingBody], sensor: Sensor) -> FrameMeasurement | None:
    """What a sensor says of floating bodies; None if nothing, as a sensor between parts of one tree."""
    if sensor.model.kind not in KINDS:
        return None
    number = int(model.sensor(sensor.name).id)
    frame = frame_of(model, int(model.sensor_objtype[number]), int(model.sensor_objid[number]))
    reference = frame_of(model, int(model.sensor_reftype[number]), int(model.sensor_refid[number]))
    body, other = (
        next((candidate for candidate in bodies if one.body in candidate.tree.bodies), None) for one in (frame, reference)
    )
    if body is other or (frame.body and model.body_rootid[frame.body] == model.body_rootid[reference.body]):
        return None
    stars = axes_of(sensor.reference) if sensor.model.kind == "startracker" else None
    return FrameMeasurement(sensor.name, sensor.model.kind, frame, reference, body, other, stars)


def _position(frame: FrameMotion, reference: FrameMotion) -> tuple[FloatArray, FloatArray]:
    apart = frame.origin - reference.origin
    return reference.axes.T @ apart, reference.axes.T @ (
        frame.d_origin - reference.d_origin + skew(apart) @ reference.d_axes
    )


def _attitude(frame: FrameMotion, reference: FrameMotion) -> tuple[FloatArray, FloatArray]:
    """Rotation matrix of the frame in the reference; derivative of the rotation vector in axes of the frame."""
    return reference.axes.T @ frame.axes, frame.axes.T @ (frame.d_axes - reference.d_axes)


def _velocity(frame: FrameMotion, reference: FrameMotion) -> tuple[FloatArray, FloatArray]:
    """Velocity of the frame's origin as seen in the reference, which turns."""
    apart, d_apart = frame.origin - reference.origin, frame.d_origin - reference.d_origin
    seen = frame.velocity - reference.velocity - skew(reference.turning) @ apart
    change = frame.d_velocity - reference.d_velocity + skew(apart) @ reference.d_turning - skew(reference.turning) @ d_apart
    return reference.axes.T @ seen, reference.axes.T @ (change + skew(seen) @ reference.d_axes)


def _turning(frame: FrameMotion, reference: FrameMotion) -> tuple[FloatArray, FloatArray]:
    seen = frame.turning - reference.turning
    return reference.axes.T @ seen, reference.axes.T @ (
        frame.d_turning - reference.d_turning + skew(seen) @ reference.d_axes
    )


def _velocimeter(frame: FrameMotion, reference: FrameMotion) -> tuple[FloatArray, FloatArray]:  # noqa: ARG001
    return frame.axes.T @ frame.velocity, frame.axes.T @ (frame.d_velocity + skew(frame.velocity) @ frame.d_axes)


def _gyro(frame: FrameMotion, reference: FrameMotion) -> tuple[FloatArray, FloatArray]:  # noqa: ARG001
    return frame.axes.T @ frame.turning, frame.axes.T @ (frame.d_turning + skew(frame.turning) @ frame.d_axes)


_EXPECTED: dict[str, Callable[[FrameMotion, FrameMotion], tuple[FloatArray, FloatArray]]] = {
    "framequat": _attitude,
    "startracker": _attitude,
    "framepos": _position,
    "framelinvel": _velocity,
    "velocimeter": _velocimeter,
    "frameangvel": _turning,
    "gyro": _gyro,
}


def _turn(expected: FloatArray, measured: FloatArray) -> FloatArray:
    """Rotation vector from an expected rotation matrix to a measured quaternion, in the axes that the former turns to."""
    quaternion, turn = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(expected).ravel())
    mujoco.mju_subQuat(turn, measured, quaternion)
    return turn


_NEEDED = {("framepos",): "position", _ATTITUDES: "attitude"}


def missing_measurements(bodies: Sequence[FloatingBody], measurements: Iterable[FrameMeasurement]) -> list[Fault]:
    """Bodies of which no sensor measures a position, or an attitude, relative to anything.

    Bodies that are measured relative to each other alone keep the initial uncertainty of where they all are.
    """
    measured, faults = list(measurements), []
    for kinds, what in _NEEDED.items():
        known = {_name(body) for one in measured if one.kind in kinds for body in (one.body, one.other)}
        for body in bodies:
            if body.name not in known:
                needed = f"a filter needs a <{kinds[0]}> of it, relative to the world or to another body"
                faults.append(Fault(f"no sensor measures the {what} of {body.name!r}: {needed}", ("kind",)))
    return faults


def _name(body: object) -> str:
    """Name of a floating body; empty for the world."""
    return str(getattr(body, "name", ""))
