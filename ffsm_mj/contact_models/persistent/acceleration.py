"""Contact forces from accelerations: no gap that is closed and still may begin to close.

With M the mass matrix, f all forces but those of the contacts, and gap'' = J qddot + gamma,

    gap'' = free + G lambda,   G = J M^-1 J^T,   free = J M^-1 f + gamma

Held contacts have gap'' = 0. Which of the closed ones are held follows from 0 <= lambda, gap'' >= 0, complementary: a convex
problem, whose motion is unique even where contacts are redundant and their forces are not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.persistent.rows import ContactRows

_SHARE, _LEAST = 1e-10, 1e-12
"""What is rounding of a gap'': a share of its largest term, and in m/s^2."""
_IMMOVABLE = 1e-12
"""A contact whose G is this small, 1/kg, is between what cannot move along its normal: it is never held."""
_REDUNDANT = 1e-10


class Acceleration:
    """The problem at one state.

    Attributes:
        rows: The contacts.
        free: gap'' without contact forces, m/s^2, (k,).
    """

    def __init__(self, M: Callable[[], FloatArray], rows: ContactRows, force: FloatArray) -> None:
        """Set it up.

        Args:
            M: Gives the mass matrix, (nv, nv), where it is needed.
            rows: The contacts.
            force: All generalised forces but theirs, less the bias, (nv,).
        """
        self._M, self.rows, self._G, self._force = M, rows, rows.G, force
        self.free = rows.response.dot(force) + rows.gamma
        self._rounding: list[float] | None = None

    @property
    def rounding(self) -> list[float]:
        """Gap'' within this of zero is none, m/s^2, (k,): a share of its largest term. No stage of a step asks for it."""
        if self._rounding is None:
            rows = self.rows
            terms = zip((rows.response * self._force).tolist(), rows.gamma.tolist(), rows.held, strict=True)
            self._rounding = [_LEAST + _SHARE * max(*map(abs, each), abs(gamma), here.scale) for each, gamma, here in terms]
        return self._rounding

    @property
    def _movable(self) -> list[int]:
        """Contacts that a force can part."""
        return [i for i, parted in enumerate(self._G.diagonal().tolist()) if parted > _IMMOVABLE]

    def eased(self, forces: FloatArray) -> FloatArray:
        """What each of some forces takes off the closing of its own gap, m/s^2, (k,)."""
        eased: FloatArray = forces * self._G.diagonal()
        return eased

    def held(self, which: Sequence[int]) -> FloatArray:
        """Forces that keep the gap'' of some contacts at zero, pulling where they must, N, (k,); zero at the others."""
        forces = np.zeros(len(self.free))
        if len(which) == 1:
            i = which[0]
            forces[i] = -self.free.item(i) / self._G.item(i, i)
        elif len(which):
            picked = np.asarray(which)
            forces[picked] = np.linalg.lstsq(self._G[np.ix_(picked, picked)], -self.free[picked], rcond=_REDUNDANT)[0]
        return forces

    def opening(self, forces: FloatArray) -> FloatArray:
        """Gap'' under some forces, m/s^2, (k,)."""
        opening: FloatArray = self.free + self._G.dot(forces)
        return opening

    def pushed(self) -> FloatArray:
        """Forces that only push, and let no gap close, N, (k,); redundant contacts share them evenly: by least norm."""
        forces, movable = np.zeros(len(self.free)), self._movable
        if len(movable) == 1:
            i = movable[0]
            forces[i] = max(0.0, -self.free.item(i) / self._G.item(i, i))
        elif movable:
            A, w = self._mass_weighted(movable)
            forces[movable] = least_norm(A, project(A, w))
        return forces

    def _mass_weighted(self, which: list[int]) -> tuple[FloatArray, FloatArray]:
        """The same problem as that of a plastic impact: A A^T = G, A w = free."""
        L = np.linalg.cholesky(self._M())
        A = np.linalg.solve(L, self.rows.J[which].T).T
        return A, np.linalg.lstsq(A, self.free[which], rcond=None)[0]
