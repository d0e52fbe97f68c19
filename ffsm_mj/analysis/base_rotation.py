"""Rotation of the robot's base in a run."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import Layout, coordinate_keys


class BaseRotation:
    """Accumulates the angle between the orientation of the base and that at the first row.

    About the axis of a hinge it is the angle turned by, else the angle of the rotation, at most pi.
    """

    def __init__(self, system: System) -> None:
        """Bind to robot and objects."""
        robot = system.robot
        turning = [joint for joint in robot.joints if joint.body == robot.root and joint.kind != "slide"]
        self._keys = coordinate_keys(turning)[-1 if turning[0].kind == "hinge" else -4 :] if len(turning) == 1 else ()
        self._first: FloatArray | None = None
        self._final_rad, self._largest_rad = 0.0, 0.0

    def open(self, layout: Layout) -> None:
        """Find the columns of a run.

        Raises:
            KeyError: The log lacks one of them.
        """
        self._places = layout.places(self._keys)

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        if not self._keys or not len(block):
            return
        columns = block[:, self._places]
        if self._first is None:
            self._first = columns[0].copy()
        angles = np.abs(columns[:, 0] - self._first[0]) if len(self._keys) == 1 else _angles(columns, self._first)
        self._final_rad, self._largest_rad = float(angles[-1]), max(self._largest_rad, float(angles.max()))

    def summary(self) -> dict[str, float] | None:
        """``final_rad`` at the last row, ``largest_rad`` over all rows; None if the base does not turn by one joint."""
        if self._first is None or not np.isfinite((self._final_rad, self._largest_rad)).all():
            return None
        return {"final_rad": self._final_rad, "largest_rad": self._largest_rad}


def _angles(quaternions: FloatArray, first: FloatArray) -> FloatArray:
    """Angles between unit quaternions and another one, rad, (n,).

    From the chords to it and to its opposite, which is the same orientation: precise for small angles too.
    """
    chords = [np.linalg.norm(quaternions + sign * first, axis=1) for sign in (1.0, -1.0)]
    return np.asarray(4.0 * np.arctan2(np.minimum(*chords), np.maximum(*chords)))
