"""How far rounding of a state changes the forces of persistent contact, as a log replay allows for it.

In rows and records a log replay allows for rounding of the state. Two evaluations of the state in a log differ by it where
the state is transferred, as with a grasped object, and at the end of a step. It changes forces by much more than rounding in
two ways: the direction of a slow slip turns, and so does the tilt of a rim that lies almost flat, or of two sides at a small
angle, whose contact point travels at the rate of the tilt over the tilt.

Friction acts against the slip u. Velocities are known to their rounding d, 1e-12 (1 m/s + their terms), so the direction of
a slip is known to d / |u|: 1e-6 rad at 1e-6 m/s, as just before a stop. Its effect is first order: forces change by the
response to the turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact.features.gap_function import tilt_rounding
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.decision import Decision
from ffsm_mj.contact_models.persistent.friction.modes import SLIDE
from ffsm_mj.contact_models.persistent.friction.problem import Solution
from ffsm_mj.contact_models.persistent.record import ContactRecord
from ffsm_mj.tolerances import (
    ACCELERATION,
    EVENT_TIME,
)

_LEAST_M_S = 1e-300
"""Keeps a quotient finite where a slip is exactly zero."""


def changes_by_turns(decision: Decision, solution: Solution, sliding: BoolArray) -> FloatArray:
    """Changes of the forces where the direction of each slip turns by its rounding, N, (k, 3, m) for m turns.

    Turns below ``ACCELERATION`` are left out: normals are not known any better.

    Args:
        decision: The points at their state.
        solution: Their forces in some modes.
        sliding: Points that slide in these modes, (k,).
    """
    modes, rows = decision.evaluation.modes, decision.rows
    # A point that goes straight on to its stop keeps the direction of an earlier slip.
    known_at = np.where(modes.straight, modes.directed_at, np.hypot(*rows.slips.T))
    points = np.flatnonzero(sliding & (modes.mu > 0.0) & (rows.speed_rounding > ACCELERATION * known_at))
    if not len(points):
        return np.zeros((len(sliding), 3, 0))
    changes = decision.problem.responses_to_turns(solution.kinds, solution.directions, points, solution.forces)
    # A slip that is no more than its rounding may have any direction.
    turns = np.minimum(rows.speed_rounding[points] / np.maximum(known_at[points], _LEAST_M_S), math.pi)
    return changes * turns


class RecordAccuracy:
    """Accuracy to which the state determines the fields of the records of one event; created before the event is applied."""

    def __init__(self, closed: ClosedContacts) -> None:
        """Evaluate what goes before the event, at the state in ``data``."""
        self._closed, stepped = closed, closed.contact_points and closed.stages
        self._tilt_share = max((_tilt_share(contact, closed) for contact in closed.pressing), default=0.0)
        self._before = _sum_of_sizes(_force_changes(closed, before=True)) if stepped else 0.0

    def fields(self, records: Iterable[Any]) -> dict[str, float]:
        """Accuracy by field of the records: that of the forces after the event is of the state in ``data``.

        Impulses have the rounding of tilts, and that of the time in the durations of steps. A point that has just stopped
        has no direction of slip but the one that it kept; a log does not have that one.
        """
        closed, pairs = self._closed, [record for record in records if isinstance(record, ContactRecord)]
        after = use = 0.0
        if closed.contact_points:
            after = _sum_of_sizes(_force_changes(closed))
            loads = zip(closed.contact_points, closed.decide().forces.tolist(), strict=True)
            limits = [contact.pair.mu * force for contact, force in loads if contact.pair.mu > 0.0 and force > 0.0]
            # Friction and its limit change by that force each; a share of 1 is the largest.
            use = min(2.0 * after / min(limits, default=math.inf), 1.0)
        impulses = [self._tilt_share * pair.impulse_N_s + EVENT_TIME * pair.time_s * pair.force_before_N for pair in pairs]
        fields = {"force_before_N": self._before, "force_after_N": after, "friction_N": after}
        return fields | {"friction_use": use, "impulse_N_s": max(impulses, default=0.0)}


def varied_forces(closed: ClosedContacts) -> Iterator[None]:
    """Turn each slip and each tilt at the state in ``data`` by its rounding, one after the other.

    The closed contacts have the forces of the turned direction between one step of the iteration and the next.
    """
    changes = _force_changes(closed) if closed.contact_points else np.empty(0)
    if not changes.size:
        return
    decision, estimates = closed.decide(), dict(closed.modes.estimates)
    # The shortcut of steady states would write the forces of the state without the variation.
    closed.steady.is_varied = True
    for change in np.moveaxis(changes, 2, 0):
        closed.solver.assume(decision.changed_by(change))
        yield
    closed.solver.assume(decision)
    closed.steady.is_varied = False
    # Shares with the least use start from the last ones: those of varied forces are no part of the run.
    closed.modes.estimates = estimates


def _force_changes(closed: ClosedContacts, *, before: bool = False) -> FloatArray:
    """Changes of the forces (n, t1, t2) by all turns, N, (k, 3, m).

    Args:
        closed: The closed contacts, at the state in ``data``.
        before: Whether of the forces in the modes of the step that ends there, or of those from there on.
    """
    decision, tilts = closed.decide(), _changes_by_tilts(closed)
    # The step ended in its own modes: those chosen at its end have other forces where a point has just stopped or slipped.
    if before:
        turns = changes_by_turns(decision, decision.in_present_modes, decision.evaluation.modes.sliding)
    else:
        turns = changes_by_turns(decision, decision.solution, (decision.kinds == SLIDE) & decision.slipping)
    return np.concatenate((turns, tilts), axis=2)


def _sum_of_sizes(changes: FloatArray) -> float:
    """Sum of the changes of forces, (k, 3, m), N."""
    # Rounding of the points is independent: in the worst case all of their effects add up.
    return float(np.linalg.norm(changes, axis=1).sum())


def _changes_by_tilts(closed: ClosedContacts) -> FloatArray:
    """Changes of the forces where each tilt turns by its rounding, N, (k, 3, m)."""
    decision, points = closed.decide(), closed.contact_points
    scales, shares = (
        decision.rows.scales,
        {i: _tilt_share(points[i], closed) for i in decision.pressing},
    )
    responses = [_tilt_response(decision, i, share * scales[i]) for i, share in shares.items() if share > 0.0]
    return np.stack(responses, axis=2) if responses else np.zeros((len(decision.contact_points), 3, 0))


def _tilt_share(contact: ContactPoint, closed: ClosedContacts) -> float:
    """Share to which the curvature terms at a point are known, 0 where normals are known no better."""
    # Poses that are transferred to the model of a grasp and back change by 1e-15 m; elsewhere a replay has the same bits.
    share = tilt_rounding(contact.feature, closed.data, moves=closed.motion.data is not closed.data)
    return share if share > ACCELERATION else 0.0


def _tilt_response(decision: Decision, point: int, acceleration: float) -> FloatArray:
    """Forces that cancel a second rate of the gap of one point in the modes of a decision, m/s^2 to N, (k, 3)."""
    count = len(decision.contact_points)
    solution, more = decision.solution, np.zeros(3 * count)
    more[3 * point] = acceleration
    return decision.problem.active_forces(solution.kinds).forces(more, solution.directions)
