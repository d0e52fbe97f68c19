"""What sensors know of the surroundings of a scene at a place: what falls freely there, nadir, and the magnetic field."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from ffsm_mj._core.magnetic import MagneticField
from ffsm_mj.arrays import FloatArray
from ffsm_mj.fields.interface import Field
from ffsm_mj.fields.orbit import Orbit


class Surroundings:
    """Surroundings of a scene, in its world axes.

    Attributes:
        magnetic: Magnetic field; None: that of the model files.
        inertial: Attitude of the world axes in the inertial axes of the central body, a unit quaternion, (4,); without an
            orbit these are the same.
    """

    def __init__(
        self, orbit: Orbit | None = None, fields: Iterable[Field] = (), magnetic: MagneticField | None = None
    ) -> None:
        """Begin.

        Args:
            orbit: Orbit of the origin; None without one.
            fields: Other external fields.
            magnetic: Magnetic field; None: that of the model files.
        """
        self._orbit, self._tide = orbit, None if orbit is None else orbit.field()
        self._fields, self.magnetic = tuple(fields), magnetic
        self.inertial = np.array((1.0, 0.0, 0.0, 0.0))
        if orbit is not None:
            mujoco.mju_mat2Quat(self.inertial, orbit.axes.ravel())

    def free_fall(self, time_s: float, position_m: FloatArray) -> FloatArray:
        """Acceleration of a free mass at a position, by all gravitation, m/s^2, (3,): what accelerometers do not feel."""
        total = np.zeros(3) if self._tide is None else self._tide.acceleration(time_s, position_m)
        for field in self._fields:
            total = total + field.free_fall(time_s, position_m)
        return total

    def nadir(self, time_s: float, position_m: FloatArray) -> FloatArray:
        """Unit vector from a position to the centre of the central body, (3,); the scene is in orbit."""
        assert self._orbit is not None
        origin, _ = self._orbit.reference.state(time_s)
        down = -(origin + position_m)
        unit: FloatArray = down / np.linalg.norm(down)
        return unit
