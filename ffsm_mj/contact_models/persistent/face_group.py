"""Contact points on one face: rows of all of them as arrays.

The formulas are those of :mod:`.affine_motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, scaled
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.features.points_on_face import PointsOnFace
from ffsm_mj.contact_models.persistent.affine_motion import Affine, acceleration_along, velocity_along
from ffsm_mj.contact_models.persistent.wrench_rows import normal_wrench_rows, wrench_rows
from ffsm_mj.dynamics.body_twists import PairTwist

_NOTHING: Vector = (0.0, 0.0, 0.0)


def _turning_rows(omega: Vector) -> tuple[Vector, Vector, Vector]:
    """Rows of the matrix K with r K = omega x r for row vectors r."""
    x, y, z = omega
    return (0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)


class FaceGroup:
    """Points of one body over a face of another; the first body is that of the face, the second that of the points."""

    def __init__(self, features: Sequence[PointOnFace], *, in_patch: bool) -> None:
        """Store the points; see :meth:`PointsOnFace.together`."""
        self._gaps, self._in_patch = PointsOnFace(features), in_patch

    def at_state(self, data: Any, twist: PairTwist) -> FaceState:
        """Evaluate; see :class:`~.point_groups.PointGroup`."""
        return FaceState(self._gaps, data, twist, in_patch=self._in_patch)


class FaceState:
    """Points over a face at one state; see :class:`~.point_groups.GroupState`.

    Quantities are of body b relative to a, along the normal n from a to b: also where the face is that of b.

    Attributes:
        normal: The normal.
    """

    def __init__(self, gaps: PointsOnFace, data: Any, twist: PairTwist, *, in_patch: bool) -> None:
        """Place the points."""
        self._gaps, self._twist, self.count = gaps, twist, gaps.count
        self._places, self._local, normal = gaps.place(data)
        x, y, z = normal.tolist()
        self._outward: Vector = (x, y, z)
        self._sign = -1.0 if gaps.swapped else 1.0
        self.normal = scaled(self._sign, self._outward)
        self._first = twist.b if gaps.swapped else twist.a
        self._turning = cross(self._first.omega, self.normal)
        self._patch_turning = cross(twist.a.omega, self.normal) if in_patch else self._turning
        self._arms = np.empty((gaps.count, 4))
        self._arms[:, 3] = 1.0
        np.subtract(self._places, twist.b.centre, out=self._arms[:, :3])

    def normal_rows(self, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the normal rows: gap'' contains 2 n' times the relative velocity, as the normal is fixed to the face."""
        rows[:] = normal_wrench_rows(self.normal, self._arms)
        constant, (x, y, z) = acceleration_along(self.normal, self._twist, *self._second)
        bend, (u, v, w) = velocity_along(self._bend_axis, self._twist)
        gamma[:] = self._at_places((constant + bend, (x + u, y + v, z + w)))

    @property
    def _second(self) -> tuple[Vector, Vector]:
        """Angular velocity of the body of the points, and its velocity at the centre of b."""
        return self._twist.at_centre_of_b(self._gaps.swapped)

    @property
    def _bend_axis(self) -> Vector:
        """2 n' less the n' of the face: what the relative velocity of the material points adds to gap''.

        With the contact point c of rate c' that of the body of the points, n . (omega x c') contains n' once already.
        """
        (x, y, z), (u, v, w) = self._patch_turning, self._turning
        return 2.0 * x - u, 2.0 * y - v, 2.0 * z - w

    def frictional_rows(self, axes: FloatArray, rows: FloatArray, gamma: FloatArray) -> None:
        """See :class:`~.point_groups.GroupState`."""
        # The contact points are beyond their places by the level along the normal, and move there with the rate of the gap.
        terms = np.empty((self.count, 6))
        terms[:, :4], terms[:, 4], terms[:, 5] = self._arms, self._beyond, self._rates
        terms[:, :3] += np.multiply.outer(self._beyond, self.normal)
        rows[:] = wrench_rows(axes, terms[:, :4])
        gamma[:] = terms.dot(self._rates_along(axes))

    def _rates_along(self, axes: FloatArray) -> FloatArray:
        """Rates at qacc = 0 of the relative velocity along the axes at the contact points, (6, 3).

        They are affine in the arms of these, in how far they are beyond their places, and in the rates of the gaps.
        """
        twist, normal, turning = self._twist, self.normal, self._turning
        omega, velocity = self._second
        beyond = minus(turning, cross(omega, normal))
        point_rates = np.array((*_turning_rows(omega), velocity, beyond, scaled(-0.5, self._outward)))
        passing = np.array((*_turning_rows(twist.alpha), twist.acceleration, _NOTHING, _NOTHING))
        passing += point_rates.dot(_turning_rows(twist.omega))
        rates: FloatArray = passing.dot(axes.T)
        constant, gradient = velocity_along(self._bend_axis, twist)
        # The normal of a patch turns with body a: its bend is that at the places.
        level = 2.0 * dot(normal, cross(twist.omega, minus(self._patch_turning, turning)))
        rates[:5, 0] += (*gradient, constant, level)
        return rates

    def _at_places(self, along: Affine) -> FloatArray:
        """Values at the places of an affine function of the arm, (m,)."""
        constant, (x, y, z) = along
        values: FloatArray = self._arms.dot((x, y, z, constant))
        return values

    @cached_property
    def _levels(self) -> tuple[FloatArray, FloatArray]:
        return self._gaps.levels(self._local)

    @property
    def gaps(self) -> list[float]:
        """See :class:`~.point_groups.GroupState`."""
        gaps: list[float] = self._levels[0].tolist()
        return gaps

    @cached_property
    def _beyond(self) -> FloatArray:
        """How far the contact points are from their places along the normal from a to b, m, (m,)."""
        return self._sign * self._levels[1]

    @cached_property
    def _rates(self) -> FloatArray:
        return self._at_places(velocity_along(self.normal, self._twist))

    @property
    def rates(self) -> list[float]:
        """See :class:`~.point_groups.GroupState`."""
        rates: list[float] = self._rates.tolist()
        return rates

    @cached_property
    def _bends(self) -> list[float]:
        """Curvature terms of the second rates, m/s^2, (m,)."""
        bends: list[float] = self._at_places(velocity_along(scaled(2.0, self._turning), self._twist)).tolist()
        return bends

    @property
    def scales(self) -> list[float]:
        """See :class:`~.point_groups.GroupState`."""
        return [abs(bend) for bend in self._bends]

    @cached_property
    def insides(self) -> list[float]:
        """See :class:`~.point_groups.GroupState`."""
        return self._gaps.insides(self._local)

    @cached_property
    def points(self) -> FloatArray:
        """See :class:`~.point_groups.GroupState`."""
        return self._places + np.multiply.outer(self._beyond, self.normal)

    @cached_property
    def point_rates(self) -> FloatArray:
        """Velocities of ``points``, which move over both surfaces, (m, 3)."""
        omega, velocity = self._second
        rates: FloatArray = self._arms.dot((*_turning_rows(omega), velocity))
        rates += np.multiply.outer(self._beyond, self._turning)
        rates -= np.multiply.outer(0.5 * self._rates, self._outward)
        return rates

    @cached_property
    def normals(self) -> FloatArray:
        """See :class:`~.point_groups.GroupState`."""
        normals = np.empty_like(self._places)
        normals[:] = self.normal
        return normals

    @cached_property
    def states(self) -> list[FeatureState]:
        """See :class:`~.point_groups.GroupState`."""
        scalars = zip(self.gaps, self.rates, self._bends, self.insides, strict=True)
        vectors = zip(self.normals, self.points, self._places, map(tuple, self.point_rates.tolist()), strict=True)
        return [
            FeatureState(gap, rate, normal, point, place, place, bend, abs(bend), inside, point_rate)
            for (gap, rate, bend, inside), (normal, point, place, point_rate) in zip(scalars, vectors, strict=True)
        ]
