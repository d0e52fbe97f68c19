"""Bilateral rows of one model that are held: their forces in a stage, and responses of the model with them.

They are those of the latches of further grasps, and of the equality constraints of the model files. With B the rows, f all
other generalised forces and B qddot + gamma = 0, the forces of the rows are

    lambda = -(B M^-1 B^T)^+ (B M^-1 f + gamma)

and the model responds to other forces as if its inverse mass matrix were Mc^-1 = M^-1 - M^-1 B^T (B M^-1 B^T)^+ B M^-1.

Rows may depend on each other. Combinations T that are independent, with T B M^-1 B^T T^T = 1, are found by an SVD and kept
as long as this matrix stays near 1 and the other combinations vanish. The motion is unique; forces are those of least norm.

Rows of coordinates that dry friction keeps at rest are held with them, in the stages of a step alone: a bounded force has no
impulse, so that impacts, and latches that close, do not see them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.loops import LoopStage
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import BoundLatch
from ffsm_mj.dynamics.loops.mass_weighted import MassWeightedRows, PlasticClosing
from ffsm_mj.dynamics.loops.rows import Rows, RowSource
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.state import fitting
from ffsm_mj.tolerances import RANK


class ClosedLoops:
    """Rows of a model that are held, at the state in its data.

    Attributes:
        sources: The sources of the rows, without those of coordinates at rest.
        parts: Rows of each of these sources.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        sources: Sequence[RowSource],
        *,
        bodies: Sequence[int] | None = None,
        dofs: Sequence[int] | None = None,
        seen: Any = None,
        rank: float = RANK,
        resting: Sequence[RowSource] = (),
    ) -> None:
        """Hold the rows of some sources, at least one.

        Args:
            model: MuJoCo model.
            data: Its data.
            sources: Latches and couplings, in ids of the logged system.
            bodies: Id in this model of each body of the logged system; None: it is this model.
            dofs: Index in this model of each degree of freedom of the logged system; None: it is this model.
            seen: Data of the logged system, which has the efforts; None: ``data``.
            rank: Share of the largest singular value of the rows in mass-weighted coordinates below which others vanish.
            resting: Sources of the rows of coordinates that dry friction keeps at rest.
        """
        self._model, self._data, self.sources, self._rank = model, data, tuple(sources), rank
        own_bodies = range(model.nbody) if bodies is None else bodies
        own_dofs = range(model.nv) if dofs is None else dofs
        self._bound, self._resting = (
            [each.bind(model, data, own_bodies, own_dofs) for each in some] for some in (self.sources, resting)
        )
        ends = np.cumsum([0, *(each.count for each in self._bound)]).tolist()
        self.parts = [slice(start, end) for start, end in pairwise(ends)]
        self._stage = LoopStage(model, data, [*self._bound, *self._resting], data if seen is None else seen, rank)
        self._combinations: tuple[FloatArray, FloatArray] | None = None

    @property
    def count(self) -> int:
        """Number of rows, without those of coordinates at rest."""
        return int(self.parts[-1].stop) if self.parts else 0

    def rows(self) -> Rows:
        """These rows at the state in ``data``; positions and velocities must be current."""
        J, gamma = np.empty((self.count, self._model.nv)), np.empty(self.count)
        for bound, part in zip(self._bound, self.parts, strict=True):
            bound.evaluate(J[part], gamma[part])
        return Rows(J, gamma)

    def errors(self) -> FloatArray:
        """Errors in position of all rows, m or rad, (n,)."""
        return np.concatenate([each.errors() for each in self._bound])

    def weighted(self) -> MassWeightedRows:
        """These rows in mass-weighted coordinates, with their rank at this state."""
        return MassWeightedRows(mass_matrix(self._model, self._data), self.rows().J, self._rank)

    def plastic(self) -> PlasticClosing:
        """Plastic impulse that stops the velocities of all rows at the state in ``data``, which is not changed."""
        return self.weighted().plastic(self._data.qvel)

    def begin_step(self) -> None:
        """Find independent combinations of the rows at the state in ``data``, if those of before do not fit any more.

        Raises:
            RunEnded: Their number is another one than before: the mechanism has become singular.
        """
        self.choose()
        self._stage.begin()

    def end_step(self) -> None:
        """Check the step that ends at the state in ``data``.

        Raises:
            RunEnded: The mechanism was singular within the step.
        """
        if self._stage.turns_over():
            raise self._singular()

    def choose(self) -> None:
        """The first part of :meth:`begin_step`."""
        if self._combinations is not None and self._fits():
            return
        combinations = self._of_stages().independent()
        if self._combinations is not None and len(combinations[0]) != len(self._combinations[0]):
            raise self._singular()
        self._combine(combinations)

    def _fits(self) -> bool:
        try:
            return self._stage.fits()
        except np.linalg.LinAlgError:
            return False

    def _singular(self) -> RunEnded:
        """End of a run in which rows that were independent depend on each other, as at the dead centre of a linkage."""
        ratio = self._of_stages().least_ratio
        return RunEnded(
            Outcome.SINGULAR_MECHANISM,
            f"the closed loops are singular at t = {self._data.time:.6g} s, as at a dead centre or change point: "
            f"least singular value {ratio:.1e} of the largest; the motion that follows is not unique",
        )

    def _of_stages(self) -> MassWeightedRows:
        """All rows in mass-weighted coordinates, with those of coordinates at rest."""
        J = np.concatenate((self.rows().J, np.zeros((len(self._resting), self._model.nv))))
        for i, each in enumerate(self._resting, self.count):
            each.evaluate(J[i : i + 1], np.empty(1))
        return MassWeightedRows(mass_matrix(self._model, self._data), J, self._rank)

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
            n, r = self.count + len(self._resting), len(T)
            self._combine((fitting(T, (r, n), "ClosedLoops"), fitting(others, (n - r, n), "ClosedLoops")))

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores the combinations that :meth:`choose` changes."""
        kept = self._combinations

        def restore() -> None:
            if kept is not None:
                self._combine(kept)

        return restore

    def evaluated(self) -> LoopStage:
        """The stage, with independent rows at the state in ``data``."""
        if self._combinations is None:
            self.choose()
        try:
            self._stage.evaluate()
        except np.linalg.LinAlgError:
            raise self._singular() from None
        return self._stage

    def push(self) -> None:
        """Add the generalised forces of the rows to ``data.qfrc_applied``, which holds all other applied forces."""
        if self._combinations is None:
            self.choose()
        try:
            self._stage.push()
        except np.linalg.LinAlgError:
            raise self._singular() from None

    @property
    def forces(self) -> FloatArray:
        """Forces of all rows, of least norm, by the last :meth:`push` or :meth:`generalised`, (n,)."""
        assert self._combinations is not None
        forces: FloatArray = self._stage.y.dot(self._combinations[0])
        return forces

    @property
    def holds(self) -> FloatArray:
        """Those of them that keep coordinates at rest, N or N m."""
        return self.forces[self.count :]

    @property
    def idle(self) -> FloatArray:
        """Holds on coordinates at rest without any effect, (m, k): those of combinations of the rows that vanish."""
        assert self._combinations is not None
        return self._combinations[1][:, self.count :]

    def generalised(self, force: FloatArray) -> FloatArray:
        """Generalised forces of the rows, (nv,).

        Args:
            force: All other generalised forces less the bias, (nv,); positions and velocities current.
        """
        return self.evaluated().generalised(force)

    def independent(self) -> tuple[FloatArray, FloatArray]:
        """Independent combinations of the rows, (r, nv), and their errors in position, (r,): those that motions change."""
        here = self.evaluated()
        return here.R, here.errors()

    def drift(self) -> tuple[float, float]:
        """Largest error in position, and largest velocity, of these combinations."""
        return self.evaluated().drift()

    def response(self, J: FloatArray) -> FloatArray:
        """J Mc^-1, (m, nv): accelerations by forces along other rows, with these held."""
        response, here = np.empty_like(J), self.evaluated()
        if len(J):
            mujoco.mj_solveM(self._model, self._data, response, J)
            response -= _solved(here.factor, here.R.dot(response.T)).T.dot(here.response)
        return response

    def acceleration(self) -> FloatArray:
        """Generalised acceleration -M^-1 B^T (B M^-1 B^T)^+ gamma that keeps the rates of the rows at zero, (nv,)."""
        here = self.evaluated()
        return np.asarray(-_solved(here.factor, here.gamma).dot(here.response))

    def projected(self, J: FloatArray) -> FloatArray:
        """Other rows less what these hold, (m, nv); see :meth:`MassWeightedRows.projected`."""
        return self.weighted().projected(J)

    def wrench(self, which: int, forces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point in m, force in N and torque about it in N m on body b of a latch, world axes.

        Args:
            which: Number of the latch among the sources.
            forces: Forces of all rows, (n,).
        """
        latch = self._bound[which]
        assert isinstance(latch, BoundLatch)
        return latch.wrench(forces[self.parts[which]])


def _solved(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Solution x of F F^T x = right with a lower triangular F."""
    if not len(factor):
        return right.copy()
    from scipy.linalg.lapack import dpotrs  # a third of a second to import

    return np.asarray(dpotrs(factor, right, 1)[0])
