"""Newton's law of impact with Coulomb friction, which the product refuses: it can create energy."""

from __future__ import annotations

import numpy as np

from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.tolerances import SOLVED


def newton_with_friction(A, w, mu, e):
    """Velocity after with u_n+ + e u_n- in place of u_n+; None where no solution is found, (n,)."""
    u = A @ w
    shifted = u.copy()
    shifted[::3] *= 1.0 + np.asarray(e)
    contacts = CoulombProblem(A @ A.T, shifted, np.atleast_1d(mu), np.zeros(len(A) // 3), float(np.abs(u).max()))
    impulses, residual = coulomb(contacts)
    return w + A.T @ impulses.ravel() if residual <= SOLVED else None
