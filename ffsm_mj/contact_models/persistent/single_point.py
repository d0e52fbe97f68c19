"""A single contact point: its rows and rates."""

from __future__ import annotations

from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import cross, dot, minus, shifted
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact_models.persistent.affine_motion import spatial_acceleration_along
from ffsm_mj.contact_models.persistent.point_groups import Wrench
from ffsm_mj.dynamics.body_twists import BodyTwist, RelativeJacobian


class SinglePoint:
    """A contact point by itself, or a joint limit: its normal is zero, and so are the rows that this gives."""

    def __init__(self, feature: Feature, bodies: RelativeJacobian, *, in_patch: bool) -> None:
        """Store the feature and the Jacobian of b relative to a."""
        self._feature, self._bodies, self._in_patch = feature, bodies, in_patch

    def at_state(self, data: Any, b: BodyTwist | None, a: BodyTwist | None) -> SingleState:
        """Evaluate; see :class:`~.point_groups.PointGroup`."""
        here = self._feature.at(data)
        return SingleState(_in_patch(here, b, a) if self._in_patch else here, self._bodies, b, a)


class SingleState:
    """A contact point at one state; see :class:`~.point_groups.GroupState`."""

    def __init__(self, here: FeatureState, bodies: RelativeJacobian, b: BodyTwist | None, a: BodyTwist | None) -> None:
        """Store its state and the twists of both bodies."""
        self.states, self.count = (here,), 1
        self.gaps, self.rates, self.scales, self.insides = (here.gap,), (here.rate,), (here.scale,), (here.inside,)
        self._here, self._bodies, self._b, self._a = here, bodies, b, a

    @property
    def normals(self) -> FloatArray:
        """See :class:`~.point_groups.GroupState`."""
        return self._here.normal[None]

    @property
    def points(self) -> FloatArray:
        """See :class:`~.point_groups.GroupState`."""
        return self._here.point[None]

    def normal_rows(self, J: FloatArray, gamma: FloatArray) -> None:
        """See :class:`~.point_groups.GroupState`."""
        here = self._here
        J[0] = here.normal.dot(self._bodies.at(here.point))
        # n . (Jdot qdot) of the material points, and the curvature terms of the moving contact point.
        gamma[0] = self._bodies.acceleration(here.normal, here.point_b, here.point_a) + here.bend

    def wrench(self, forces: FloatArray, friction: FloatArray | None) -> Wrench:
        """See :class:`~.point_groups.GroupState`."""
        here, size = self._here, forces.item(0)
        (x, y, z), (a, b, c) = here.normal.tolist(), here.point.tolist()
        x, y, z = size * x, size * y, size * z
        if friction is not None:
            ((u, v, w),) = friction.tolist()
            x, y, z = x + u, y + v, z + w
        return x, y, z, b * z - c * y, c * x - a * z, a * y - b * x

    def frictional_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """See :class:`~.point_groups.GroupState`."""
        self.normal_rows(J[:, 0], gamma[:, 0])
        self.tangential_rows(axes[1:], J[:, 1:], gamma[:, 1:])

    def tangential_rows(self, axes: FloatArray, J: FloatArray, gamma: FloatArray) -> None:
        """Write the rows of relative velocities along two tangents, (2, 3), and their rates."""
        here, b, a = self._here, self._b, self._a
        assert b is not None
        assert a is not None
        J[0] = axes.dot(self._bodies.at(here.point))
        x, y, z = here.point.tolist()
        arm, other, spin = minus((x, y, z), b.centre), minus((x, y, z), a.centre), minus(b.omega, a.omega)
        for j, axis in enumerate(axes.tolist()):
            (c, gradient), (d, others) = spatial_acceleration_along(axis, b), spatial_acceleration_along(axis, a)
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
