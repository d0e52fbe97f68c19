"""Contact points at one state: gaps, rows of their rates, and resultants of the forces on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact_models.persistent.contact_points import SingleState
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.tolerances import RATE

if TYPE_CHECKING:
    from ffsm_mj._core.forces import HeldForces
    from ffsm_mj._core.rows import RowMemory


class Extremes(NamedTuple):
    """Extremes over some contact points.

    Attributes:
        inside: Smallest distance to the bounds of a feature, m.
        gap: Largest absolute gap, m.
        rate: Largest absolute rate of a gap, m/s.
        lowest: Smallest gap, m.
    """

    inside: float
    gap: float
    rate: float
    lowest: float


class PointRows:
    """Contact points at one state, in the coordinates of a motion: rows of normals and tangents.

    Row 3 i + j of J, (3k, nv), is axis j (n, t1, t2) of point i: gap' = J qdot and gap'' = J qddot + gamma along normals. A
    joint limit, and a pair without friction, has zero tangents. Arrays are made when they are needed.

    Attributes:
        groups: The points, by what is evaluated together.
        memory: Their rows.
        held: Linear problems for the forces that hold some of the rows; see ``friction/problem.py``.
        loop_rates: Part of gamma that is due to closed loops, m/s^2; None without any.
    """

    loop_rates: FloatArray | None = None

    def __init__(self, groups: Sequence[SingleState], memory: RowMemory) -> None:
        """Store the points; see the attributes."""
        self.groups, self.memory = groups, memory
        self.held: dict[tuple[bytes, bytes], HeldForces] = {}

    @cached_property
    def J(self) -> FloatArray:
        """Derivative of velocities at the contact points with respect to the generalised velocity."""
        return self.memory.array("J")

    @cached_property
    def gamma(self) -> FloatArray:
        """Part of their accelerations that does not depend on those of the joints, m/s^2."""
        return self.memory.array("gamma")

    @cached_property
    def response(self) -> FloatArray:
        """J M^-1, like J; with closed loops J Mc^-1."""
        return self.memory.array("response")

    @cached_property
    def G(self) -> FloatArray:
        """Delassus matrix J M^-1 J^T, 1/kg: accelerations per unit force; with closed loops J Mc^-1 J^T."""
        return self.memory.array("G")

    def close_loops(self, loops: ClosedLoops) -> None:
        """Take the accelerations of the points with closed loops; called before anything else is computed from the rows."""
        self.memory.unclosed = self.response.copy()
        self.response[:] = loops.response(self.J)
        self.loop_rates = self.J.dot(loops.acceleration())
        self.gamma[:] += self.loop_rates

    @cached_property
    def states(self) -> tuple[FeatureState, ...]:
        """Gap, rate, normal and contact points of each contact point."""
        return tuple([state for group in self.groups for state in group.states])

    @property
    def gaps(self) -> list[float]:
        """Gap of each contact point, m, (k,)."""
        return [gap for group in self.groups for gap in group.gaps]

    @property
    def rates(self) -> list[float]:
        """Rates of the gaps, m/s, (k,)."""
        return [rate for group in self.groups for rate in group.rates]

    @property
    def scales(self) -> list[float]:
        """Largest curvature term of the second rate of each gap, m/s^2, (k,)."""
        return [scale for group in self.groups for scale in group.scales]

    @property
    def insides(self) -> list[float]:
        """Distance of each contact point to the bounds of its feature, m, (k,)."""
        return [inside for group in self.groups for inside in group.insides]

    @property
    def extremes(self) -> Extremes:
        """Smallest distance to the bounds of a feature, largest gap and largest rate."""
        raise NotImplementedError

    def wrenches(self, forces: FloatArray) -> FloatArray:
        """Force, and moment about the world origin, on geom b of each group of points, for forces along the rows, (g, 6)."""
        return self.memory.resultants(forces)

    def resultant(self, part: slice, forces: FloatArray, friction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Resultant force of the points of one pair, N, its centre, m, and the mean unit normal, (3,) each.

        Args:
            part: The points.
            forces: Normal forces of all points, N, (k,).
            friction: Friction forces on geom b of all points, world axes, N, (k, 3).
        """
        raise NotImplementedError

    @cached_property
    def normals(self) -> FloatArray:
        """Normals from a to b, (k, 3); zero for a joint limit."""
        return _stacked([group.normals for group in self.groups])

    @cached_property
    def points(self) -> FloatArray:
        """Points of application of the forces, m, (k, 3)."""
        return _stacked([group.points for group in self.groups])

    @cached_property
    def axes(self) -> FloatArray:
        """Normal and tangents of each point, world axes, (k, 3, 3)."""
        return self.memory.array("axes")

    @cached_property
    def qvel(self) -> FloatArray:
        """Generalised velocity, (nv,)."""
        return self.memory.array("qvel")

    @cached_property
    def slips(self) -> FloatArray:
        """Slip velocities along the tangents, m/s, (k, 2)."""
        slips: FloatArray = self.J.dot(self.qvel).reshape(-1, 3)[:, 1:]
        return slips

    def largest_slip(self, which: BoolArray) -> float:
        """Largest slip of some points along a tangent, m/s; which, (k,)."""
        raise NotImplementedError

    @cached_property
    def speed_rounding(self) -> FloatArray:
        """Rounding of the slip speeds, m/s, (k,)."""
        terms = np.abs(self.J * self.qvel).reshape(len(self.axes), -1).max(axis=1, initial=0.0)
        return np.asarray(RATE * (1.0 + terms))

    def across(self, components: FloatArray) -> FloatArray:
        """Vectors with given components along the tangents of each point, world axes, (k, 3)."""
        raise NotImplementedError


def _stacked(parts: list[FloatArray]) -> FloatArray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
