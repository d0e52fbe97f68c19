"""Newton's law of impact with Coulomb friction, which the package refuses because it can create energy."""

from __future__ import annotations

import numpy as np

from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.tolerances import SOLVED


def newton_with_friction(A, w, mu, e):
    """Velocity after, (n,), with u_n+ + e u_n- in place of u_n+; None if no solution is found."""
    u = A @ w
    shifted = u.copy()
    shifted[::3] *= 1.0 + np.asarray(e)
    contacts = CoulombProblem(A @ A.T, shifted, np.atleast_1d(mu), np.zeros(len(A) // 3), float(np.abs(u).max()))
    impulses, residual = coulomb(contacts)
    return w + A.T @ impulses.ravel() if residual <= SOLVED else None
