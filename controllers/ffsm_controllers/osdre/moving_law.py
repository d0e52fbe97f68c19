"""The OSDRE law towards a target that moves, for any number of outputs.

The error obeys edd = (d - ydd_d) + B u, d the drift of the output: with z = [e; ed] and d - ydd_d in place of d it is the
paper's problem again, and u = -R^-1 B^T K [e; ed]. What is factorised is what is fed back: with z = [y; ydot] the state
would not vanish on the target, and the tip would lag behind. For a target at rest the ``velocity`` parameterization is the
paper's; ``output_stack`` is that of a world whose origin is the target.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ffsm_mj._core.osdre import note
from ffsm_mj._core.riccati_doubling import Doubling
from ffsm_mj.arrays import FloatArray
from ffsm_mj.task_model import TaskModel

# Rows of alpha M_c^-1 that are smaller, relative to the largest, do not move the output (numpy's limit for pinv).
_NO_MOTION = 1e-15


class MovingLaw:
    """u = -R^-1 B^T K [e; ed]; attributes as those of :class:`~ffsm_mj._core.osdre.BlockLaw`."""

    def __init__(
        self,
        model: TaskModel,
        data: Any,
        riccati: Doubling,
        inverse_R: FloatArray,
        whole_stack: bool,
        extremes: FloatArray,
        damping: FloatArray,
    ) -> None:
        """Bind to the state in ``data``.

        Args:
            model: The task, whose target moves.
            data: MuJoCo data.
            riccati: Solver of the equation.
            inverse_R: R^-1, (n, n).
            whole_stack: A = (d - ydd_d) z^+ instead of [0, (d - ydd_d) ed^+].
            damping: From rates to the damping of the driven joints, N m s/rad or N s/m, (n, nv).
            extremes: See :func:`~ffsm_mj._core.osdre.note`, (3,).
        """
        self._model, self._data, self._riccati, self._inverse_R = model, data, riccati, inverse_R
        self._whole_stack, self._extremes, self._damping = whole_stack, extremes, damping
        self.effort, self.report = np.zeros(len(inverse_R)), np.full(5, np.nan)

    def tick(self) -> None:
        """Work out ``effort`` and ``report`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        model, riccati = self._model, self._riccati
        model.update(self._data)
        B, ed, e = model.B, model.ed, model.e if self._whole_stack else np.zeros_like(model.e)
        square = float(ed.dot(ed) + e.dot(e))
        drift = (model.drift - model.target_accelerations) / (square if square > 0.0 else 1.0)
        pushes = self._inverse_R.dot(B.T)
        K_lower, residual = riccati.solve(np.outer(drift, e), np.outer(drift, ed), B.dot(pushes))
        self.effort = -pushes.dot(K_lower.dot(np.concatenate((model.e, ed))))
        _, sizes, rows = np.linalg.svd(B, full_matrices=False)
        if self._damping.any():
            inputs, damped = rows[sizes > _NO_MOTION * sizes[0]], self._damping.dot(self._data.qvel)
            self.effort -= damped - inputs.dot(damped).dot(inputs)
        distance = math.hypot(*model.e.tolist())
        self.report[:] = distance, residual, riccati.doublings, riccati.corrections, sizes[-1]
        note(self._extremes, self.report)
