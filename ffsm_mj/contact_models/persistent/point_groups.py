"""Contact points whose Jacobians are evaluated together: points on one face, or a single one.

With the arm r of a material point from the mass centre of its body's tree, its velocity is v + omega x r; along an axis n

    n . (v + omega x r) = n . v + r . (n x omega)
    n . (a + alpha x r + omega x (v + omega x r)) = n . a + (n x omega) . v + r . (n x alpha + (n x omega) x omega)

are affine in r. The arm from the centre of the other body's tree differs by the offset of the centres.

Two bodies that are held at three points of a flat patch do not tilt relative to each other: their normals turn alike. The
second rates of all gaps of a patch are taken with the normal of body a, so that they are affine in the place to rounding.
The exact second rate at a point that moves over both bodies, as where two edges cross, differs by its speed times their rate
of tilt. To rounding the latter is that of a gap over the width of the patch, and in a patch that slides over the edge of a
face both would grow without bound: a tilt times the width, which is a difference of gaps, would be kept constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, scaled, shifted
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.features.points_on_face import PointsOnFace
from ffsm_mj.dynamics.body_twists import BodyTwist, RelativeJacobian, RelativeScrews

Affine = tuple[float, Vector]
"""Constant and gradient of an affine function of the arm of a point."""
Wrench = tuple[float, float, float, float, float, float]
"""Force, and moment about the world origin."""


class GroupState(Protocol):
    """The m points of a group at one state.

    Attributes:
        count: Number of points, m.
        states: States of the features.
        gaps: Gaps, m.
        rates: Their rates, m/s.
        scales: Largest terms of the curvature, m/s^2.
        insides: Distances to the bounds of the features, m.
        normals: Normals from a to b, (m, 3).
        points: Points of application of the forces, (m, 3).
    """

    count: int

    @property
    def gaps(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def rates(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def scales(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def insides(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def states(self) -> Sequence[FeatureState]: ...  # noqa: D102

    @property
    def normals(self) -> FloatArray: ...  # noqa: D102

    @property
    def points(self) -> FloatArray: ...  # noqa: D102

    def normal_rows(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write the rows of the gap rates, (m, nv), and the second rates of the gaps at qacc = 0, (m,)."""
        ...

    def frictional_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """Write the rows of gap rates, and of relative velocities along two tangents.

        Args:
            axes: Normal and tangents of all points, (3, 3).
            J: Rows, (m, 3, nv).
            gamma: Second rates of the gaps, and rates of the relative velocity at the contact points, which move over both
                surfaces, at qacc = 0, (m, 3).
        """
        ...

    def wrench(self, forces: FloatArray, friction: FloatArray | None) -> Wrench:
        """Resultant on geom b of normal forces, (m,), and of friction forces in world axes, (m, 3)."""
        ...


class PointGroup(Protocol):
    """Contact points of one pair, evaluated together."""

    def at_state(self, data: Any, b: BodyTwist | None, a: BodyTwist | None) -> GroupState:
        """Evaluate at the state in ``data``, with the twists of both bodies there; None if only normals are needed.

        Several points on a face always need them.
        """
        ...


class FaceGroup:
    """Points of one body over a face of another; the first body is that of the face, the second that of the points."""

    def __init__(self, features: Sequence[PointOnFace], screws: RelativeScrews, *, in_patch: bool) -> None:
        """Store the points, see :meth:`PointsOnFace.together`, and the screws of b relative to a."""
        self._gaps = PointsOnFace(features)
        self._screws = screws.reversed() if self._gaps.swapped else screws
        self._in_patch = in_patch

    def at_state(self, data: Any, b: BodyTwist | None, a: BodyTwist | None) -> FaceState:
        """Evaluate; see :class:`PointGroup`."""
        assert b is not None
        assert a is not None
        first, second = (b, a) if self._gaps.swapped else (a, b)
        return FaceState(self._gaps, self._screws, data, (first, second), a.omega if self._in_patch else first.omega)


