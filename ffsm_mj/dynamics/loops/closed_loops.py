"""Bilateral rows of one model that are held: their forces in a stage, and responses of the model with them.

They are those of the latches of further grasps, and of the equality constraints of the model files. With B the rows, f all
other generalised forces and B qddot + gamma = 0, the forces of the rows are

    lambda = -(B M^-1 B^T)^+ (B M^-1 f + gamma)

and the model responds to other forces as if its inverse mass matrix were Mc^-1 = M^-1 - M^-1 B^T (B M^-1 B^T)^+ B M^-1.

Rows may depend on each other. Combinations T that are independent, with T B M^-1 B^T T^T = 1, are found by an SVD and kept
as long as this matrix stays near 1 and the other combinations vanish. The motion is unique; forces are those of least norm.

Rows of coordinates that dry friction keeps at rest are held with them, in the stages of a step alone: a bounded force has no
impulse, so that impacts, and latches that close, do not see them.

Bilateral rows of a model: relative motions that vanish, as linear functions of the generalised velocity.

A source of rows says what is constrained in the bodies, joints and tendons of the logged system; bound to a model, which may
be another one that represents this system, it evaluates rows J with J qdot = 0, and their rates J qddot + gamma = 0.

Bilateral rows in mass-weighted coordinates at one state: rank, plastic impulse, other rows less these.

With M = L L^T and A = B L^-T = U diag(s) V^T, singular values below a share of the largest are zero: rows that depend on
others get impulses of least norm, and the motion is unique.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np

from ffsm_mj._core.loops import LoopStage
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import BoundLatch
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.state import fitting
from ffsm_mj.tolerances import RANK


class Rows(NamedTuple):
    """Rows at one state.

    Attributes:
        J: Constrained velocities as functions of the generalised velocity, (n, nv).
        gamma: Their rates at zero generalised acceleration, (n,).
    """

    J: FloatArray
    gamma: FloatArray


class BoundRows(Protocol):
    """Rows of one source in a model, at the state in its data; positions and velocities must be current."""

    @property
    def count(self) -> int:
        """Number of rows n."""

    def evaluate(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write the rows, (n, nv), and their rates at zero generalised acceleration, (n,)."""

    def errors(self) -> FloatArray:
        """Errors in position of the rows, (n,): m, or rad for a hinge that another one leads."""


class RowSource(Protocol):
    """What is constrained, in ids of the logged system."""

    @property
    def count(self) -> int:
        """Number of rows."""

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundRows:
        """Rows in a model.

        Args:
            model: MuJoCo model.
            data: Its data.
            bodies: Id in this model of each body of the logged system.
            dofs: Index in this model of each degree of freedom of the logged system.
        """


@dataclass(frozen=True)
class PlasticClosing:
    """Plastic impulse on bilateral rows.

    Attributes:
        impulses: Impulse along each row, of least norm, N s, (n,).
        change: Change of the generalised velocity, (nv,).
        loss_J: Kinetic energy lost.
        rank: Number of independent rows.
        least_ratio: Smallest singular value that counts over the largest: a small one says that the mechanism is nearly
            singular.
    """

    impulses: FloatArray
    change: FloatArray
    loss_J: float
    rank: int
    least_ratio: float


