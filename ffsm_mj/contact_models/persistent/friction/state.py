"""Contact points with friction at one state, under given forces and in given modes."""

from __future__ import annotations

from dataclasses import dataclass, field

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.friction.modes import PointModes
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.rows import ContactPoint, FrictionalRows


@dataclass(frozen=True, eq=False)
class FrictionState:
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
    problem: FrictionProblem = field(init=False)

    def __post_init__(self) -> None:
        """Set up the problem."""
        rows, modes = self.rows, self.modes
        b = rows.response.dot(self.force)
        b += rows.gamma
        object.__setattr__(self, "problem", FrictionProblem(rows.G, b, modes.mu, modes.structures))
