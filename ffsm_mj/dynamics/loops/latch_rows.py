"""Rows of latches: the relative velocities that they stop, the rates of these rows, and their errors in position.

The rows of a latch are components c of the twist (u, w) of body b relative to body a at P_b, the point of b: rows of both
bodies at one point conserve angular momentum. The axes are fixed in a. With (a, alpha) the relative acceleration of the
material points at P_b and omega_a the angular velocity of a,

    d/dt (c . u) = c . a - 2 c . (omega_a x u),        d/dt (c . w) = c . alpha - c . (omega_a x w)

Rows of rotation are multiplied by a length, so that all rows are speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import LatchedBodies

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
    """One latch in a model: its bodies, its rows, and their components along axes fixed in a.

    Of each row a linear component is followed by an angular one, (2n, 3). ``turn`` is the sum of the products of equal axes
    of both bodies, with the weights of the errors in orientation, (3, 3).
    """

    latch: LatchedBodies
    first: int
    second: int
    part: slice
    stops: int
    components: FloatArray
    turn: FloatArray


class LatchRowEvaluator:
    """Evaluates the rows of some latches of a model, state by state.

    Attributes:
        parts: Rows of each latch.
    """

    def __init__(self, model: Any, data: Any, latches: Sequence[LatchedBodies], bodies: Sequence[int]) -> None:
        """Take views of the arrays of ``data``, which MuJoCo does not move.

        Args:
            model: MuJoCo model.
            data: Its data.
            latches: The latches.
            bodies: Id in this model of each body that the latches name.
        """
        self._model, self._data, self._qvel = model, data, data.qvel
        ends = np.cumsum([0, *(each.count for each in latches)]).tolist()
        self.parts = [slice(start, end) for start, end in pairwise(ends)]
        self._shape = ends[-1], model.nv
        self._places = []
        for latch, part in zip(latches, self.parts, strict=True):
            both = latch.stopped.reshape(-1, 2, 3) * np.array((1.0, LENGTH_M))[:, None]
            components = (both @ latch.axes_in_first.T).reshape(-1, 3)
            # Half the sum of the cross products of equal axes is the rotation vector to second order in the error; where
            # a rotation is free, the cross product of its axes is what is left of it.
            about_axis = not latch.stopped[:, 5].any() and latch.stopped[:, 3].any()
            axes = [2] if about_axis else [0, 1, 2]
            turn = latch.axes_in_first[:, axes] @ latch.axes_in_second[:, axes].T / (1.0 if about_axis else 2.0)
            ids = bodies[latch.first], bodies[latch.second]
            self._places.append(_Place(latch, *ids, part, latch.count, components, turn))
        self._own: FloatArray = np.empty((6, model.nv))
        self._other: FloatArray = np.empty((6, model.nv))
        self._outputs = [(rows[:3], rows[3:]) for rows in (self._own, self._other)]

    def at_state(self) -> LatchRows:
        """Rows at the state in ``data``; positions and velocities must be current."""
        J, gamma = np.empty(self._shape), np.empty(self._shape[0])
        for place in self._places:
            point, rows = self._point(place), self._rows(place)
            relative, omega = self._relative(mujoco.mj_jac, place, point)
            np.dot(rows, relative, out=J[place.part])
            u, v, w, p, q, r = relative.dot(self._qvel).tolist()
            x, y, z = omega.dot(self._qvel).tolist()
            rates = self._relative(mujoco.mj_jacDot, place, point)[0].dot(self._qvel)
            turning = 2.0 * (y * w - z * v), 2.0 * (z * u - x * w), 2.0 * (x * v - y * u)
            rates -= (*turning, y * r - z * q, z * p - x * r, x * q - y * p)
            gamma[place.part] = rows.dot(rates)
        return LatchRows(J, gamma)

    def _relative(self, jacobian: Callable[..., None], place: _Place, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Jacobian of b less that of a at a point, or its rate, (6, nv), and the angular part of a; until the next call."""
        for output, body in zip(self._outputs, (place.second, place.first), strict=True):
            jacobian(self._model, self._data, *output, point, body)
        self._own -= self._other
        return self._own, self._other[3:]

    def _rows(self, place: _Place) -> FloatArray:
        """Components of a twist (linear, angular) that a latch stops, world axes, (n, 6)."""
        rows: FloatArray = place.components.dot(self._frame(place.first).T).reshape(place.stops, 6)
        return rows

    def _frame(self, body: int) -> FloatArray:
        frame: FloatArray = self._data.xmat[body].reshape(3, 3)
        return frame

    def errors(self) -> FloatArray:
        """Errors in position of the rows at the state in ``data``, m, (n,)."""
        found, xpos = np.empty(self._shape[0]), self._data.xpos
        for place in self._places:
            latch, frame = place.latch, self._frame(place.first)
            offset = self._point(place) - xpos[place.first] - frame.dot(latch.point_in_first)
            # Sums of products of the axes of both bodies: their antisymmetric part is the sum of cross products.
            (_, c, e), (d, _, g), (f, h, _) = frame.dot(place.turn).dot(self._frame(place.second).T).tolist()
            found[place.part] = self._rows(place).dot((*offset.tolist(), g - h, f - e, c - d))
        return found

    def wrench(self, which: int, forces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point in m, force in N and torque about it in N m on body b of a latch, world axes.

        Args:
            which: Number of the latch.
            forces: Forces of all rows, (n,).
        """
        place = self._places[which]
        wrench = forces[place.part].dot(self._rows(place))
        return self._point(place), wrench[:3], wrench[3:]

    def _point(self, place: _Place) -> FloatArray:
        point: FloatArray = self._frame(place.second).dot(place.latch.point_in_second)
        point += self._data.xpos[place.second]
        return point