class MassWeightedRows:
    """Bilateral rows at one state.

    Attributes:
        rank: Number of independent rows.
    """

    def __init__(self, M: FloatArray, rows: FloatArray, rank: float = RANK) -> None:
        """Factorise the rows.

        Args:
            M: Mass matrix, (nv, nv).
            rows: Rows B, (n, nv).
            rank: Share of the largest singular value below which others are zero.
        """
        self.rows, self._L, self._rank = rows, np.linalg.cholesky(M), rank
        left, sizes, right = np.linalg.svd(np.linalg.solve(self._L, rows.T).T, full_matrices=False)
        self.rank = int(np.count_nonzero(sizes > rank * sizes.max(initial=0.0)))
        self._left, self._sizes, self._right = left[:, : self.rank], sizes[: self.rank], right[: self.rank]
        self._others = left[:, self.rank :]

    @property
    def least_ratio(self) -> float:
        """Smallest singular value that counts over the largest; 1 if nothing can move along the rows."""
        return float(self._sizes[-1] / self._sizes[0]) if self.rank else 1.0

    def independent(self) -> tuple[FloatArray, FloatArray]:
        """Combinations T of the rows with T B M^-1 B^T T^T = 1, (r, n), and orthonormal ones that vanish, (n - r, n)."""
        return (self._left / self._sizes).T, self._others.T

    def plastic(self, qvel: FloatArray) -> PlasticClosing:
        """Plastic impulse that stops the velocities of all rows."""
        stopped = (self._left.T @ (self.rows @ qvel)) / self._sizes
        impulses, loss = -self._left @ (stopped / self._sizes), 0.5 * float(stopped @ stopped)
        change: FloatArray = -np.linalg.solve(self._L.T, self._right.T @ stopped)
        return PlasticClosing(impulses, change, loss, self.rank, self.least_ratio)

    def change(self, speeds: FloatArray) -> FloatArray:
        """Least change of velocities, or accelerations, in the metric of M that takes some speeds from the rows, (nv,).

        Args:
            speeds: What to take from each row, (n,); combinations of rows that vanish lose nothing.
        """
        return np.asarray(-np.linalg.solve(self._L.T, self._right.T @ ((self._left.T @ speeds) / self._sizes)))

    def projected(self, directions: FloatArray) -> FloatArray:
        """Other rows J less what these hold, J (1 - M^-1 B^T (B M^-1 B^T)^+ B), (m, nv).

        With them and the same M, impacts are those of the system in which these rows are held: M^-1 times their transpose is
        Mc^-1 J^T, and they have the rates of J wherever the held rows do not move. Rows that are held are zero.
        """
        A = np.linalg.solve(self._L, directions.T).T
        left = without_rounding(A - (A @ self._right.T) @ self._right, np.linalg.norm(A, axis=1), self._rank)
        return np.asarray(left @ self._L.T)


def without_rounding(rows: FloatArray, terms: FloatArray, rank: float = RANK) -> FloatArray:
    """Rows in which larger ones cancel, with those that are only rounding of these set to zero, (m, n).

    Rows of contacts contain normals and poses, known to about ``RANK``: a row below this share of what cancels in it says
    nothing about the motion, while an impulse along it would be 1e10 times too large. No admissible motion changes the gap
    of such a contact, and it takes no part in impacts.

    Args:
        rows: The rows, (m, n).
        terms: Norms of what cancels in each of them, (m,).
        rank: Share of these to which the rows are known.
    """
    cancelled = np.linalg.norm(rows, axis=1) <= rank * terms
    return np.where(cancelled[:, None], 0.0, rows) if cancelled.any() else rows


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
        body_ids = range(model.nbody) if bodies is None else bodies
        dof_ids = range(model.nv) if dofs is None else dofs
        self._bound, self._resting = (
            [source.bind(model, data, body_ids, dof_ids) for source in some] for some in (self.sources, resting)
        )
        ends = np.cumsum([0, *(bound.count for bound in self._bound)]).tolist()
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
        return np.concatenate([bound.errors() for bound in self._bound])

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
        for i, bound in enumerate(self._resting, self.count):
            bound.evaluate(J[i : i + 1], np.empty(1))
        return MassWeightedRows(mass_matrix(self._model, self._data), J, self._rank)

    def _combine(self, combinations: tuple[FloatArray, FloatArray]) -> None:
        T, others = (np.ascontiguousarray(combination) for combination in combinations)
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
        stage = self.evaluated()
        return stage.R, stage.errors()

    def drift(self) -> tuple[float, float]:
        """Largest error in position, and largest velocity, of these combinations."""
        return self.evaluated().drift()

    def response(self, J: FloatArray) -> FloatArray:
        """J Mc^-1, (m, nv): accelerations by forces along other rows, with these held."""
        response, stage = np.empty_like(J), self.evaluated()
        if len(J):
            mujoco.mj_solveM(self._model, self._data, response, J)
            response -= _solved(stage.factor, stage.R.dot(response.T)).T.dot(stage.response)
        return response

    def acceleration(self) -> FloatArray:
        """Generalised acceleration -M^-1 B^T (B M^-1 B^T)^+ gamma that keeps the rates of the rows at zero, (nv,)."""
        stage = self.evaluated()
        return np.asarray(-_solved(stage.factor, stage.gamma).dot(stage.response))

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
