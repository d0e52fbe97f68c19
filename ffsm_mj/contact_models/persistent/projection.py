"""Takes drift out of closed gaps without changing what is conserved.

Positions: q <- q - M^-1 J^T G^-1 gap, repeated. Velocities: the nearest in the metric of M with gap' = 0 and the momenta of
before, but for those that fixed bodies in contact may take.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.persistent.rows import ContactRows
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import momentum_matrix

GAP_M, RATE_M_S = 1e-11, 1e-10
"""Gaps and rates within these are left alone."""
_PASSES = 3
_REDUNDANT = 1e-10


def needs_projection(rows: ContactRows) -> bool:
    """Whether gaps or rates have drifted."""
    return any(abs(here.gap) > GAP_M or abs(here.rate) > RATE_M_S for here in rows.held)


def project(motion: Motion, rows_now: Callable[[], ContactRows], free: BoolArray, taken: FloatArray) -> None:
    """Close the gaps and stop their rates; positions and velocities current, and derived quantities after.

    Args:
        motion: What moves; what it stands for follows its positions and velocities.
        rows_now: Rows of what is closed at its state.
        free: Which components of (P, L about the origin) the joints leave free, (6,).
        taken: Wrenches about the world origin of the contacts with fixed bodies, rows of (force, moment), (k, 6).
    """
    model, data = motion.model, motion.data
    momentum = momentum_matrix(model, data, 0) @ data.qvel
    for _ in range(_PASSES):
        rows = rows_now()
        gaps = np.array([here.gap for here in rows.held])
        if np.abs(gaps).max() <= 0.01 * GAP_M:
            break
        mujoco.mj_integratePos(model, data.qpos, _nearest(model, data, rows.J, -gaps), 1.0)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        motion.follow()
    rows = rows_now()
    constraints, wanted = rows.J, np.zeros(len(rows.J))
    kept = _kept(free, taken)
    if len(kept):
        of_all = kept @ momentum_matrix(model, data, 0)
        constraints, wanted = np.vstack((rows.J, of_all)), np.append(wanted, kept @ momentum)
    data.qvel[:] += _nearest(model, data, constraints, wanted - constraints @ data.qvel)
    mujoco.mj_forward(model, data)


def _nearest(model: Any, data: Any, constraints: FloatArray, wanted: FloatArray) -> FloatArray:
    """The shortest change v in the metric of M with ``constraints v = wanted``, (nv,)."""
    response = np.empty_like(constraints)
    mujoco.mj_solveM(model, data, response, np.ascontiguousarray(constraints))
    # Rows of momenta and of gaps have units of their own; a row that nothing can change is left out.
    sizes = np.sqrt(np.einsum("ij,ij->i", response, constraints))
    scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    gram = scale[:, None] * (response @ constraints.T) * scale
    return np.asarray((scale * np.linalg.lstsq(gram, scale * wanted, rcond=_REDUNDANT)[0]) @ response)


def _kept(free: BoolArray, taken: FloatArray) -> FloatArray:
    """Combinations of the free components of (P, L) that no fixed body can change, rows, (m, 6)."""
    components = np.eye(6)[free]
    if not len(taken) or not len(components):
        return components
    _, sizes, directions = np.linalg.svd(taken[:, free])
    rank = int(np.count_nonzero(sizes > _REDUNDANT * sizes[0]))
    return np.asarray(directions[rank:] @ components)
