"""Contact points with friction at one state, under given forces and in given modes."""

from __future__ import annotations

from typing import NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.friction.modes import PointModes
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.rows import ContactPoint, FrictionalRows


class FrictionState(NamedTuple):
    """What stages and decisions need of k contact points at one state.

    Attributes:
        contact_points: Pairs and features.
        rows: Their rows.
        force: Generalised forces without the contact forces, less the bias, (nv,).
        modes: Their modes in the current step.
        problem: Their problem of accelerations.
    """

    contact_points: tuple[ContactPoint, ...]
    rows: FrictionalRows
    force: FloatArray
    modes: PointModes
    problem: FrictionProblem

    @classmethod
    def of(
        cls, contact_points: tuple[ContactPoint, ...], rows: FrictionalRows, force: FloatArray, modes: PointModes
    ) -> FrictionState:
        """Set up the problem; see the attributes."""
        b = rows.response.dot(force)
        b += rows.gamma
        problem = FrictionProblem(rows.G, b, modes.mu, modes.structures, rows.held)
        return cls(contact_points, rows, force, modes, problem)
