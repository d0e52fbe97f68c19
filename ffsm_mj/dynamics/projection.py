"""Projection of a state onto closed contacts and closed loops, preserving the conserved momenta.

Positions: q <- q - M^-1 J^T G^-1 gap, repeated (Newton's method). Velocities: the nearest in the metric of M (the kinetic
energy norm) with gap' = 0, no slip of sticking points and unchanged momenta, except for components that fixed bodies in
contact can absorb. Independent rows of closed loops are joined to those of the contacts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import momentum_matrix
from ffsm_mj.tolerances import PROJECTED_GAP_M, PROJECTED_RATE_M_S, PROJECTED_SLIP_M_S, RANK

_PASSES = 3
"""Largest number of Newton's steps: from a drift of rounding and truncation they converge quadratically."""


class ClosedRows(NamedTuple):
    """What a projection needs of the closed contacts at one state.

    Attributes:
        gaps: Gap of each contact point, m.
        rates: Their rates, m/s.
        normals: Rows of the gap rates, (k, nv).
        sticking: Rows of the slip of points that stick or begin to slide, (m, nv). Slip is not integrable: only velocities
            are projected.
    """

    gaps: Sequence[float]
    rates: Sequence[float]
    normals: FloatArray
    sticking: FloatArray


def no_contacts(nv: int) -> ClosedRows:
    """Rows where no contact is closed.

    Args:
        nv: Number of degrees of freedom.
    """
    return ClosedRows((), (), np.empty((0, nv)), np.empty((0, nv)))


def needs_projection(gap: float, rate: float, slip: float) -> bool:
    """Whether the largest gap, gap rate or slip of a sticking point has drifted beyond tolerance."""
    return gap > PROJECTED_GAP_M or rate > PROJECTED_RATE_M_S or slip > PROJECTED_SLIP_M_S


def project(motion: Motion, rows_now: Callable[[], ClosedRows], free: BoolArray, projected: FloatArray) -> None:
    """Set gaps and gap rates to zero; positions and velocities must be current, derived quantities are updated.

    Args:
        motion: The current motion; the logged system follows its positions and velocities.
        rows_now: Returns the rows of the closed contacts at the current state; those of closed loops are added.
        free: Components of (P, L about the origin) that the joints leave free, (6,).
        projected: Unit wrenches about the world origin of contacts and latches with fixed bodies, rows of (force, moment),
            (k, 6).
    """
    model, data = motion.model, motion.data
    momentum = momentum_matrix(model, data, 0) @ data.qvel
    for _ in range(_PASSES):
        rows = rows_now()
        gaps, normals = np.array(rows.gaps), rows.normals
        if motion.loops is not None:
            loop_rows, errors = motion.loops.independent()
            gaps, normals = np.concatenate((gaps, errors)), np.vstack((normals, loop_rows))
        if np.abs(gaps).max() <= 0.01 * PROJECTED_GAP_M:
            break
        mujoco.mj_integratePos(model, data.qpos, _least_change(model, data, normals, -gaps), 1.0)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        motion.follow()
    rows = rows_now()
    # Velocities in one pass: the constraints are linear in them. The change is the nearest in the norm of the kinetic
    # energy.
    constraints = np.vstack((rows.normals, rows.sticking))
    if motion.loops is not None:
        constraints = np.vstack((constraints, motion.loops.independent()[0]))
    wanted = np.zeros(len(constraints))
    # The nearest velocities alone would change the momenta of the system by what no body outside could have taken.
    kept = _conserved_directions(free, projected)
    if len(kept):
        of_all = kept @ momentum_matrix(model, data, 0)
        constraints, wanted = np.vstack((constraints, of_all)), np.append(wanted, kept @ momentum)
    data.qvel[:] += _least_change(model, data, constraints, wanted - constraints @ data.qvel)
    mujoco.mj_forward(model, data)


def _least_change(model: Any, data: Any, constraints: FloatArray, wanted: FloatArray) -> FloatArray:
    """Smallest velocity change v in the metric of M with ``constraints v = wanted``, (nv,)."""
    response = np.empty_like(constraints)
    mujoco.mj_solveM(model, data, response, np.ascontiguousarray(constraints))
    # Momentum rows and gap rows have different units: equilibrate them. A row that no motion can change gets scale 0.
    sizes = np.sqrt(np.einsum("ij,ij->i", response, constraints))
    scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    gram = scale[:, None] * (response @ constraints.T) * scale
    return np.asarray((scale * np.linalg.lstsq(gram, scale * wanted, rcond=RANK)[0]) @ response)


def _conserved_directions(free: BoolArray, projected: FloatArray) -> FloatArray:
    """Linear combinations of the free components of (P, L) that no contact with a fixed body can change, rows, (m, 6)."""
    components = np.eye(6)[free]
    if not len(projected) or not len(components):
        return components
    _, sizes, directions = np.linalg.svd(projected[:, free])
    rank = int(np.count_nonzero(sizes > RANK * sizes[0]))
    return np.asarray(directions[rank:] @ components)
