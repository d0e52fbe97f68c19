"""The OSDRE law for two outputs, mostly in floats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from controllers.osdre_planar import feedback, lower_block, turned_pair
from controllers.riccati_planar import PlanarRiccati, principal_axes
from controllers.tip_kinematics import TipKinematics
from ffsm_mj.model import FloatArray


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
        self.effort, self.report = np.zeros(self._n), np.full(4, np.nan)

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
        S, square = gain.T.dot(B_T), B_T.T.dot(B_T)
        values, axes = principal_axes(float(S[0, 0]), float(S[0, 1]), float(S[1, 1]))
        smallest = principal_axes(float(square[0, 0]), float(square[0, 1]), float(square[1, 1]))[0][1]
        i, j = self._axes
        rates, drift = kinematics.J.dot(qvel).tolist(), kinematics.jac_dot.dot(qvel)
        pushed = W.dot(self._bias - self._passive)
        y = float(self._point[i]), float(self._point[j])
        error = turned_pair((y[0] - self._target[0], y[1] - self._target[1]), axes)
        y_dot = turned_pair((rates[0], rates[1]), axes)
        d = turned_pair((float(drift[i]) - float(pushed[0]), float(drift[j]) - float(pushed[1])), axes)
        A21, A22 = lower_block(d, turned_pair(y, axes), y_dot, self._whole_stack)
        blocks, residual, fallback = self._riccati.solve(A21, A22, values, axes)
        w = turned_pair(feedback(blocks, error, y_dot), (axes[0], -axes[1]))
        gain.dot(w, out=self.effort)
        self.report[:] = math.hypot(*error), residual, fallback, math.sqrt(max(smallest, 0.0))
