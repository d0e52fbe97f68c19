"""Latches that are held between bodies of one model: their forces in a stage, and responses of the model with them.

With B the rows of the latches, f all other generalised forces and B qddot + gamma = 0, the forces of the rows are

    lambda = -(B M^-1 B^T)^+ (B M^-1 f + gamma)

and the model responds to other forces as if its inverse mass matrix were Mc^-1 = M^-1 - M^-1 B^T (B M^-1 B^T)^+ B M^-1.

Rows may depend on each other. Combinations T that are independent, with T B M^-1 B^T T^T = 1, are found by an SVD and kept
as long as this matrix stays near 1 and the other combinations vanish. The motion is unique; forces are those of least norm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.loops import LoopStage
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.loops.latch_rows import LatchRowEvaluator, LatchRows
from ffsm_mj.dynamics.loops.mass_weighted import MassWeightedRows, PlasticClosing
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.state import fitting


class ClosedLoops:
    """Closed latches of a model, at the state in its data.

    Attributes:
        latches: The latches.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        latches: Sequence[LatchedBodies],
        bodies: Sequence[int] | None = None,
        seen: Any = None,
    ) -> None:
        """Hold some latches, at least one.

        Args:
            model: MuJoCo model.
            data: Its data.
            latches: The latches.
            bodies: Id in this model of each body that the latches name; None: they name those of this model.
            seen: Data of the logged system, which has the efforts; None: ``data``.
        """
        self._model, self._data, self.latches = model, data, tuple(latches)
        ids = range(model.nbody) if bodies is None else bodies
        self._evaluator = LatchRowEvaluator(model, data, self.latches, ids)
        self._stage = LoopStage(model, data, self.latches, ids, data if seen is None else seen)
        self._combinations: tuple[FloatArray, FloatArray] | None = None

    @property
    def parts(self) -> list[slice]:
        """Rows of each latch."""
        return self._evaluator.parts

    def rows(self) -> LatchRows:
        """All rows at the state in ``data``; positions and velocities must be current."""
        return self._evaluator.at_state()

    def errors(self) -> FloatArray:
        """Errors in position of all rows, m, (n,)."""
        return self._evaluator.errors()

    def weighted(self) -> MassWeightedRows:
        """The rows in mass-weighted coordinates, with their rank at this state."""
        return MassWeightedRows(mass_matrix(self._model, self._data), self.rows().J)

    def plastic(self) -> PlasticClosing:
        """Plastic impulse that stops the velocities of all rows at the state in ``data``, which is not changed."""
        return self.weighted().plastic(self._data.qvel)

    def choose(self) -> None:
        """Find independent combinations of the rows at the state in ``data``, if those of before do not fit any more."""
        if self._combinations is None or not self._stage.fits():
            self._combine(self.weighted().independent())

    def _combine(self, combinations: tuple[FloatArray, FloatArray]) -> None:
        T, others = (np.ascontiguousarray(each) for each in combinations)
        self._combinations = T, others
        self._stage.combine(T, others)

    def get_state(self) -> tuple[FloatArray, FloatArray] | None:
        """Combinations of the rows that are independent, (r, n), and of those that vanish, (n - r, n); None: not chosen."""
        return None if self._combinations is None else (self._combinations[0].copy(), self._combinations[1].copy())

    def set_state(self, state: Any) -> None:
        """Use combinations of the rows; None: they are chosen at the next step."""
        self._combinations = None
        if state is not None:
            T, others = state
            n = self.parts[-1].stop
            r = len(T)
            self._combine((fitting(T, (r, n), "ClosedLoops"), fitting(others, (n - r, n), "ClosedLoops")))

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores the combinations that :meth:`choose` changes."""
        kept = self._combinations

        def restore() -> None:
            if kept is not None:
                self._combine(kept)

        return restore

    def _evaluated(self) -> LoopStage:
        """The independent rows at the state in ``data``."""
        if self._combinations is None:
            self.choose()
        self._stage.evaluate()
        return self._stage

    def push(self) -> None:
        """Add the generalised forces of the latches to ``data.qfrc_applied``, which holds all other applied forces."""
        if self._combinations is None:
            self.choose()
        self._stage.push()

    @property
    def forces(self) -> FloatArray:
        """Forces of all rows, of least norm, by the last :meth:`push` or :meth:`generalised`, (n,)."""
        assert self._combinations is not None
        forces: FloatArray = self._stage.y.dot(self._combinations[0])
        return forces

    def generalised(self, force: FloatArray) -> FloatArray:
        """Generalised forces of the latches, (nv,).

        Args:
            force: All other generalised forces less the bias, (nv,); positions and velocities current.
        """
        return self._evaluated().generalised(force)

    def independent(self) -> tuple[FloatArray, FloatArray]:
        """Independent combinations of the rows, (r, nv), and their errors in position, (r,): those that motions change."""
        here = self._evaluated()
        return here.R, here.errors()

    def drift(self) -> tuple[float, float]:
        """Largest error in position, and largest velocity, of these combinations."""
        return self._evaluated().drift()

    def response(self, J: FloatArray) -> FloatArray:
        """J Mc^-1, (m, nv): accelerations by forces along other rows, with the latches held."""
        response, here = np.empty_like(J), self._evaluated()
        if len(J):
            mujoco.mj_solveM(self._model, self._data, response, J)
            response -= _solved(here.factor, here.R.dot(response.T)).T.dot(here.response)
        return response

    def acceleration(self) -> FloatArray:
        """Generalised acceleration -M^-1 B^T (B M^-1 B^T)^+ gamma that keeps the rates of the rows at zero, (nv,)."""
        here = self._evaluated()
        return np.asarray(-_solved(here.factor, here.gamma).dot(here.response))

    def projected(self, J: FloatArray) -> FloatArray:
        """Other rows less what the latches hold, (m, nv); see :meth:`MassWeightedRows.projected`."""
        return self.weighted().projected(J)

    def wrench(self, which: int, forces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point in m, force in N and torque about it in N m on body b of a latch, world axes, for forces of all rows."""
        return self._evaluator.wrench(which, forces)


def _solved(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Solution x of F F^T x = right with a lower triangular F."""
    if not len(factor):
        return right.copy()
    from scipy.linalg.lapack import dpotrs  # a third of a second to import

    return np.asarray(dpotrs(factor, right, 1)[0])
