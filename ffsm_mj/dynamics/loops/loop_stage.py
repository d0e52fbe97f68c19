"""Independent rows of closed loops at one state, and the forces that they need in a stage of a step."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.loops.latch_rows import LatchRowEvaluator

LEAST_PIVOT, LARGEST_PIVOT = 0.25, 4.0
"""Bounds of the Cholesky pivots of R M^-1 R^T, which is 1 where T is found, within which T is kept."""
VANISHES = 1e-9
"""Combinations of rows below this share of the largest element of the rows vanish still."""


class LoopStage:
    """Rows R = T B of some latches in the stages of a step; all methods are about the state in ``data``.

    Positions and velocities in ``data`` must be current, and the mass matrix factored.

    Attributes:
        J: All rows B at the last state, (n, nv).
        R: Independent rows, (r, nv).
        response: R M^-1, (r, nv).
        factor: Lower Cholesky factor of R M^-1 R^T, (r, r).
        gamma: Rates of R at zero generalised acceleration, (r,).
        y: Forces of the rows R by the last :meth:`push` or :meth:`generalised`, (r,).
    """

    def __init__(self, model: Any, data: Any, latches: Sequence[LatchedBodies], bodies: Sequence[int], seen: Any) -> None:
        """Take views of the arrays of ``data``.

        Args:
            model: MuJoCo model.
            data: Its data.
            latches: The latches.
            bodies: Id in this model of each body that the latches name.
            seen: Data of the logged system, which has the efforts.
        """
        self._model, self._data, self._seen = model, data, seen
        self._evaluator = LatchRowEvaluator(model, data, latches, bodies)
        self._qpos, self._qvel, self._ctrl, self._seen_ctrl = data.qpos, data.qvel, data.ctrl, seen.ctrl
        self._passive, self._bias, self._actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator
        self._applied = data.qfrc_applied
        self._place: bytes | None = None
        self._T, self._others = np.empty((0, 0)), np.empty((0, 0))
        self.J, self.R, self.response, self.factor, self.gamma, self.y = (np.empty(0) for _ in range(6))

    def combine(self, T: FloatArray, others: FloatArray) -> None:
        """Use some combinations of the rows.

        Args:
            T: Independent ones, (r, n).
            others: Orthonormal ones that vanish, (n - r, n).
        """
        self._T, self._others, self._place = T, others, None

    def evaluate(self) -> None:
        """Update the attributes for the state in ``data``.

        Raises:
            LinAlgError: The rows depend on each other here.
        """
        place = self._qpos.tobytes() + self._qvel.tobytes()
        if place == self._place:
            return
        rows, T = self._evaluator.at_state(), self._T
        self.J, self.R, self.gamma = rows.J, T.dot(rows.J), T.dot(rows.gamma)
        self.response = np.empty_like(self.R)
        self.factor = np.empty((0, 0))
        if len(T):
            mujoco.mj_solveM(self._model, self._data, self.response, self.R)
            self.factor, fault = _lapack()[0](self.response.dot(self.R.T), 1)
            if fault:
                raise np.linalg.LinAlgError("latches of closed grasps depend on each other within a step")
        self._place = place

    def fits(self) -> bool:
        """Whether the combinations T are independent here, and the others vanish."""
        self.evaluate()
        pivots: list[float] = self.factor.diagonal().tolist()
        if pivots and (min(pivots) < LEAST_PIVOT or max(pivots) > LARGEST_PIVOT):
            return False
        if not len(self._others):
            return True
        left = float(np.abs(self._others.dot(self.J)).max())
        return left <= VANISHES * float(np.abs(self.J).max())

    def errors(self) -> FloatArray:
        """Errors in position of the rows R, (r,)."""
        errors: FloatArray = self._T.dot(self._evaluator.errors())
        return errors

    def drift(self) -> tuple[float, float]:
        """Largest error in position, and largest velocity, of the rows R."""
        self.evaluate()
        both: list[list[float]] = [each.tolist() for each in (self.errors(), self.R.dot(self._qvel))]
        gap, rate = (max(map(abs, each), default=0.0) for each in both)
        return gap, rate

    def generalised(self, force: FloatArray) -> FloatArray:
        """Generalised forces of the latches, (nv,).

        Args:
            force: All other generalised forces less the bias, (nv,).
        """
        self.evaluate()
        self.y = -solved(self.factor, self.response.dot(force) + self.gamma)
        generalised: FloatArray = self.y.dot(self.R)
        return generalised

    def push(self) -> None:
        """Add the generalised forces of the latches to ``data.qfrc_applied``, which holds all other applied forces."""
        if self._data is not self._seen:
            self._ctrl[:] = self._seen_ctrl
        mujoco.mj_fwdActuation(self._model, self._data)
        force = self._passive - self._bias
        force += self._actuator
        force += self._applied
        self._applied += self.generalised(force)


def solved(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Solution x of F F^T x = right with a lower triangular F."""
    if not len(factor):
        return right.copy()
    solution: FloatArray = _lapack()[1](factor, right, 1)[0]
    return solution


@cache
def _lapack() -> tuple[Any, Any]:
    """LAPACK's Cholesky factorisation and solver; NumPy's functions cost several times as much for small matrices."""
    from scipy.linalg.lapack import dpotrf, dpotrs  # a third of a second to import

    return dpotrf, dpotrs
