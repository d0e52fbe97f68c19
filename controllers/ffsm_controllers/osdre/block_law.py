"""The OSDRE law for any number of outputs, in small arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_controllers.indices import compact
from ffsm_controllers.osdre.riccati_doubling import Doubling
from ffsm_controllers.osdre.tip_kinematics import TipKinematics
from ffsm_mj.arrays import FloatArray

# Rows of alpha M_c^-1 that are smaller, relative to the largest, do not move the output (numpy's limit for pinv).
_NO_MOTION = 1e-15


class BlockLaw:
    """u = -R^-1 B^T K [y - y_d; ydot], paper (32); see :class:`ffsm_controllers.osdre.planar_law.PlanarLaw`.

    Attributes:
        effort: Torques of the last tick, (n,).
        report: Of the last tick: distance from the target in m, residual of the Riccati equation, doublings and corrections
            that it took, smallest singular value of alpha M_c^-1, (5,).
        inputs: Orthonormal basis of the torques that move the output at the last tick, rows that move nothing zero, (p, n).
    """

    def __init__(
        self,
        kinematics: TipKinematics,
        data: Any,
        riccati: Doubling,
        driven: FloatArray,
        axes: Sequence[int],
        target_m: Sequence[float],
        whole_stack: bool,
    ) -> None:
        """Bind to the state in ``data``."""
        from scipy.linalg.lapack import dgesdd  # a third of a second to import

        self._svd = dgesdd  # LAPACK itself: numpy's way there takes twice as long
        self._kinematics, self._riccati, self._whole_stack = kinematics, riccati, whole_stack
        self._driven, self._n = driven, len(driven) // 2
        self._axes, self._target = compact(axes), np.array(target_m)
        self._point, self._qvel = kinematics.point, data.qvel
        self._bias, self._passive = data.qfrc_bias, data.qfrc_passive
        self._none = np.zeros((len(axes), len(axes)))
        self.effort, self.report, self.inputs = np.zeros(self._n), np.full(5, np.nan), np.zeros((len(axes), self._n))

    def tick(self) -> None:
        """Work out ``effort``, ``report`` and ``inputs`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        kinematics, riccati, axes = self._kinematics, self._riccati, self._axes
        kinematics.update()
        W = kinematics.W
        gains = self._driven.dot(W.T)
        B_T, BR_T = gains[: self._n], gains[self._n :]
        y, y_dot = self._point[axes], kinematics.J.dot(self._qvel)
        drift = kinematics.jac_dot.dot(self._qvel)[axes] - W.dot(self._bias - self._passive)
        square = float(y_dot.dot(y_dot))
        A21 = self._none
        if self._whole_stack:
            square += float(y.dot(y))
        if square > 0.0:
            drift /= square
        if self._whole_stack:
            A21 = drift[:, None] * y
        K_lower, residual = riccati.solve(A21, drift[:, None] * y_dot, BR_T.T.dot(B_T))
        error = y - self._target
        _, sizes, rows, _ = self._svd(B_T.T, full_matrices=0)
        if not sizes[-1] > _NO_MOTION * sizes[0]:
            rows[sizes <= _NO_MOTION * sizes[0]] = 0.0
        self.inputs = rows
        BR_T.dot(-K_lower.dot(np.concatenate((error, y_dot))), out=self.effort)
        distance = math.sqrt(float(error.dot(error)))
        self.report[:] = distance, residual, riccati.doublings, riccati.corrections, sizes[-1]
