"""Rounding of the directions of slip, and what it changes.

Friction acts against the slip u. Velocities are known to their rounding d, 1e-12 (1 m/s + their terms), so the direction of
a slip is known to d / |u|: 1e-6 rad at 1e-6 m/s, as just before a stop. Its effect is first order: forces change by the
response to the turn.
"""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision
from ffsm_mj.contact_models.persistent.friction.solution import Solution
from ffsm_mj.tolerances import ACCELERATION

_LEAST_M_S = 1e-300
"""Keeps a quotient finite where a slip is exactly zero."""


def changes_by_turns(decision: FrictionalDecision, solution: Solution, slides: BoolArray) -> FloatArray:
    """Changes of the forces where the direction of each slip turns by its rounding, N, (k, 3, m) for m turns.

    Turns below ``ACCELERATION`` are left out: normals are not known any better.

    Args:
        decision: The points at their state.
        solution: Their forces in some modes.
        slides: Points that slide in these modes, (k,).
    """
    modes, rows = decision.here.modes, decision.rows
    # A point that goes straight on to its stop keeps the direction of an earlier slip.
    known_at = np.where(modes.straight, modes.directed_at, np.hypot(*rows.slips.T))
    points = np.flatnonzero(slides & (modes.mu > 0.0) & (rows.speed_rounding > ACCELERATION * known_at))
    if not len(points):
        return np.zeros((len(slides), 3, 0))
    changes = decision.problem.responses_to_turns(solution.kinds, solution.directions, points, solution.forces)
    # A slip that is no more than its rounding may have any direction.
    turns = np.minimum(rows.speed_rounding[points] / np.maximum(known_at[points], _LEAST_M_S), math.pi)
    return changes * turns
