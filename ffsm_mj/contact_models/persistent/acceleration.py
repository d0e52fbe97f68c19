"""Contact forces at the acceleration level: no closed gap at rest may accelerate into overlap.

With M the mass matrix, f all forces except those of the contacts, and gap'' = J qddot + gamma,

    gap'' = free + G lambda,   G = J M^-1 J^T,   free = J M^-1 f + gamma

Active contacts have gap'' = 0. The active set follows from the linear complementarity problem 0 <= lambda _|_ gap'' >= 0
(Featherstone, *Rigid Body Dynamics Algorithms*, ch. 11). G is symmetric positive semidefinite, so the problem is convex: the
accelerations are unique even if contacts are redundant and their forces are not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.persistent.rows import ContactRows
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, CANCELLED, RANK

_IMMOVABLE = CANCELLED
"""A contact with a diagonal element of G below this, 1/kg, cannot move along its normal: it is never active."""


class ContactAcceleration:
    """The contact problem at one state.

    Attributes:
        rows: Jacobians of the contact points.
        free: gap'' without contact forces, m/s^2, (k,).
    """

    def __init__(self, M: Callable[[], FloatArray], rows: ContactRows, force: FloatArray) -> None:
        """Set up the problem.

        Args:
            M: Returns the mass matrix, (nv, nv); called only if needed.
            rows: Jacobians of the contact points.
            force: Generalised forces without the contact forces, less the bias, (nv,).
        """
        self._M, self.rows, self._G, self._force = M, rows, rows.G, force
        self.free = rows.response.dot(force) + rows.gamma
        self._rounding: list[float] | None = None

    @property
    def rounding(self) -> list[float]:
        """Rounding of each gap'', m/s^2, (k,): a share of its largest term. Not needed in the stages of a step."""
        if self._rounding is None:
            rows = self.rows
            terms = zip((rows.response * self._force).tolist(), rows.gamma.tolist(), rows.states, strict=True)
            self._rounding = [
                ACCELERATION_M_S2 + ACCELERATION * max(*map(abs, each), abs(gamma), here.scale)
                for each, gamma, here in terms
            ]
        return self._rounding

    @property
    def _movable(self) -> list[int]:
        """Contacts that a normal force can accelerate."""
        return [i for i, parted in enumerate(self._G.diagonal().tolist()) if parted > _IMMOVABLE]

    def own_acceleration(self, forces: FloatArray) -> FloatArray:
        """Contribution of each force to gap'' at its own contact, m/s^2, (k,)."""
        own_acceleration: FloatArray = forces * self._G.diagonal()
        return own_acceleration

    def bilateral_forces(self, which: Sequence[int]) -> FloatArray:
        """Forces that keep gap'' = 0 at some contacts, of either sign, N, (k,); zero at the others."""
        forces = np.zeros(len(self.free))
        if len(which) == 1:
            i = which[0]
            forces[i] = -self.free.item(i) / self._G.item(i, i)
        elif len(which):
            # Redundant contacts make G singular; the least-norm solution is one of the force distributions.
            picked = np.asarray(which)
            forces[picked] = np.linalg.lstsq(self._G[np.ix_(picked, picked)], -self.free[picked], rcond=RANK)[0]
        return forces

    def gap_accelerations(self, forces: FloatArray) -> FloatArray:
        """Gap'' under given forces, m/s^2, (k,)."""
        opening: FloatArray = self.free + self._G.dot(forces)
        return opening

    def unilateral_forces(self) -> FloatArray:
        """Solution of the complementarity problem, N, (k,); redundant contacts share the load by least norm."""
        forces, movable = np.zeros(len(self.free)), self._movable
        if len(movable) == 1:
            i = movable[0]
            forces[i] = max(0.0, -self.free.item(i) / self._G.item(i, i))
        elif movable:
            A, w = self._mass_weighted(movable)
            forces[movable] = least_norm(A, project(A, w))
        return forces

    def _mass_weighted(self, which: list[int]) -> tuple[FloatArray, FloatArray]:
        """The problem in the form of a plastic impact: A A^T = G, A w = free, with A = J L^-T and M = L L^T."""
        L = np.linalg.cholesky(self._M())
        A = np.linalg.solve(L, self.rows.J[which].T).T
        return A, np.linalg.lstsq(A, self.free[which], rcond=None)[0]
