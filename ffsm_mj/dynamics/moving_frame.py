"""A frame at an offset from a site, as something to follow: where it is, how it moves, and how it accelerates."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import skew
from ffsm_mj.dynamics.site_motion import SiteMotion


class MovingFrame:
    """A frame with the axes of a site and its origin at a point that is fixed to the site.

    Attributes:
        point: The point in world axes, m, (3,).
        frame: Axes of the site as columns, in world axes, (3, 3).
        rates: Velocity of the point in m/s, angular velocity in rad/s, world axes, (6,).
    """

    def __init__(self, model: Any, site: int, offset_m: FloatArray) -> None:
        """Bind to a site.

        Args:
            model: MuJoCo model.
            site: Id of the site.
            offset_m: The point in the frame of the site, m, (3,).
        """
        self._motion, self._offset = SiteMotion(model, site), offset_m

    def update(self, data: Any) -> None:
        """Update position and rates for the state in ``data``, whose derived quantities must be current."""
        motion = self._motion
        motion.update(data)
        self._arm, self._spin = motion.frame.dot(self._offset), skew(motion.rates[3:])
        self.point, self.frame, self.rates = motion.point + self._arm, motion.frame, motion.rates.copy()
        self.rates[:3] += self._spin.dot(self._arm)

    def accelerations(self, qacc: FloatArray) -> FloatArray:
        """Acceleration of the point in m/s^2 and angular acceleration in rad/s^2, (6,), for joint accelerations, (nv,)."""
        found = self._motion.acceleration(qacc)
        found[:3] += skew(found[3:]).dot(self._arm) + self._spin.dot(self._spin.dot(self._arm))
        return found

    def relative_turn(self, rates: FloatArray) -> FloatArray:
        """Angular acceleration that a body has which turns at a constant rate in this frame.

        Args:
            rates: Angular velocity of the body relative to the frame, rad/s in world axes, (3,).

        Returns:
            What it has beyond that of the frame, rad/s^2 in world axes, (3,).
        """
        return np.asarray(self._spin.dot(rates))
