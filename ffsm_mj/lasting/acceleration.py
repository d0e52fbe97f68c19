"""Contact forces from accelerations: no gap that is closed and still may begin to close.

With M the mass matrix, f all forces but those of the contacts, and gap'' = J qddot + gamma,

    gap'' = free + G lambda,   G = J M^-1 J^T,   free = J M^-1 f + gamma

Held contacts have gap'' = 0. Which of the closed ones are held follows from 0 <= lambda, gap'' >= 0, complementary: a convex
problem, whose motion is unique even where contacts are redundant and their forces are not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.impact.laws import least_norm, project
from ffsm_mj.lasting.rows import Rows

_SHARE, _LEAST = 1e-10, 1e-12
"""What is rounding of a gap'': a share of its largest term, and in m/s^2."""
_IMMOVABLE = 1e-12
"""A contact whose G is this small, 1/kg, is between what cannot move along its normal: it is never held."""
_REDUNDANT = 1e-10


class Acceleration:
    """The problem at one state.

    Attributes:
        free: gap'' without contact forces, m/s^2, (k,).
    """

    def __init__(self, M: Callable[[], FloatArray], rows: Rows, force: FloatArray) -> None:
        """Set it up.

        Args:
            M: Gives the mass matrix, (nv, nv), where it is needed.
            rows: The contacts.
            force: All generalised forces but theirs, less the bias, (nv,).
        """
        self._M, self._rows, self._G, self._force = M, rows, rows.G, force
        self.free = rows.response.dot(force) + rows.gamma

    @cached_property
    def rounding(self) -> FloatArray:
        """Gap'' within this of zero is none, m/s^2, (k,): a share of its largest term. No stage of a step asks for it."""
        terms = np.abs(self._rows.response * self._force).max(axis=1)
        return np.asarray(_LEAST + _SHARE * np.maximum(terms, self._rows.scale))

    def eased(self, forces: FloatArray) -> FloatArray:
        """What each of some forces takes off the closing of its own gap, m/s^2, (k,)."""
        return np.asarray(forces * self._G.diagonal())

    def held(self, which: Sequence[int]) -> FloatArray:
        """Forces that keep the gap'' of some contacts at zero, pulling where they must, N, (k,); zero at the others."""
        forces = np.zeros(len(self.free))
        if len(which) == 1:
            i = which[0]
            forces[i] = -self.free[i] / self._G[i, i]
        elif len(which):
            picked = np.asarray(which)
            forces[picked] = np.linalg.lstsq(self._G[np.ix_(picked, picked)], -self.free[picked], rcond=_REDUNDANT)[0]
        return forces

    def opening(self, forces: FloatArray) -> FloatArray:
        """Gap'' under some forces, m/s^2, (k,)."""
        return np.asarray(self.free + self._G.dot(forces))

    def pushed(self) -> FloatArray:
        """Forces that only push, and let no gap close, N, (k,); where contacts are redundant a few of them bear all."""
        forces = np.zeros(len(self.free))
        movable = np.flatnonzero(self._G.diagonal() > _IMMOVABLE)
        if len(movable) == 1:
            i = int(movable[0])
            forces[i] = max(0.0, -self.free[i] / self._G[i, i])
        elif len(movable):
            A, w = self._mass_weighted(movable)
            forces[movable] = project(A, w)
        return forces

    def shared(self, forces: FloatArray) -> FloatArray:
        """Forces of the same effect that redundant contacts share evenly, N, (k,): those of least norm."""
        if np.count_nonzero(self._G.diagonal() > _IMMOVABLE) < 2:
            return forces
        movable = np.flatnonzero(self._G.diagonal() > _IMMOVABLE)
        out = forces.copy()
        out[movable] = least_norm(self._mass_weighted(movable)[0], forces[movable])
        return out

    def _mass_weighted(self, which: IntArray) -> tuple[FloatArray, FloatArray]:
        """The same problem as that of a plastic impact: A A^T = G, A w = free."""
        L = np.linalg.cholesky(self._M())
        A = np.linalg.solve(L, self._rows.J[which].T).T
        return A, np.linalg.lstsq(A, self.free[which], rcond=None)[0]
