"""What sensors know of the surroundings of a scene at a place: what falls freely there."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.fields.interface import Field
from ffsm_mj.fields.orbit import Orbit


class Surroundings:
    """Surroundings of a scene, in its world axes."""

    def __init__(self, orbit: Orbit | None = None, fields: Iterable[Field] = ()) -> None:
        """Begin.

        Args:
            orbit: Orbit of the origin; None without one.
            fields: Other external fields.
        """
        self._tide, self._fields = None if orbit is None else orbit.field(), tuple(fields)

    def free_fall(self, time_s: float, position_m: FloatArray) -> FloatArray:
        """Acceleration of a free mass at a position, by all gravitation, m/s^2, (3,): what accelerometers do not feel."""
        total = np.zeros(3) if self._tide is None else self._tide.acceleration(time_s, position_m)
        for field in self._fields:
            total = total + field.free_fall(time_s, position_m)
        return total