class FaceState:
    """Points over a face at one state; see :class:`GroupState`."""

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
        """See :class:`GroupState`; gap'' contains 2 n' times the relative velocity, as the normal is fixed to the face."""
        J[:] = self._screws.rows(self._normal, self._arms, self._offset)
        gamma[:] = self._normal_gamma()

    def _normal_gamma(self) -> FloatArray:
        normal = self._normal
        (x, y, z), (a, b, c) = normal, self._omega
        turning = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
        return self._relative(
            self._arms, _acceleration(normal, self._second, turning), _acceleration(normal, self._first, turning)
        )

    def frictional_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """See :class:`GroupState`."""
        first, second = self._first, self._second
        # The second body moves along minus an axis relative to the first one if it is a, which b moves along it from.
        along = -axes if self._gaps.swapped else axes
        arms = self.points - second.centre
        J[:] = self._screws.rows_along(along, arms, self._offset)
        gamma[:, 0] = self._normal_gamma()
        turn = minus(second.alpha, first.alpha)
        rates = arms.dot(_turning(turn))
        rates += self.point_rates.dot(_turning(minus(second.omega, first.omega)))
        rates += minus(minus(second.acceleration, first.acceleration), cross(first.alpha, self._offset))
        gamma[:, 1:] = rates.dot(along[1:].T)

    def wrench(self, forces: FloatArray, friction: FloatArray | None) -> Wrench:
        """See :class:`GroupState`."""
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
        """See :class:`GroupState`."""
        gaps: list[float] = self._levels[0].tolist()
        return gaps

    @cached_property
    def rates(self) -> list[float]:
        """See :class:`GroupState`."""
        found = self._relative(self._arms, _velocity(self._normal, self._second), _velocity(self._normal, self._first))
        rates: list[float] = found.tolist()
        return rates

    @cached_property
    def _bends(self) -> list[float]:
        """Curvature terms of the second rates, m/s^2, (m,)."""
        turning = scaled(2.0, cross(self._first.omega, self._normal))
        found = self._relative(self._arms, _velocity(turning, self._second), _velocity(turning, self._first))
        bends: list[float] = found.tolist()
        return bends

    @property
    def scales(self) -> list[float]:
        """See :class:`GroupState`."""
        return [abs(bend) for bend in self._bends]

    @cached_property
    def insides(self) -> list[float]:
        """See :class:`GroupState`."""
        return self._gaps.insides(self._local)

    @cached_property
    def points(self) -> FloatArray:
        """See :class:`GroupState`."""
        return self._places + np.multiply.outer(self._levels[1], self._normal)

    @cached_property
    def point_rates(self) -> FloatArray:
        """Velocities of ``points``, which move over both surfaces, (m, 3)."""
        second, turning = self._second, cross(self._first.omega, self._normal)
        rates: FloatArray = self._arms.dot(_turning(second.omega))
        rates += second.velocity
        rates += np.multiply.outer(self._levels[1], turning)
        rates -= np.multiply.outer(0.5 * np.array(self.rates), self._normal)
        return rates

    @cached_property
    def normals(self) -> FloatArray:
        """See :class:`GroupState`."""
        normals = np.empty_like(self._places)
        normals[:] = scaled(-1.0, self._normal) if self._gaps.swapped else self._normal
        return normals

    @cached_property
    def states(self) -> list[FeatureState]:
        """See :class:`GroupState`."""
        scalars = zip(self.gaps, self.rates, self._bends, self.insides, strict=True)
        vectors = zip(self.normals, self.points, self._places, map(tuple, self.point_rates.tolist()), strict=True)
        return [
            FeatureState(gap, rate, normal, point, place, place, bend, abs(bend), inside, point_rate)
            for (gap, rate, bend, inside), (normal, point, place, point_rate) in zip(scalars, vectors, strict=True)
        ]


class SinglePoint:
    """A contact point by itself, or a joint limit: its normal is zero, and so are the rows that this gives."""

    def __init__(self, feature: Feature, bodies: RelativeJacobian, *, in_patch: bool) -> None:
        """Store the feature and the Jacobian of b relative to a."""
        self._feature, self._bodies, self._in_patch = feature, bodies, in_patch

    def at_state(self, data: Any, b: BodyTwist | None, a: BodyTwist | None) -> SingleState:
        """Evaluate; see :class:`PointGroup`."""
        here = self._feature.at(data)
        return SingleState(_in_patch(here, b, a) if self._in_patch else here, self._bodies, b, a)


