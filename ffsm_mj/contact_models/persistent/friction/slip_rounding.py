"""Rounding of the directions of slip, and what it changes.

Friction acts against the slip u. Velocities are known to their rounding d, 1e-12 (1 m/s + their terms), so the direction of
a slip is known to d / |u|: 1e-6 rad at 1e-6 m/s, as just before a stop. Two evaluations of the state in a log, such as a run
with a grasped object and its replay, to which that state is transferred, differ by that turn. Its effect is first order:
forces change by the response to the turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision
from ffsm_mj.contact_models.persistent.friction.point_modes import SLIDE
from ffsm_mj.contact_models.persistent.friction.solution import Solution
from ffsm_mj.tolerances import ACCELERATION

if TYPE_CHECKING:
    from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet


_LEAST_M_S = 1e-300
"""Keeps a quotient finite where a slip is exactly zero."""


def force_changes(decision: FrictionalDecision, solution: Solution, slides: BoolArray) -> FloatArray:
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


def force_accuracy(decision: FrictionalDecision) -> tuple[float, float]:
    """Accuracy to which the state determines the force of any pair in the modes of the step, and after the decision, N.

    A point that has just stopped has no direction of slip but the one that it kept; a log does not have that one.
    """
    modes, slips = decision.here.modes, decision.slipping
    before = force_changes(decision, decision.in_present_modes, modes.slides)
    after = force_changes(decision, decision.solution, (decision.kinds == SLIDE) & slips)
    return float(np.linalg.norm(before, axis=1).sum()), float(np.linalg.norm(after, axis=1).sum())


def turned_slips(active_set: ActiveContactSet) -> Iterator[None]:
    """Turn the direction of each slip at the state in ``data`` by its rounding, one after the other.

    The closed contacts have the forces of the turned direction between one step of the iteration and the next.
    """
    decision = active_set.decide() if active_set.has_friction else None
    if not isinstance(decision, FrictionalDecision):
        return
    solution, estimates = decision.solution, dict(active_set.modes.estimates)
    changes = force_changes(decision, solution, (decision.kinds == SLIDE) & decision.slipping)
    for change in np.moveaxis(changes, 2, 0):
        active_set.assume(decision.with_forces(solution.forces + change))
        yield
    active_set.assume(decision)
    active_set.modes.estimates = estimates
