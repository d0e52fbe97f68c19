"""Contact points at one state: gaps, rows of their rates, and resultants of the forces on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact_models.persistent.point_groups import GroupState
from ffsm_mj.contact_models.persistent.wrench_rows import Wrench, WrenchRows
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, RATE


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
    """Contact points at one state, in the coordinates of a motion.

    Attributes:
        J: Derivative of velocities at the contact points with respect to the generalised velocity.
        gamma: Part of their accelerations that does not depend on those of the joints, m/s^2.
        response: J M^-1, like J; with closed loops J Mc^-1.
        G: Delassus matrix J M^-1 J^T, 1/kg: accelerations per unit force; with closed loops J Mc^-1 J^T.
        loop_rates: Part of gamma that is due to closed loops, m/s^2; None without any.
    """

    loop_rates: FloatArray | None = None

    def __init__(
        self, groups: Sequence[GroupState], wrenches: WrenchRows, J: FloatArray, response: FloatArray, gamma: FloatArray
    ) -> None:
        """Store the rows of some groups of points."""
        self._groups, self._wrenches, self.J, self.response, self.gamma = groups, wrenches, J, response, gamma

    @cached_property
    def G(self) -> FloatArray:
        """Delassus matrix; see the attributes."""
        delassus: FloatArray = self.response.dot(self.J.T)
        return delassus

    def close_loops(self, loops: ClosedLoops) -> None:
        """Take the accelerations of the points with closed loops; called before anything else is computed from the rows."""
        self.response[:] = loops.response(self.J)
        self.loop_rates = self.J.dot(loops.acceleration())
        self.gamma += self.loop_rates

    @cached_property
    def states(self) -> tuple[FeatureState, ...]:
        """Gap, rate, normal and contact points of each contact point."""
        return tuple([state for group in self._groups for state in group.states])

    @property
    def gaps(self) -> list[float]:
        """Gap of each contact point, m, (k,)."""
        return [gap for group in self._groups for gap in group.gaps]

    @property
    def rates(self) -> list[float]:
        """Rates of the gaps, m/s, (k,)."""
        return [rate for group in self._groups for rate in group.rates]

    @property
    def scales(self) -> list[float]:
        """Largest curvature term of the second rate of each gap, m/s^2, (k,)."""
        return [scale for group in self._groups for scale in group.scales]

    @property
    def insides(self) -> list[float]:
        """Distance of each contact point to the bounds of its feature, m, (k,)."""
        return [inside for group in self._groups for inside in group.insides]

    @cached_property
    def extremes(self) -> Extremes:
        """Smallest distance to the bounds of a feature, largest gap and largest rate."""
        gaps = self.gaps
        return Extremes(min(self.insides), max(map(abs, gaps)), max(map(abs, self.rates)), min(gaps))

    @property
    def starts(self) -> list[int]:
        """First contact point of each group of points of one pair."""
        return [0, *accumulate(group.count for group in self._groups[:-1])]

    def wrenches(self, forces: FloatArray) -> list[Wrench]:
        """Force, and moment about the world origin, on geom b of each group of points, for forces along the rows, N."""
        return self._wrenches.resultants(forces)

    def normal_forces(self, forces: FloatArray) -> FloatArray:
        """Normal forces of the points among forces along the rows, N, (k,)."""
        raise NotImplementedError

    def friction_forces(self, forces: FloatArray) -> FloatArray | None:
        """Friction forces on geom b for forces along the rows, world axes, N, (k, 3); None without tangents."""
        raise NotImplementedError

    def resultant(
        self, part: slice, forces: FloatArray, friction: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Resultant force of the points of one pair, N, its centre, m, and the mean unit normal, (3,) each.

        Args:
            part: The points.
            forces: Normal forces of all points, N, (k,).
            friction: Friction forces on geom b of all points, world axes, N, (k, 3).
        """
        normals, points, pushed = self.normals[part], self.points[part], forces[part]
        if len(pushed) == 1:
            force = pushed[0] * normals[0]
            return force if friction is None else force + friction[part][0], points[0], normals[0]
        total = float(pushed.sum())
        weights = pushed / total if total > 0.0 else np.full(len(pushed), 1.0 / max(1, len(pushed)))
        normal = weights @ normals
        length = math.hypot(*normal.tolist())
        force = pushed @ normals if friction is None else pushed @ normals + friction[part].sum(axis=0)
        return force, weights @ points, normal / length if length else normal

    @cached_property
    def normals(self) -> FloatArray:
        """Normals from a to b, (k, 3); zero for a joint limit."""
        return _stacked([group.normals for group in self._groups])

    @cached_property
    def points(self) -> FloatArray:
        """Points of application of the forces, m, (k, 3)."""
        return _stacked([group.points for group in self._groups])


