"""Contact points on one face: rows of all of them as arrays.

The formulas are those of :mod:`.affine_motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, scaled, shifted
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.features.points_on_face import PointsOnFace
from ffsm_mj.contact_models.persistent.affine_motion import Affine, acceleration_along, turning_matrix, velocity_along
from ffsm_mj.contact_models.persistent.point_groups import Wrench
from ffsm_mj.dynamics.body_twists import BodyTwist, RelativeScrews


class FaceGroup:
    """Points of one body over a face of another; the first body is that of the face, the second that of the points."""

    def __init__(self, features: Sequence[PointOnFace], screws: RelativeScrews, *, in_patch: bool) -> None:
        """Store the points, see :meth:`PointsOnFace.together`, and the screws of b relative to a."""
        self._gaps = PointsOnFace(features)
        self._screws = screws.reversed() if self._gaps.swapped else screws
        self._in_patch = in_patch

    def at_state(self, data: Any, b: BodyTwist | None, a: BodyTwist | None) -> FaceState:
        """Evaluate; see :class:`~.point_groups.PointGroup`."""
        assert b is not None
        assert a is not None
        first, second = (b, a) if self._gaps.swapped else (a, b)
        return FaceState(self._gaps, self._screws, data, (first, second), a.omega if self._in_patch else first.omega)


class FaceState:
    """Points over a face at one state; see :class:`~.point_groups.GroupState`."""

    def __init__(
        self,
        gaps: PointsOnFace,
        screws: RelativeScrews,
        data: Any,
        bodies: tuple[BodyTwist, BodyTwist],
        omega: Vector,
    ) -> None:
        """Place the points; ``omega`` is the angular velocity with which the normal turns."""
        self._gaps, self._screws, (self._first, self._second), self._omega = gaps, screws, bodies, omega
        first, second = bodies
        self.count = gaps.count
        self._places, self._local, normal = gaps.place(data)
        x, y, z = normal.tolist()
        self._normal: Vector = (x, y, z)
        self._offset = minus(second.centre, first.centre)
        self._arms = self._places - second.centre

    def normal_rows(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write the normal rows: gap'' contains 2 n' times the relative velocity, as the normal is fixed to the face."""
        J[:] = self._screws.rows(self._normal, self._arms, self._offset)
        gamma[:] = self._normal_gamma()

    def _normal_gamma(self) -> FloatArray:
        normal = self._normal
        (x, y, z), (a, b, c) = normal, self._omega
        turning = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
        return self._relative(
            self._arms, acceleration_along(normal, self._second, turning), acceleration_along(normal, self._first, turning)
        )

    def frictional_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """See :class:`~.point_groups.GroupState`."""
        # The second body moves along minus an axis relative to the first one if it is a, which b moves along it from.
        along = -axes if self._gaps.swapped else axes
        J[:] = self._screws.rows_along(along, self.points - self._second.centre, self._offset)
        gamma[:, 0] = self._normal_gamma()
        (c, one), (d, other) = (self._tangential_rate(axis) for axis in along[1:].tolist())
        # The points are beyond their places by the level along the normal, and move there with the rate of the gap.
        of_points = np.column_stack((self._arms, self._levels[1], self.rates))
        gamma[:, 1:] = of_points.dot(np.array((one, other)).T)
        gamma[:, 1:] += c, d

    def _tangential_rate(self, axis: Vector) -> tuple[float, tuple[float, ...]]:
        """Rate at qacc = 0 of the relative velocity along an axis at the contact points.

        It is affine in the arms of the places, how far the contact points are beyond these, and the rates of the gaps.
        """
        first, second, normal = self._first, self._second, self._normal
        turn, spin = minus(second.alpha, first.alpha), minus(second.omega, first.omega)
        rise = minus(minus(second.acceleration, first.acceleration), cross(first.alpha, self._offset))
        # axis . (turn x arm + spin x point rate), with the parts of the point rate; see ``point_rates``.
        bend, weight = cross(axis, turn), cross(axis, spin)
        x, y, z = shifted(bend, 1.0, cross(weight, second.omega))
        level = dot(bend, normal) + dot(weight, cross(first.omega, normal))
        return dot(axis, rise) + dot(weight, second.velocity), (x, y, z, level, -0.5 * dot(weight, normal))

    def wrench(self, forces: FloatArray, friction: FloatArray | None) -> Wrench:
        """See :class:`~.point_groups.GroupState`."""
        # A shift of a normal force along itself, from the place to the contact point, does not change its moment.
        normal = scaled(-1.0, self._normal) if self._gaps.swapped else self._normal
        x, y, z = scaled(float(forces.sum()), normal)
        a, b, c = cross(forces.dot(self._places).tolist(), normal)
        if friction is None:
            return x, y, z, a, b, c
        u, v, w = friction.sum(axis=0).tolist()
        (_, xy, xz), (yx, _, yz), (zx, zy, _) = self.points.T.dot(friction).tolist()
        return x + u, y + v, z + w, a + yz - zy, b + zx - xz, c + xy - yx

    def _relative(self, arms: FloatArray, of_second: Affine, of_first: Affine) -> FloatArray:
        """Difference of affine functions of the two bodies at some arms from the centre of the second one, (m,)."""
        (c, (x, y, z)), (d, (u, v, w)), (i, j, k) = of_second, of_first, self._offset
        values: FloatArray = arms.dot((x - u, y - v, z - w))
        values += c - d - (i * u + j * v + k * w)
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
    def rates(self) -> list[float]:
        """See :class:`~.point_groups.GroupState`."""
        found = self._relative(
            self._arms, velocity_along(self._normal, self._second), velocity_along(self._normal, self._first)
        )
        rates: list[float] = found.tolist()
        return rates

    @cached_property
    def _bends(self) -> list[float]:
        """Curvature terms of the second rates, m/s^2, (m,)."""
        turning = scaled(2.0, cross(self._first.omega, self._normal))
        found = self._relative(self._arms, velocity_along(turning, self._second), velocity_along(turning, self._first))
        bends: list[float] = found.tolist()
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
        return self._places + np.multiply.outer(self._levels[1], self._normal)

    @cached_property
    def point_rates(self) -> FloatArray:
        """Velocities of ``points``, which move over both surfaces, (m, 3)."""
        second, turning = self._second, cross(self._first.omega, self._normal)
        rates: FloatArray = self._arms.dot(turning_matrix(second.omega))
        rates += second.velocity
        rates += np.multiply.outer(self._levels[1], turning)
        rates -= np.multiply.outer(0.5 * np.array(self.rates), self._normal)
        return rates

    @cached_property
    def normals(self) -> FloatArray:
        """See :class:`~.point_groups.GroupState`."""
        normals = np.empty_like(self._places)
        normals[:] = scaled(-1.0, self._normal) if self._gaps.swapped else self._normal
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
