"""What a sensor on a floating body should measure at an estimate, and how that depends on the error of the estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators.frames import Frame, frame_of
from ffsm_controllers.estimators.mekf.belief import Belief
from ffsm_controllers.estimators.mekf.frame_motion import FrameMotion, frame_motion
from ffsm_controllers.estimators.mekf.layout import FloatingBody
from ffsm_mj.controller_protocol import FloatArray, skew

KINDS = {
    "framequat": "attitude_rad",
    "framepos": "position_m",
    "framelinvel": "velocity_m_s",
    "velocimeter": "velocity_m_s",
    "frameangvel": "rate_rad_s",
    "gyro": "rate_rad_s",
}
"""What a sensor measures, by its kind, in the order in which samples of one time are used."""


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
    """

    sensor: str
    kind: str
    frame: Frame
    reference: Frame
    body: FloatingBody | None
    other: FloatingBody | None

    @property
    def by_joints(self) -> bool:
        """Whether its dependence on coordinates of joints is known: that of places and attitudes."""
        return self.kind in ("framepos", "framequat")

    def innovation(
        self, model: Any, belief: Belief, value: FloatArray, dofs: Sequence[int] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Measured less expected, (3,), for rotations the vector between; and the derivative of the expected value.

        Args:
            model: MuJoCo model.
            belief: The estimate.
            value: What was measured.
            dofs: Degrees of freedom of joints whose coordinates have errors, (n,).

        Returns:
            The innovation, and its derivative by the error state, then by these coordinates, (3, size + n).
        """
        data, size = belief.data, belief.layout.size
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        here = frame_motion(model, data, self.frame, self.body, size, dofs)
        there = frame_motion(model, data, self.reference, self.other, size, dofs)
        expected, slope = _EXPECTED[self.kind](here, there)
        if self.kind == "framequat":
            return _turn(expected, value), slope
        if (bias := belief.layout.bias_of(self.sensor)) is not None:
            expected = expected + belief.biases[bias.value]
            slope[:, bias.error] = np.eye(3)
        return value - expected, slope


def measurement_of(model: Any, bodies: Sequence[FloatingBody], sensor: str, kind: str) -> FrameMeasurement | None:
    """What a sensor says of floating bodies; None if nothing, as a sensor between parts of one tree."""
    if kind not in KINDS:
        return None
    number = int(model.sensor(sensor).id)
    frame = frame_of(model, int(model.sensor_objtype[number]), int(model.sensor_objid[number]))
    reference = frame_of(model, int(model.sensor_reftype[number]), int(model.sensor_refid[number]))
    body, other = (next((each for each in bodies if one.body in each.tree.bodies), None) for one in (frame, reference))
    if body is other or (frame.body and model.body_rootid[frame.body] == model.body_rootid[reference.body]):
        return None
    return FrameMeasurement(sensor, kind, frame, reference, body, other)


def _position(here: FrameMotion, there: FrameMotion) -> tuple[FloatArray, FloatArray]:
    apart = here.origin - there.origin
    return there.axes.T @ apart, there.axes.T @ (here.d_origin - there.d_origin + skew(apart) @ there.d_axes)


def _attitude(here: FrameMotion, there: FrameMotion) -> tuple[FloatArray, FloatArray]:
    """Rotation matrix of the frame in the reference; derivative of the rotation vector in axes of the frame."""
    return there.axes.T @ here.axes, here.axes.T @ (here.d_axes - there.d_axes)


def _velocity(here: FrameMotion, there: FrameMotion) -> tuple[FloatArray, FloatArray]:
    """Velocity of the frame's origin as seen in the reference, which turns."""
    apart, d_apart = here.origin - there.origin, here.d_origin - there.d_origin
    seen = here.velocity - there.velocity - skew(there.turning) @ apart
    change = here.d_velocity - there.d_velocity + skew(apart) @ there.d_turning - skew(there.turning) @ d_apart
    return there.axes.T @ seen, there.axes.T @ (change + skew(seen) @ there.d_axes)


def _turning(here: FrameMotion, there: FrameMotion) -> tuple[FloatArray, FloatArray]:
    seen = here.turning - there.turning
    return there.axes.T @ seen, there.axes.T @ (here.d_turning - there.d_turning + skew(seen) @ there.d_axes)


def _own_velocity(here: FrameMotion, there: FrameMotion) -> tuple[FloatArray, FloatArray]:  # noqa: ARG001
    return here.axes.T @ here.velocity, here.axes.T @ (here.d_velocity + skew(here.velocity) @ here.d_axes)


def _own_turning(here: FrameMotion, there: FrameMotion) -> tuple[FloatArray, FloatArray]:  # noqa: ARG001
    return here.axes.T @ here.turning, here.axes.T @ (here.d_turning + skew(here.turning) @ here.d_axes)


_EXPECTED: dict[str, Callable[[FrameMotion, FrameMotion], tuple[FloatArray, FloatArray]]] = {
    "framequat": _attitude,
    "framepos": _position,
    "framelinvel": _velocity,
    "velocimeter": _own_velocity,
    "frameangvel": _turning,
    "gyro": _own_turning,
}


def _turn(expected: FloatArray, measured: FloatArray) -> FloatArray:
    """Rotation vector from an expected rotation matrix to a measured quaternion, in the axes that the former turns to."""
    quaternion, turn = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(expected).ravel())
    mujoco.mju_subQuat(turn, measured, quaternion)
    return turn