class SingleState:
    """A contact point at one state; see :class:`GroupState`."""

    def __init__(self, here: FeatureState, bodies: RelativeJacobian, b: BodyTwist | None, a: BodyTwist | None) -> None:
        """Store its state and the twists of both bodies."""
        self.states, self.count = (here,), 1
        self.gaps, self.rates, self.scales, self.insides = (here.gap,), (here.rate,), (here.scale,), (here.inside,)
        self._here, self._bodies, self._b, self._a = here, bodies, b, a

    @property
    def normals(self) -> FloatArray:
        """See :class:`GroupState`."""
        return self._here.normal[None]

    @property
    def points(self) -> FloatArray:
        """See :class:`GroupState`."""
        return self._here.point[None]

    def normal_rows(self, J: FloatArray, gamma: FloatArray) -> None:
        """See :class:`GroupState`."""
        here = self._here
        J[0] = here.normal.dot(self._bodies.at(here.point))
        # n . (Jdot qdot) of the material points, and the curvature terms of the moving contact point.
        gamma[0] = self._bodies.acceleration(here.normal, here.point_b, here.point_a) + here.bend

    def wrench(self, forces: FloatArray, friction: FloatArray | None) -> Wrench:
        """See :class:`GroupState`."""
        here, size = self._here, forces.item(0)
        (x, y, z), (a, b, c) = here.normal.tolist(), here.point.tolist()
        x, y, z = size * x, size * y, size * z
        if friction is not None:
            ((u, v, w),) = friction.tolist()
            x, y, z = x + u, y + v, z + w
        return x, y, z, b * z - c * y, c * x - a * z, a * y - b * x

    def frictional_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """See :class:`GroupState`."""
        self.normal_rows(J[:, 0], gamma[:, 0])
        self.tangential_rows(axes[1:], J[:, 1:], gamma[:, 1:])

    def tangential_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """Write the rows of relative velocities along two tangents, (2, 3), and their rates; see :class:`GroupState`."""
        here, b, a = self._here, self._b, self._a
        assert b is not None
        assert a is not None
        J[0] = axes.dot(self._bodies.at(here.point))
        x, y, z = here.point.tolist()
        arm, other, spin = minus((x, y, z), b.centre), minus((x, y, z), a.centre), minus(b.omega, a.omega)
        for j, axis in enumerate(axes.tolist()):
            (c, gradient), (d, others) = _spatial(axis, b), _spatial(axis, a)
            gamma[0, j] = c + dot(gradient, arm) - d - dot(others, other) + dot(here.point_rate, cross(axis, spin))


def _in_patch(here: FeatureState, b: BodyTwist | None, a: BodyTwist | None) -> FeatureState:
    """The state of a point of a flat patch, whose normal turns with body a."""
    assert b is not None
    assert a is not None
    (x, y, z), (i, j, k) = here.point.tolist(), here.normal.tolist()
    own, other = minus((x, y, z), b.centre), minus((x, y, z), a.centre)
    w = minus(shifted(b.velocity, 1.0, cross(b.omega, own)), shifted(a.velocity, 1.0, cross(a.omega, other)))
    bend = 2.0 * dot(cross(a.omega, (i, j, k)), w)
    return here._replace(point_a=here.point, point_b=here.point, bend=bend, scale=max(here.scale, abs(bend)))


_STILL = (0.0, 0.0, 0.0)


def _velocity(axis: Vector, body: BodyTwist) -> Affine:
    """Velocity of material points along an axis."""
    return dot(axis, body.velocity), cross(axis, body.omega)


def _acceleration(axis: Vector, body: BodyTwist, turning: Vector = _STILL) -> Affine:
    """Acceleration of material points along an axis at qacc = 0, with their velocity along another vector added."""
    (x, y, z), (p, q, r), (i, j, k) = axis, body.omega, body.alpha
    a, b, c = turning
    u, v, w = a + y * r - z * q, b + z * p - x * r, c + x * q - y * p
    gradient = y * k - z * j + v * r - w * q, z * i - x * k + w * p - u * r, x * j - y * i + u * q - v * p
    (d, e, f), (g, h, m) = body.acceleration, body.velocity
    return x * d + y * e + z * f + u * g + v * h + w * m, gradient


def _spatial(axis: Vector, body: BodyTwist) -> Affine:
    """Rate of the velocity along an axis, at qacc = 0, of those material points that pass a place fixed in space."""
    return dot(axis, body.acceleration), cross(axis, body.alpha)


def _turning(omega: Vector) -> FloatArray:
    """Matrix K with r K = omega x r for row vectors r, (3, 3)."""
    x, y, z = omega
    return np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
