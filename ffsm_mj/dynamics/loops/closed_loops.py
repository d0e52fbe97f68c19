"""Latches that are held between bodies of one model: their forces in a stage, and responses of the model with them.

With B the rows of the latches, f all other generalised forces and B qddot + gamma = 0, the forces of the rows are

    lambda = -(B M^-1 B^T)^+ (B M^-1 f + gamma)

and the model responds to other forces as if its inverse mass matrix were Mc^-1 = M^-1 - M^-1 B^T (B M^-1 B^T)^+ B M^-1.

Rows may depend on each other. Combinations T that are independent, with T B M^-1 B^T T^T = 1, are found by an SVD and kept
as long as this matrix stays near 1 and the other combinations vanish. The motion is unique; forces are those of least norm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.loops.latch_rows import LatchRowEvaluator, LatchRows
from ffsm_mj.dynamics.loops.mass_weighted import MassWeightedRows, PlasticClosing
from ffsm_mj.dynamics.rigid_body import mass_matrix

_LEAST_PIVOT, _LARGEST_PIVOT = 0.25, 4.0
"""Bounds of the Cholesky pivots of T B M^-1 B^T T^T within which combinations T are kept."""
_VANISHES = 1e-9
"""Combinations of rows below this share of the largest element of the rows vanish still."""


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Independent rows R = T B at one state: J, M^-1 times their transpose, the factor of R M^-1 R^T, and rates."""

    place: bytes
    rows: LatchRows
    R: FloatArray
    response: FloatArray
    factor: FloatArray
    gamma: FloatArray


class ClosedLoops:
    """Closed latches of a model, at the state in its data.

    Attributes:
        latches: The latches.
    """

    def __init__(self, model: Any, data: Any, latches: Sequence[LatchedBodies], bodies: Sequence[int] | None = None) -> None:
        """Hold some latches, at least one.

        Args:
            model: MuJoCo model.
            data: Its data.
            latches: The latches.
            bodies: Id in this model of each body that the latches name; None: they name those of this model.
        """
        self._model, self._data, self.latches = model, data, tuple(latches)
        self._evaluator = LatchRowEvaluator(model, data, self.latches, bodies)
        self._qpos, self._qvel = data.qpos, data.qvel
        self._T: FloatArray | None = None
        self._others: FloatArray = np.empty((0, 0))
        self._last: _Reduced | None = None

    @property
    def parts(self) -> list[slice]:
        """Rows of each latch."""
        return self._evaluator.parts

    def rows(self) -> LatchRows:
        """All rows at the state in ``data``; positions and velocities must be current."""
        last = self._last
        if last is not None and last.place == self._place():
            return last.rows
        return self._evaluator.at_state()

    def errors(self) -> FloatArray:
        """Errors in position of all rows, m, (n,)."""
        return self._evaluator.errors()

    def independent(self) -> tuple[FloatArray, FloatArray]:
        """Independent combinations of the rows, (r, nv), and their errors in position, (r,): those that motions change."""
        R = self._reduced().R
        assert self._T is not None
        return R, self._T.dot(self._evaluator.errors())

    def weighted(self) -> MassWeightedRows:
        """The rows in mass-weighted coordinates, with their rank at this state."""
        return MassWeightedRows(mass_matrix(self._model, self._data), self.rows().J)

    def plastic(self) -> PlasticClosing:
        """Plastic impulse that stops the velocities of all rows at the state in ``data``, which is not changed."""
        return self.weighted().plastic(self._qvel)

    def choose(self) -> None:
        """Find independent combinations of the rows at the state in ``data``, if those of before do not fit any more."""
        if self._T is not None:
            last = self._reduced()
            pivots = last.factor.diagonal()
            fits = pivots.min(initial=1.0) >= _LEAST_PIVOT and pivots.max(initial=1.0) <= _LARGEST_PIVOT
            vanishing = np.abs(self._others.dot(last.rows.J)).max(initial=0.0)
            if fits and vanishing <= _VANISHES * np.abs(last.rows.J).max(initial=0.0):
                return
        self._T, self._others = self.weighted().independent()
        self._last = None

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores the combinations that :meth:`choose` changes."""
        kept = self._T, self._others

        def restore() -> None:
            self._T, self._others = kept
            self._last = None

        return restore

    def stage(self, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces of the rows, of least norm, (n,), and generalised forces, (nv,).

        Args:
            force: All other generalised forces less the bias, (nv,); positions and velocities current.
        """
        here = self._reduced()
        y = -_solve(here.factor, here.response.dot(force) + here.gamma)
        assert self._T is not None
        return y.dot(self._T), y.dot(here.R)

    def response(self, J: FloatArray) -> FloatArray:
        """J Mc^-1, (m, nv): accelerations by forces along other rows, with the latches held."""
        response, here = np.empty_like(J), self._reduced()
        if len(J):
            mujoco.mj_solveM(self._model, self._data, response, J)
            response -= _solve(here.factor, here.R.dot(response.T)).T.dot(here.response)
        return response

    def acceleration(self) -> FloatArray:
        """Generalised acceleration -M^-1 B^T (B M^-1 B^T)^+ gamma that keeps the rates of the rows at zero, (nv,)."""
        here = self._reduced()
        return np.asarray(-_solve(here.factor, here.gamma).dot(here.response))

    def projected(self, J: FloatArray) -> FloatArray:
        """Other rows less what the latches hold, (m, nv); see :meth:`MassWeightedRows.projected`."""
        return self.weighted().projected(J)

    def wrench(self, which: int, forces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point in m, force in N and torque about it in N m on body b of a latch, world axes, for forces of all rows."""
        return self._evaluator.wrench(which, forces)

    def _place(self) -> bytes:
        return bytes(self._qpos.tobytes() + self._qvel.tobytes())

    def _reduced(self) -> _Reduced:
        place = self._place()
        if self._last is not None and self._last.place == place:
            return self._last
        if self._T is None:
            self.choose()
        assert self._T is not None
        rows = self._evaluator.at_state()
        R: FloatArray = self._T.dot(rows.J)
        response = np.empty_like(R)
        if len(R):
            mujoco.mj_solveM(self._model, self._data, response, R)
        self._last = _Reduced(place, rows, R, response, np.linalg.cholesky(response.dot(R.T)), self._T.dot(rows.gamma))
        return self._last


def _solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of F F^T x = right with a lower triangular F."""
    if not len(factor):
        return right.copy()
    half = np.linalg.solve(factor, right)
    return np.asarray(np.linalg.solve(factor.T, half))
