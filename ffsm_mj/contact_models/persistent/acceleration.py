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
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.linear_systems import least_norm_solution
from ffsm_mj.contact_models.persistent.point_rows import ContactRows
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, CANCELLED

CLEARLY = 10.0
"""Forces and second rates of gaps that exceed their rounding by this factor are not rounding."""
IMMOVABLE = CANCELLED
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
        self._held: dict[tuple[int, ...], FloatArray] = {}

    @property
    def rounding(self) -> list[float]:
        """Rounding of each gap'', m/s^2, (k,): a share of its largest term. Not needed in the stages of a step."""
        if self._rounding is None:
            rows = self.rows
            products = np.abs(rows.response * self._force).max(axis=1, initial=0.0).tolist()
            terms = zip(products, rows.gamma.tolist(), rows.scales, strict=True)
            self._rounding = [
                ACCELERATION_M_S2 + ACCELERATION * max(each, abs(gamma), scale) for each, gamma, scale in terms
            ]
        return self._rounding

    @property
    def _movable(self) -> list[int]:
        """Contacts that a normal force can accelerate."""
        return [i for i, parted in enumerate(self._G.diagonal().tolist()) if parted > IMMOVABLE]

    def own_acceleration(self, forces: FloatArray) -> FloatArray:
        """Contribution of each force to gap'' at its own contact, m/s^2, (k,)."""
        own_acceleration: FloatArray = forces * self._G.diagonal()
        return own_acceleration

    def pushing(self, forces: FloatArray) -> list[int]:
        """Contacts whose force accelerates their gap by more than rounding."""
        pushes = zip(self.own_acceleration(forces).tolist(), self.rounding, strict=True)
        return [i for i, (push, rounding) in enumerate(pushes) if push > rounding]

    def bilateral_forces(self, which: Sequence[int]) -> FloatArray:
        """Forces that keep gap'' = 0 at some contacts, of either sign, N, (k,); zero at the others."""
        held = tuple(which)
        forces = self._held.get(held)
        if forces is None:
            forces = self._held[held] = self._bilateral_forces(held)
        return forces

    def _bilateral_forces(self, which: tuple[int, ...]) -> FloatArray:
        k = len(self.free)
        if len(which) == k > 1:
            # Redundant contacts make G singular; the least-norm solution is one of the force distributions.
            return least_norm_solution(self._G, -self.free)
        forces = np.zeros(k)
        if len(which) == 1:
            i = which[0]
            forces[i] = -self.free.item(i) / self._G.item(i, i)
        elif which:
            picked = np.array(which)
            forces[picked] = least_norm_solution(self._G[picked[:, None], picked], -self.free[picked])
        return forces

    def validity(self, which: Sequence[int]) -> float:
        """Margin by which some active contacts push and gap'' = 0 everywhere, m/s^2; negative where it does not hold."""
        forces = self.bilateral_forces(which)
        pushes, opens = self.own_acceleration(forces).tolist(), self.gap_accelerations(forces).tolist()
        allowed = [CLEARLY * rounding for rounding in self.rounding]
        each = zip(pushes, opens, allowed, strict=True)
        return float(min([min(push + limit, limit - abs(rate)) for push, rate, limit in each]))

    def stage(self, qvel: FloatArray) -> tuple[Stage, FloatArray]:
        """A stage in which all contacts are active, and the generalised forces, (nv,)."""
        forces = self.bilateral_forces(range(len(self.free)))
        generalised = forces.dot(self.rows.J)
        return Stage(self.rows, forces, generalised * qvel), generalised

    def gap_accelerations(self, forces: FloatArray) -> FloatArray:
        """Gap'' under given forces, m/s^2, (k,)."""
        opening: FloatArray = self.free + self._G.dot(forces)
        return opening

    def unilateral_forces(self, expected: Sequence[int] = ()) -> FloatArray:
        """Solution of the complementarity problem, N, (k,); redundant contacts share the load by least norm.

        Where every contact either pushes or opens by more than rounding, the set of those that push is unique and the forces
        are those that hold it: they do not depend on how it was found.

        Args:
            expected: Contacts that probably carry force, such as the active set of the last step; tried first.
        """
        forces, movable = np.zeros(len(self.free)), self._movable
        if len(movable) == 1:
            i = movable[0]
            forces[i] = max(0.0, -self.free.item(i) / self._G.item(i, i))
            return forces
        for which in dict.fromkeys((tuple(expected), tuple(movable))):
            if self._is_strict(which, movable):
                return self.bilateral_forces(which)
        if movable:
            A, w = self._mass_weighted(movable)
            forces[movable] = least_norm(A, project(A, w))
        which = tuple(self.pushing(forces))
        return self.bilateral_forces(which) if self._is_strict(which, movable) else forces

    def _is_strict(self, which: tuple[int, ...], movable: Sequence[int]) -> bool:
        """Whether the forces that hold some contacts push by more than rounding, and the others open by more than it."""
        forces = self.bilateral_forces(which)
        pushes, opens = self.own_acceleration(forces).tolist(), self.gap_accelerations(forces).tolist()
        for i in movable:
            allowed = CLEARLY * self.rounding[i]
            if opens[i] <= allowed and not (i in which and pushes[i] > allowed and opens[i] >= -allowed):
                return False
        return all(opens[i] <= CLEARLY * self.rounding[i] for i in which)

    def _mass_weighted(self, which: list[int]) -> tuple[FloatArray, FloatArray]:
        """The problem in the form of a plastic impact: A A^T = G, A w = free, with A = J L^-T and M = L L^T."""
        L, rows = np.linalg.cholesky(self._M()), self.rows
        # With closed loops, J Mc^-1 = A L^-1 gives the A of the problem in which they are held.
        A = np.linalg.solve(L, rows.J[which].T).T if rows.loop_rates is None else rows.response[which] @ L
        return A, np.linalg.lstsq(A, self.free[which], rcond=None)[0]
