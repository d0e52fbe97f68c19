"""The OSDRE law for two outputs, mostly in floats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_controllers.osdre.osdre_planar import answer
from ffsm_controllers.osdre.riccati_planar import PlanarRiccati, principal_axes
from ffsm_controllers.osdre.tip_kinematics import TipKinematics
from ffsm_mj.arrays import FloatArray


class PlanarLaw:
    """u = -R^-1 B^T K [y - y_d; ydot], paper (32), along the principal axes of S = alpha M_c^-1 R^-1 (alpha M_c^-1)^T.

    Attributes:
        effort: Torques of the last tick, (n,).
        report: Of the last tick: distance from the target in m, residual of the Riccati equation, 1 where the robust method
            solved it, smallest singular value of alpha M_c^-1, (4,).
    """

    def __init__(
        self,
        kinematics: TipKinematics,
        data: Any,
        riccati: PlanarRiccati,
        driven: FloatArray,
        axes: Sequence[int],
        target_m: Sequence[float],
        whole_stack: bool,
    ) -> None:
        """Bind to the state in ``data``.

        Args:
            kinematics: Of the tip.
            data: MuJoCo data.
            riccati: Solver of the equation.
            driven: Rows of the identity that pick the n driven joints, over R^-1 times the same, (2 n, nv).
            axes: World axes of the outputs.
            target_m: Target along them.
            whole_stack: A = d z^+ instead of [0, d ydot^+].
        """
        self._kinematics, self._riccati, self._driven, self._n = kinematics, riccati, driven, len(driven) // 2
        self._axes, self._target, self._whole_stack = axes, (target_m[0], target_m[1]), whole_stack
        # Views: looking MuJoCo's arrays up costs more than reading them.
        self._point, self._qvel = kinematics.point, data.qvel
        self._bias, self._passive = data.qfrc_bias, data.qfrc_passive
        self.effort, self.report, self._w = np.zeros(self._n), np.full(4, np.nan), np.empty(2)

    def tick(self) -> None:
        """Work out ``effort`` and ``report`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        kinematics = self._kinematics
        kinematics.update()
        W, qvel, n = kinematics.W, self._qvel, self._n
        gains = self._driven.dot(W.T)
        B_T, gain = gains[:n], gains[n:]
        # One list of floats is read faster than its numbers one by one.
        (s0, s1), (_, s3) = gain.T.dot(B_T).tolist()
        (b0, b1), (_, b3) = B_T.T.dot(B_T).tolist()
        values, axes = principal_axes(s0, s1, s3)
        smallest = principal_axes(b0, b1, b3)[0][1]
        i, j = self._axes
        rates, drift = kinematics.J.dot(qvel).tolist(), kinematics.jac_dot.dot(qvel).tolist()
        pushed, point = W.dot(self._bias - self._passive).tolist(), self._point.tolist()
        y = point[i], point[j]
        error = y[0] - self._target[0], y[1] - self._target[1]
        d, y_dot = (drift[i] - pushed[0], drift[j] - pushed[1]), (rates[0], rates[1])
        w, error, residual, fallback = answer(self._riccati, values, axes, d, y, error, y_dot, self._whole_stack)
        self._w[0], self._w[1] = w
        gain.dot(self._w, out=self.effort)
        report = self.report
        report[0], report[1] = math.hypot(*error), residual
        report[2], report[3] = fallback, math.sqrt(max(smallest, 0.0))
