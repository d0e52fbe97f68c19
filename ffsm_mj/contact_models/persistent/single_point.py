"""A single contact point: its rows and rates.

The velocity along an axis d at the arm r from the centre of the twist (omega, v) is d . (v + omega x r) = (r x d) . omega +
d . v: the row (r x d, d) is the moment and the force of a unit force along d there. The same row takes the rates of a twist
to accelerations and, transposed, a force at the point to its resultant.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, shifted
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.dynamics.body_twists import BodyTwist, PairTwist


class SinglePoint:
    """A contact point by itself, or a joint limit: its normal is zero, and so are the rows that this gives."""

    def __init__(self, feature: Feature, *, in_patch: bool) -> None:
        """Store the feature."""
        self._feature, self._in_patch = feature, in_patch

    def at_state(self, data: Any, twist: PairTwist) -> SingleState:
        """Evaluate at the state in ``data``, with the twist of both bodies there."""
        here = self._feature.at(data)
        return SingleState(_in_patch(here, twist) if self._in_patch else here, twist)


class SingleState:
    """A contact point at one state; see :class:`~.contact_points.GroupState`."""

    def __init__(self, here: FeatureState, twist: PairTwist) -> None:
        """Store its state and the twist of both bodies."""
        self.states, self.count = (here,), 1
        self.gaps, self.rates, self.scales, self.insides = (here.gap,), (here.rate,), (here.scale,), (here.inside,)
        self._here, self._twist = here, twist
        x, y, z = here.point.tolist()
        self._arm = minus((x, y, z), twist.b.centre)

    @property
    def normals(self) -> FloatArray:
        """See :class:`~.contact_points.GroupState`."""
        return self._here.normal[None]

    @property
    def points(self) -> FloatArray:
        """See :class:`~.contact_points.GroupState`."""
        return self._here.point[None]

    def normal_rows(self, rows: FloatArray, gamma: FloatArray) -> None:
        """See :class:`~.contact_points.GroupState`."""
        x, y, z = self._here.normal.tolist()
        rows[0] = *cross(self._arm, (x, y, z)), x, y, z
        gamma[0] = self._normal_gamma()

    def _normal_gamma(self) -> float:
        """Acceleration of the material points along the normal, and the curvature terms of the moving contact point."""
        here = self._here
        x, y, z = here.normal.tolist()
        own = _acceleration((x, y, z), self._twist.b, here.point_b)
        return own - _acceleration((x, y, z), self._twist.a, here.point_a) + here.bend

    def frictional_rows(self, axes: FloatArray, rows: FloatArray, gamma: FloatArray) -> None:
        """See :class:`~.contact_points.GroupState`."""
        twist, (u, v, w) = self._twist, self._here.point_rate
        rows[0, :, :3], rows[0, :, 3:] = np.cross(self._arm, axes), axes
        passing = shifted(twist.acceleration, 1.0, cross(twist.alpha, self._arm))
        gamma[0] = axes.dot(shifted(passing, 1.0, cross(twist.omega, (u, v, w))))
        gamma[0, 0] = self._normal_gamma()


def _acceleration(axis: Vector, body: BodyTwist, point: FloatArray) -> float:
    """Acceleration of a material point along an axis at qacc = 0, m/s^2: a + alpha x r + omega x (v + omega x r)."""
    x, y, z = point.tolist()
    arm, omega = minus((x, y, z), body.centre), body.omega
    passing = shifted(body.velocity, 1.0, cross(omega, arm))
    spatial = shifted(body.acceleration, 1.0, cross(body.alpha, arm))
    return dot(axis, spatial) + dot(axis, cross(omega, passing))


def _in_patch(here: FeatureState, twist: PairTwist) -> FeatureState:
    """The state of a point of a flat patch, whose normal turns with body a."""
    (x, y, z), (i, j, k) = here.point.tolist(), here.normal.tolist()
    w = shifted(twist.velocity, 1.0, cross(twist.omega, minus((x, y, z), twist.b.centre)))
    bend = 2.0 * dot(cross(twist.a.omega, (i, j, k)), w)
    return here._replace(point_a=here.point, point_b=here.point, bend=bend, scale=max(here.scale, abs(bend)))
