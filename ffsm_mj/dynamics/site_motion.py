"""Kinematics of a site: position, attitude, Jacobian, rates and accelerations.

A frame at an offset from a site, as something to follow: where it is, how it moves, and how it accelerates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import skew


class SiteMotion:
    """Position and attitude of a site, or some world axes of its position alone, at the state of the last ``update``.

    Rows of rates and accelerations: those of the position along ``axes`` in m/s and m/s^2, then with ``attitude`` those of
    the angular velocity about x, y, z in rad/s and rad/s^2; all in world axes.

    Attributes:
        size: Number of rows, p.
        rows: Which of x, y, z of the position and of the angular velocity they are, 0 to 5, (p,).
        point: Position of the site in world axes, m, (3,).
        frame: Its axes as columns, in world axes, (3, 3).
        J: Jacobian of the rows, (p, nv).
        rates: J qdot, (p,).
        Jdot_qdot: The rows' accelerations at qdd = 0, (p,).
    """

    def __init__(self, model: Any, site: int, axes: Sequence[int] = (0, 1, 2), attitude: bool = True) -> None:
        """Bind to a site of a model."""
        self._model, self._site, self._body = model, site, int(model.site_bodyid[site])
        self.rows = np.array([*axes, *((3, 4, 5) if attitude else ())], dtype=np.intp)
        self.size = p = len(self.rows)
        # Position over attitude: MuJoCo writes each half in place.
        self._jacobian, self._jac_dot = np.empty((6, model.nv)), np.empty((6, model.nv))
        self._whole = p == 6
        self.J = self._jacobian if self._whole else np.empty((p, model.nv))
        self.point, self.frame = np.zeros(3), np.eye(3)
        self.rates, self.Jdot_qdot = np.zeros(p), np.zeros(p)

    def update(self, data: Any) -> None:
        """Update everything for the state in ``data``, whose derived quantities must be current."""
        model, jacobian, jac_dot = self._model, self._jacobian, self._jac_dot
        self.point, self.frame = data.site_xpos[self._site], data.site_xmat[self._site].reshape(3, 3)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
        mujoco.mj_jacDot(model, data, jac_dot[:3], jac_dot[3:], self.point, self._body)
        turning = jac_dot.dot(data.qvel)
        if not self._whole:
            jacobian.take(self.rows, axis=0, out=self.J)
            turning = turning[self.rows]
        self.rates, self.Jdot_qdot = self.J.dot(data.qvel), turning

    def acceleration(self, qacc: FloatArray) -> FloatArray:
        """Accelerations of the rows, (p,), for joint accelerations, (nv,)."""
        return np.asarray(self.Jdot_qdot + self.J.dot(qacc))


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
        acceleration = self._motion.acceleration(qacc)
        acceleration[:3] += skew(acceleration[3:]).dot(self._arm) + self._spin.dot(self._spin.dot(self._arm))
        return acceleration

    def relative_turn(self, rates: FloatArray) -> FloatArray:
        """Angular acceleration that a body has which turns at a constant rate in this frame.

        Args:
            rates: Angular velocity of the body relative to the frame, rad/s in world axes, (3,).

        Returns:
            What it has beyond that of the frame, rad/s^2 in world axes, (3,).
        """
        return np.asarray(self._spin.dot(rates))
