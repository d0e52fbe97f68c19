"""The OSDRE law for any number of outputs, in small arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_controllers.osdre.riccati import BlockRiccati
from ffsm_controllers.osdre.tip_kinematics import TipKinematics
from ffsm_mj.arrays import FloatArray


class BlockLaw:
    """u = -R^-1 B^T K [y - y_d; ydot], paper (32); see :class:`ffsm_controllers.osdre.planar_law.PlanarLaw`."""

    def __init__(
        self,
        kinematics: TipKinematics,
        data: Any,
        riccati: BlockRiccati,
        driven: FloatArray,
        axes: Sequence[int],
        target_m: Sequence[float],
        whole_stack: bool,
    ) -> None:
        """Bind to the state in ``data``."""
        self._kinematics, self._riccati, self._whole_stack = kinematics, riccati, whole_stack
        self._driven, self._driven_R = np.vsplit(driven, 2)
        self._axes, self._target = np.array(axes), np.array(target_m)
        self._point, self._qvel = kinematics.point, data.qvel
        self._bias, self._passive = data.qfrc_bias, data.qfrc_passive
        self.effort, self.report = np.zeros(len(self._driven)), np.full(4, np.nan)

    def tick(self) -> None:
        """Work out ``effort`` and ``report`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        kinematics, axes = self._kinematics, self._axes
        kinematics.update()
        W = kinematics.W
        B_lower, BR = W.dot(self._driven.T), W.dot(self._driven_R.T)
        y, y_dot = self._point[axes], kinematics.J.dot(self._qvel)
        drift = kinematics.jac_dot[axes].dot(self._qvel) - W.dot(self._bias - self._passive)
        A21, A22 = np.zeros((len(y), len(y))), np.outer(drift, y_dot)
        square = float(y_dot.dot(y_dot))
        if self._whole_stack:
            A21, square = np.outer(drift, y), square + float(y.dot(y))
        scale = 1.0 / square if square > 0.0 else 0.0
        K_lower, residual, fallback = self._riccati.solve(scale * A21, scale * A22, BR.dot(B_lower.T))
        error = y - self._target
        smallest = float(np.linalg.svd(B_lower, compute_uv=False)[-1])
        self.effort[:] = -K_lower.dot(np.concatenate((error, y_dot))).dot(BR)
        self.report[:] = math.sqrt(error.dot(error)), residual, fallback, smallest
