"""Coulomb friction at the level of accelerations: forces of contacts of which some slide already.

Friction of a sliding contact follows its normal force along a given direction, -mu lambda_n u_t / |u_t|; that of the others
is opposed to their tangential acceleration, as that of an impulse is to the slip after it.
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb

_COMPLIANCE = 1e-9
"""Compliance of the contacts, as a share of the mean inverse mass: it shares forces among redundant ones."""


def coulomb_forces(G: FloatArray, b: FloatArray, mu: FloatArray, slips: FloatArray) -> tuple[FloatArray, float]:
    """Forces (n, t1, t2) of k closed contacts, N, (k, 3), and their residual; above SOLVED they are no solution.

    Args:
        G: Delassus matrix of rows (n, t1, t2) of each contact, 1/kg, (3k, 3k); G_nn > 0.
        b: Accelerations without contact forces, m/s^2, (3k,).
        mu: Coefficients of friction, (k,).
        slips: Slip velocities of sliding contacts, of any length, (k, 2); zero for those without slip.
    """
    scale, sizes = float(np.abs(b).max(initial=0.0)), np.hypot(slips[:, 0], slips[:, 1])
    if scale == 0.0:
        return np.zeros((len(mu), 3)), 0.0
    slides = sizes > 0.0
    # The column of the normal force of a sliding contact gets its friction too.
    along = np.eye(len(b))
    for i in np.flatnonzero(slides).tolist():
        along[3 * i + 1 : 3 * i + 3, 3 * i] = -mu[i] * (slips[i] / sizes[i])
    compliant = G @ along + _COMPLIANCE * float(G.diagonal()[::3].mean()) * np.eye(len(b))
    still = np.where(slides, 0.0, mu)
    contacts = CoulombProblem(compliant, b, still, np.zeros(len(mu)), scale, inertia=G)
    found, residual = coulomb(contacts)
    return (along @ found.ravel()).reshape(-1, 3), residual