class ContactRows(PointRows):
    """Rows of the normals: gap' = J qdot and gap'' = J qddot + gamma, J (k, nv)."""

    def normal_forces(self, forces: FloatArray) -> FloatArray:
        """See :class:`PointRows`."""
        return forces

    def friction_forces(self, forces: FloatArray) -> None:  # noqa: ARG002
        """See :class:`PointRows`."""
        return


class FrictionalRows(PointRows):
    """Rows of normals and tangents, J (3k, nv); row 3 i + j is axis j (n, t1, t2) of point i.

    A joint limit, and a pair without friction, has zero tangents.

    Attributes:
        axes: Normal and tangents of each point, world axes, (k, 3, 3).
        qvel: Generalised velocity, (nv,).
        held: Linear problems for the forces that hold some of the rows; see ``friction/held_rows.py``.
    """

    def __init__(
        self,
        groups: Sequence[GroupState],
        wrenches: WrenchRows,
        J: FloatArray,
        response: FloatArray,
        gamma: FloatArray,
        axes: FloatArray,
        qvel: FloatArray,
    ) -> None:
        """Store the rows of some groups of points."""
        super().__init__(groups, wrenches, J, response, gamma)
        self.axes, self.qvel = axes, qvel
        self.held: dict[tuple[bytes, bytes], Any] = {}

    def normal_forces(self, forces: FloatArray) -> FloatArray:
        """See :class:`PointRows`."""
        return forces[::3]

    def friction_forces(self, forces: FloatArray) -> FloatArray:
        """See :class:`PointRows`."""
        return self.across(forces.reshape(-1, 3)[:, 1:])

    @cached_property
    def slips(self) -> FloatArray:
        """Slip velocities along the tangents, m/s, (k, 2)."""
        slips: FloatArray = self.J.dot(self.qvel).reshape(-1, 3)[:, 1:]
        return slips

    def largest_slip(self, which: BoolArray) -> float:
        """Largest slip of some points along a tangent, m/s; which, (k,)."""
        slips = np.abs(self.slips)
        return float((slips if which.all() else slips[which]).max(initial=0.0))

    @cached_property
    def speed_rounding(self) -> FloatArray:
        """Rounding of the slip speeds, m/s, (k,)."""
        terms = np.abs(self.J * self.qvel).reshape(len(self.axes), -1).max(axis=1, initial=0.0)
        return np.asarray(RATE * (1.0 + terms))

    def acceleration_rounding(self, force: FloatArray) -> FloatArray:
        """Rounding of the accelerations under a generalised force, m/s^2, (k,): a share of the largest term."""
        terms = np.abs(self.response * force).reshape(len(self.axes), -1).max(axis=1, initial=0.0).tolist()
        each = zip(terms, np.abs(self.gamma).reshape(-1, 3).tolist(), self.scales, strict=True)
        return np.array([ACCELERATION_M_S2 + ACCELERATION * max(term, *rates, scale) for term, rates, scale in each])

    def across(self, components: FloatArray) -> FloatArray:
        """Vectors with given components along the tangents of each point, world axes, (k, 3)."""
        vectors: FloatArray = np.matmul(components[:, None], self.axes[:, 1:])[:, 0]
        return vectors


def _stacked(parts: list[FloatArray]) -> FloatArray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
