"""Limits of actuators: ranges, torque-speed lines, saturation of wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray


@dataclass(frozen=True)
class Envelope:
    """Limits of each actuator, (nu,) each: low <= effort <= high, |effort + slope * velocity| <= stall.

    Attributes:
        low: Least effort that MJCF allows.
        high: Greatest effort that MJCF allows.
        stall: Greatest effort at rest; infinite without a limit.
        slope: Effort lost per actuator velocity.
        saturation: Joint speed beyond which efforts cannot accelerate it further; infinite without one.
        gear: Effort per ctrl.
    """

    low: FloatArray
    high: FloatArray
    stall: FloatArray
    slope: FloatArray
    saturation: FloatArray
    gear: FloatArray

    def bounds(self, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest effort of each actuator, (nu,) each, at actuator velocities (nu,); wheels not saturated."""
        drag = velocity * self.slope
        return np.maximum(-self.stall - drag, self.low), np.minimum(self.stall - drag, self.high)


class Limits:
    """Converts a command to efforts within their envelope, and to ``ctrl``."""

    def __init__(
        self,
        envelope: Envelope,
        effort: FloatArray,
        powered: npt.NDArray[np.bool_],
        velocity: FloatArray,
        table: FloatArray,
        ctrl: FloatArray,
    ) -> None:
        """Bind to a command and to the plant.

        Args:
            envelope: Limits of the actuators.
            effort: Commanded efforts, (nu,).
            powered: Which actuators have power, (nu,).
            velocity: Actuator velocities, (nu,).
            table: Receives commanded effort, applied effort, lower and upper bound by actuator, (nu, 4).
            ctrl: Receives MuJoCo's control, (nu,).
        """
        self._effort, self._powered, self._velocity, self._ctrl = effort, powered, velocity, ctrl
        self._wanted, self._applied, self._lower, self._upper = table.T
        self._low, self._high, self._slope, self._gear = envelope.low, envelope.high, envelope.slope, envelope.gear
        self._stall, self._reverse_stall = envelope.stall, -envelope.stall
        self._wheels = [(i, x) for i, x in enumerate(envelope.saturation.tolist()) if x < math.inf]
        self._drag, self._ones = np.empty(len(ctrl)), np.ones(len(ctrl))

    def apply(self) -> bool:
        """Compute the table and ``ctrl``; return False, with only commands written, if a powered effort is not finite."""
        wanted, applied, lower, upper, powered = self._wanted, self._applied, self._lower, self._upper, self._powered
        np.multiply(self._effort, powered, out=wanted)
        if not math.isfinite(wanted.dot(self._ones)):
            wanted[~powered] = 0.0  # commands of unpowered actuators are ignored
            if not np.isfinite(wanted).all():
                return False
        # The torque-speed line shifts both bounds in proportion to the velocity; without a slope they are constant.
        drag = np.multiply(self._velocity, self._slope, out=self._drag)
        np.maximum(self._reverse_stall - drag, self._low, out=lower)
        np.minimum(self._stall - drag, self._high, out=upper)
        for i, saturation in self._wheels:
            speed = self._velocity[i] / self._gear[i]
            if speed <= -saturation:
                lower[i] = 0.0
            if speed >= saturation:
                upper[i] = 0.0
        np.minimum(np.maximum(wanted, lower), upper, out=applied)
        np.multiply(applied, powered, out=applied)
        np.divide(applied, self._gear, out=self._ctrl)
        return True
