"""Impacts of a model with closed loops: rows of the contacts less what the loops hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import RANK

Constrained = Callable[[FloatArray], FloatArray]
"""Rows of velocities less what closed loops hold, (m, nv); see ``Motion.constrained`` in :mod:`ffsm_mj.dynamics.motion`."""


def with_loops(J: FloatArray, qvel: FloatArray, constrained: Constrained | None) -> tuple[FloatArray, FloatArray]:
    """Rows and velocities of an impact problem in which loops stay closed.

    Rates of the loops drift by up to 1e-10 m/s before they are projected. The velocities returned have the speeds at the
    contacts that were seen there, so that a contact that approaches is one for the impact law too.

    Args:
        J: Rows of the contacts, (m, nv).
        qvel: Velocities before, (nv,).
        constrained: Rows less what the loops hold; None without loops.
    """
    if constrained is None:
        return J, qvel
    held = constrained(J)
    drift = (J - held) @ qvel
    return held, qvel + np.linalg.lstsq(held, drift, rcond=RANK)[0]
