"""Kinematics of a site: position, attitude, Jacobian, rates and accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray


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
