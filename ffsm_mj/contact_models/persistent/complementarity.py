"""Contact forces without friction at the acceleration level: no closed gap at rest may accelerate into overlap.

With M the mass matrix, f all forces except those of the contacts, and gap'' = J qddot + gamma,

    gap'' = free + G lambda,   G = J M^-1 J^T,   free = J M^-1 f + gamma

Active contacts have gap'' = 0. The active set follows from the linear complementarity problem 0 <= lambda _|_ gap'' >= 0
(Featherstone, *Rigid Body Dynamics Algorithms*, ch. 11). G is symmetric positive semidefinite, so the problem is convex: the
accelerations are unique even if contacts are redundant and their forces are not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.tolerances import CANCELLED

if TYPE_CHECKING:
    from ffsm_mj._core.contacts import ContactAcceleration

CLEARLY = 10.0
"""Forces and second rates of gaps that exceed their rounding by this factor are not rounding."""
IMMOVABLE = CANCELLED
"""A contact with a diagonal element of G below this, 1/kg, cannot move along its normal: it is never active."""


def complementary_forces(
    problem: ContactAcceleration, M: Callable[[], FloatArray], expected: Sequence[int] = ()
) -> FloatArray:
    """Solution of the complementarity problem, N, (k,); redundant contacts share the load by least norm.

    Where every contact either pushes or opens by more than rounding, the set of those that push is unique and the forces
    are those that hold it: they do not depend on how it was found.

    Args:
        problem: The contacts.
        M: Returns the mass matrix, (nv, nv); called only if needed.
        expected: Contacts that probably carry force, such as the active set of the last step; tried first.
    """
    diagonal: list[float] = problem.rows.G.diagonal().tolist()
    forces, movable = np.zeros(len(diagonal)), [i for i, each in enumerate(diagonal) if each > IMMOVABLE]
    if len(movable) == 1:
        i = movable[0]
        forces[i] = max(0.0, -problem.free.item(i) / diagonal[i])
        return forces
    for which in dict.fromkeys((tuple(expected), tuple(movable))):
        if _is_strict(problem, which, movable):
            return problem.bilateral_forces(which)
    if movable:
        A, w = _mass_weighted(problem, M, movable)
        forces[movable] = least_norm(A, project(A, w))
    which = tuple(problem.pushing(forces))
    return problem.bilateral_forces(which) if _is_strict(problem, which, movable) else forces


def _is_strict(problem: ContactAcceleration, which: tuple[int, ...], movable: Sequence[int]) -> bool:
    """Whether the forces that hold some contacts push by more than rounding, and the others open by more than it."""
    forces = problem.bilateral_forces(which)
    pushes, opens = problem.own_acceleration(forces).tolist(), problem.gap_accelerations(forces).tolist()
    allowed = [CLEARLY * each for each in problem.rounding]
    for i in movable:
        if opens[i] <= allowed[i] and not (i in which and pushes[i] > allowed[i] and opens[i] >= -allowed[i]):
            return False
    return all(opens[i] <= allowed[i] for i in which)


def _mass_weighted(
    problem: ContactAcceleration, M: Callable[[], FloatArray], which: list[int]
) -> tuple[FloatArray, FloatArray]:
    """The problem in the form of a plastic impact: A A^T = G, A w = free, with A = J L^-T and M = L L^T."""
    L, rows = np.linalg.cholesky(M()), problem.rows
    # With closed loops, J Mc^-1 = A L^-1 gives the A of the problem in which they are held.
    A = np.linalg.solve(L, rows.J[which].T).T if rows.loop_rates is None else rows.response[which] @ L
    return np.asarray(A), np.asarray(np.linalg.lstsq(A, problem.free[which], rcond=None)[0])
