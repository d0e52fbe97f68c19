"""Drift projection: returns closed contacts to gap 0, and accounts for the energy and momentum this changes.

Constraints are enforced at the acceleration level, so rounding and truncation error make gaps drift; projection onto the
position and velocity constraints is the standard remedy (Hairer & Wanner, *Solving ODEs II*, sec. VII.2).
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.exchange import Shares
from ffsm_mj.contact_models.persistent.point_rows import FrictionalRows
from ffsm_mj.contact_models.state_projection import StateProjection
from ffsm_mj.dynamics.projection import ClosedRows, needs_projection


class DriftProjection:
    """Projects out the drift of the closed contacts of a scene."""

    def __init__(self, scene: Scene, closed: ActiveContactSet) -> None:
        """Bind to the closed contacts."""
        self._system, self._active_set, self._projection = scene.system, closed, StateProjection(scene)

    def remove_drift(self) -> Exchange | None:
        """Project the state in ``data`` at the start of a step if needed; returns the energy and momentum this changed."""
        closed = self._active_set
        if not closed.contact_points or not needs_projection(*drift_of(closed)):
            return None
        contact_points, motion = closed.contact_points, closed.motion
        outside = Shares.of(self._system, contact_points, motion.grasped_bodies).outside != 0.0
        taken = unit_wrenches(closed, outside.any(axis=0))
        return self._projection.apply(motion, lambda: closed_rows(closed), taken, outside.any(axis=1))


def drift_of(closed: ActiveContactSet) -> tuple[float, float, float]:
    """Largest gap of the closed contact points, m, gap rate, m/s, and slip along a tangent that is drift, m/s."""
    rows = closed.decide().rows
    slip = rows.largest_slip(closed.modes.of(closed.contact_points).drifts) if isinstance(rows, FrictionalRows) else 0.0
    return rows.extremes.gap, rows.extremes.rate, slip


def closed_rows(closed: ActiveContactSet) -> ClosedRows:
    """Rows of all closed contact points at the current state, as a projection needs them."""
    every = closed.decide().rows
    if not isinstance(every, FrictionalRows):
        return ClosedRows(every.gaps, every.rates, every.J, np.empty((0, closed.motion.model.nv)))
    J = every.J.reshape(len(closed.contact_points), 3, -1)
    sticking = J[closed.modes.of(closed.contact_points).drifts, 1:]
    return ClosedRows(every.gaps, every.rates, J[:, 0], sticking.reshape(-1, J.shape[2]))


def unit_wrenches(closed: ActiveContactSet, which: BoolArray) -> FloatArray:
    """Wrenches about the world origin of unit forces on geom b, (m, 6), at some of the closed contact points, (k,).

    Along the normals, and at points whose slip is drift along two tangents.
    """
    points = [contact for contact, taken in zip(closed.contact_points, which.tolist(), strict=True) if taken]
    states = [contact.feature.at(closed.data) for contact in points]
    forces = [
        (here.point, along)
        for here, drifts in zip(states, closed.modes.of(tuple(points)).drifts.tolist(), strict=True)
        for along in (here.normal, *(tangents(here.normal) if drifts else ()))
    ]
    return np.array([np.concatenate((along, np.cross(point, along))) for point, along in forces]).reshape(-1, 6)
