"""Rows of latches: the relative velocities that they stop, the rates of these rows, and their errors in position.

The rows of a latch are components c of the twist (u, w) of body b relative to body a at P_b, the point of b: rows of both
bodies at one point conserve angular momentum. The axes are fixed in a. With (a, alpha) the relative acceleration of the
material points at P_b and omega_a the angular velocity of a,

    d/dt (c . u) = c . a - 2 c . (omega_a x u),        d/dt (c . w) = c . alpha - c . (omega_a x w)

Rows of rotation are multiplied by a length, so that all rows are speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.body_twists import BodyTwist, BodyTwists, Vector, chain
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.rigid_body import skew

LENGTH_M = 1.0
"""Length by which rows of rotation are multiplied.

Where rows depend on each other, the forces are those of least norm, with forces in N and torques in N m at equal weight.
"""


class LatchRows(NamedTuple):
    """Rows of some latches at one state.

    Attributes:
        J: Stopped relative velocities as functions of the generalised velocity, (n, nv).
        gamma: Their rates at zero generalised acceleration, (n,).
    """

    J: FloatArray
    gamma: FloatArray


class _Place(NamedTuple):
    """One latch in a model: bodies, which dofs move them, and its components along axes fixed in a."""

    latch: LatchedBodies
    first: int
    second: int
    on_first: FloatArray
    on_second: FloatArray
    together: bool
    components: FloatArray
    about_axis: bool
    part: slice


class LatchRowEvaluator:
    """Evaluates the rows of some latches of a model, state by state."""

    def __init__(
        self,
        model: Any,
        data: Any,
        latches: Sequence[LatchedBodies],
        bodies: Sequence[int] | None = None,
    ) -> None:
        """Take views of the arrays of ``data``, which MuJoCo does not move.

        Args:
            model: MuJoCo model.
            data: Its data.
            latches: The latches.
            bodies: Id in this model of each body that the latches name; None: they name those of this model.
        """
        self._data, self._nv, self.latches = data, model.nv, tuple(latches)
        ends = np.cumsum([0, *(each.count for each in latches)]).tolist()
        self.parts = [slice(start, end) for start, end in pairwise(ends)]
        ids: dict[int, int] = {}
        self._places = []
        for latch, part in zip(latches, self.parts, strict=True):
            a, b = (each if bodies is None else bodies[each] for each in (latch.first, latch.second))
            on_a, on_b = chain(model, a), chain(model, b)
            together = bool(model.body_rootid[a] == model.body_rootid[b])
            linear, angular = latch.stopped[:, :3], LENGTH_M * latch.stopped[:, 3:]
            components = np.concatenate((linear, angular)) @ latch.axes_in_first.T
            about_axis = bool(not latch.stopped[:, 5].any() and latch.stopped[:, 3].any())
            if together:
                on_a, on_b = np.zeros(model.nv), on_b - on_a
            first, second = (ids.setdefault(body, len(ids)) for body in (a, b))
            self._places.append(_Place(latch, first, second, on_a, on_b, together, components, about_axis, part))
        self._ids = [*ids]
        self._twists = BodyTwists(model, data, self._ids)
        self._screws = data.cdof.T
        self._xpos, self._xmat = [data.xpos[i] for i in self._ids], [data.xmat[i].reshape(3, 3) for i in self._ids]

    def at_state(self) -> LatchRows:
        """Rows at the state in ``data``; positions and velocities must be current."""
        J, gamma = np.empty((self.parts[-1].stop, self._nv)), np.empty(self.parts[-1].stop)
        twists, screws = self._twists.at_state(), self._screws
        for place in self._places:
            n, a, b = place.latch.count, twists[place.first], twists[place.second]
            rows = place.components.dot(self._xmat[place.first].T)
            linear, angular = rows[:n], rows[n:]
            point = self._point(place)
            arm_b = _minus(point, b.centre)
            X = _about(linear, angular, arm_b)
            np.dot(X, screws * place.on_second, out=J[place.part])
            if not place.together:
                J[place.part] -= _about(linear, angular, _minus(point, a.centre)).dot(screws * place.on_first)
            along, turning = _relative_acceleration(a, b, _minus(point, a.centre), arm_b)
            gamma[place.part] = linear.dot(along) + angular.dot(turning)
        return LatchRows(J, gamma)

    def errors(self) -> FloatArray:
        """Errors in position of the rows at the state in ``data``, m, (n,)."""
        found = np.empty(self.parts[-1].stop)
        for place in self._places:
            latch, frame, n = place.latch, self._xmat[place.first], place.latch.count
            axes, turned = frame.dot(latch.axes_in_first).T.tolist(), self._xmat[place.second].dot(latch.axes_in_second)
            offset = np.array(self._point(place)) - self._xpos[place.first] - frame.dot(latch.point_in_first)
            crosses = [_cross((a, b, c), (x, y, z)) for (a, b, c), (x, y, z) in zip(axes, turned.T.tolist(), strict=True)]
            # Half the sum of the cross products of equal axes: the rotation vector to second order in the error.
            rotation = crosses[2] if place.about_axis else [0.5 * sum(each) for each in zip(*crosses, strict=True)]
            rows = place.components.dot(frame.T)
            found[place.part] = rows[:n].dot(offset) + rows[n:].dot(rotation)
        return found

    def wrench(self, which: int, forces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point in m, force in N and torque about it in N m on body b of a latch, world axes.

        Args:
            which: Number of the latch.
            forces: Forces of all rows, (n,).
        """
        place = self._places[which]
        rows, own, n = place.components.dot(self._xmat[place.first].T), forces[place.part], place.latch.count
        return np.array(self._point(place)), own.dot(rows[:n]), own.dot(rows[n:])

    def _point(self, place: _Place) -> Vector:
        x, y, z = (self._xpos[place.second] + self._xmat[place.second].dot(place.latch.point_in_second)).tolist()
        return x, y, z


def _about(linear: FloatArray, angular: FloatArray, arm: Vector) -> FloatArray:
    """Map from a twist (angular, linear) about a centre to components at a point at ``arm`` from there, (n, 6)."""
    return np.concatenate((angular + linear.dot(skew(np.array(arm)).T), linear), axis=1)


def _relative_acceleration(a: BodyTwist, b: BodyTwist, arm_a: Vector, arm_b: Vector) -> tuple[Vector, Vector]:
    """Vectors whose components are the rates of the linear and angular rows at zero generalised acceleration."""
    own, other = _plus(b.velocity, _cross(b.omega, arm_b)), _plus(a.velocity, _cross(a.omega, arm_a))
    linear = _minus(_plus(b.acceleration, _cross(b.alpha, arm_b)), _plus(a.acceleration, _cross(a.alpha, arm_a)))
    linear = _plus(linear, _minus(_cross(b.omega, own), _cross(a.omega, other)))
    relative = _minus(own, other)
    linear = _minus(linear, _cross(a.omega, _plus(relative, relative)))
    return linear, _minus(_minus(b.alpha, a.alpha), _cross(a.omega, b.omega))


def _plus(v: Vector, w: Vector) -> Vector:
    return v[0] + w[0], v[1] + w[1], v[2] + w[2]


def _minus(v: Vector, w: Vector) -> Vector:
    return v[0] - w[0], v[1] - w[1], v[2] - w[2]


def _cross(v: Vector, w: Vector) -> Vector:
    return v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]
