"""A latch between two bodies of one model: what is fixed in each of them at the closing, and its rows.

The rows of a latch are components c of the twist (u, w) of body b relative to body a at P_b, the point of b: rows of both
bodies at one point conserve angular momentum. The axes are fixed in a. With (a, alpha) the relative acceleration of the
material points at P_b and omega_a the angular velocity of a,

    d/dt (c . u) = c . a - 2 c . (omega_a x u),        d/dt (c . w) = c . alpha - c . (omega_a x w)

Rows of rotation are multiplied by a length, so that all rows are speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix

LENGTH_M = 1.0
"""Length by which rows of rotation are multiplied.

Where rows depend on each other, the forces are those of least norm, with forces in N and torques in N m at equal weight.
"""

_FREE = {"rigid": [], "ball": [3, 4, 5], "hinge": [5], "slide": [2], "cylindrical": [2, 5]}


@dataclass(frozen=True, eq=False)
class LatchedBodies:
    """Two bodies joined by a latch, which stops some components of their relative twist at a point of the second body.

    Attributes:
        first: Id of body a, in which the axes are fixed.
        second: Id of body b.
        point_in_first: The point at the closing in the frame of a, m, (3,).
        point_in_second: The point in the frame of b, m, (3,).
        axes_in_first: Axes of the latch in the frame of a, by column; the last one is that of a hinge or slide, (3, 3).
        axes_in_second: The same axes at the closing in the frame of b, (3, 3).
        stopped: Components of the twist of b relative to a along these axes that it stops, linear ones first, (n, 6).
    """

    first: int
    second: int
    point_in_first: FloatArray
    point_in_second: FloatArray
    axes_in_first: FloatArray
    axes_in_second: FloatArray
    stopped: FloatArray

    @classmethod
    def at_pose(
        cls,
        bodies: tuple[int, int],
        point_in_second: FloatArray,
        axes_in_first: FloatArray,
        stopped: FloatArray,
        position: Sequence[float] | FloatArray,
        quaternion: Sequence[float] | FloatArray,
    ) -> LatchedBodies:
        """Join two bodies at a relative pose: the same numbers give the same latch, bit by bit.

        Args:
            bodies: Ids of a and b.
            point_in_second: The point in the frame of b, m, (3,).
            axes_in_first: Axes of the latch in the frame of a, by column, (3, 3).
            stopped: Components along these axes that it stops, (n, 6).
            position: Position of b in the frame of a at the closing, m, (3,).
            quaternion: Orientation of b in the frame of a at the closing, (4,).
        """
        R = rotation_matrix(np.asarray(quaternion, dtype=np.float64))
        point = np.asarray(position, dtype=np.float64) + R @ point_in_second
        return cls(
            bodies[0], bodies[1], point, np.array(point_in_second), np.array(axes_in_first), R.T @ axes_in_first, stopped
        )

    @property
    def count(self) -> int:
        """Number of components that it stops."""
        return len(self.stopped)

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundLatch:  # noqa: ARG002
        """Its rows in a model; see :class:`~ffsm_mj.dynamics.loops.closed_loops.RowSource`."""
        return BoundLatch(model, data, self, bodies)


def stopped_along_axes(kind: str) -> FloatArray:
    """Components along the axes of a latch that it stops, (n, 6); its axis is the last one.

    Args:
        kind: ``rigid``, ``ball``, ``hinge``, ``slide`` or ``cylindrical``.
    """
    return np.delete(np.eye(6), _FREE[kind], axis=0)


def axes_about(axis: Sequence[float]) -> FloatArray:
    """Orthonormal axes by column of which the last one is given, (3, 3); unit axes if it is empty."""
    if not len(axis):
        return np.eye(3)
    last = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    return np.column_stack((*np.linalg.svd(last[None])[2][1:], last))


class BoundLatch:
    """Rows of one latch in a model; see :class:`~ffsm_mj.dynamics.loops.closed_loops.BoundRows`.

    Attributes:
        latch: The latch.
        first: Id of body a in the model.
        second: Id of body b in the model.
        count: Number of rows.
    """

    def __init__(self, model: Any, data: Any, latch: LatchedBodies, bodies: Sequence[int]) -> None:
        """Take views of the arrays of ``data``, which MuJoCo does not move.

        Args:
            model: MuJoCo model.
            data: Its data.
            latch: The latch.
            bodies: Id in this model of each body that the latch names.
        """
        self._model, self._data, self._qvel = model, data, data.qvel
        self.latch, self.count = latch, latch.count
        self.first, self.second = bodies[latch.first], bodies[latch.second]
        # Of each row a linear component is followed by an angular one, along axes fixed in a, (2n, 3).
        both = latch.stopped.reshape(-1, 2, 3) * np.array((1.0, LENGTH_M))[:, None]
        self._components: FloatArray = (both @ latch.axes_in_first.T).reshape(-1, 3)
        # Half the sum of the cross products of equal axes is the rotation vector to second order in the error; where a
        # rotation is free, the cross product of its axes is what is left of it.
        about_axis = not latch.stopped[:, 5].any() and latch.stopped[:, 3].any()
        axes = [2] if about_axis else [0, 1, 2]
        # Sum of the products of equal axes of both bodies, with the weights of the errors in orientation, (3, 3).
        self._turn: FloatArray = (
            latch.axes_in_first[:, axes] @ latch.axes_in_second[:, axes].T / (1.0 if about_axis else 2.0)
        )
        self._of_second: FloatArray = np.empty((6, model.nv))
        self._other: FloatArray = np.empty((6, model.nv))
        self._outputs = [(rows[:3], rows[3:]) for rows in (self._of_second, self._other)]

    def evaluate(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write rows and rates; see :class:`~ffsm_mj.dynamics.loops.closed_loops.BoundRows`."""
        point, rows = self._point(), self._rows()
        relative, omega = self._relative(mujoco.mj_jac, point)
        np.dot(rows, relative, out=J)
        u, v, w, p, q, r = relative.dot(self._qvel).tolist()
        x, y, z = omega.dot(self._qvel).tolist()
        rates = self._relative(mujoco.mj_jacDot, point)[0].dot(self._qvel)
        turning = 2.0 * (y * w - z * v), 2.0 * (z * u - x * w), 2.0 * (x * v - y * u)
        rates -= (*turning, y * r - z * q, z * p - x * r, x * q - y * p)
        gamma[:] = rows.dot(rates)

    def _relative(self, jacobian: Callable[..., None], point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Jacobian of b less that of a at a point, or its rate, (6, nv), and the angular part of a; until the next call."""
        for output, body in zip(self._outputs, (self.second, self.first), strict=True):
            jacobian(self._model, self._data, *output, point, body)
        self._of_second -= self._other
        return self._of_second, self._other[3:]

    def _rows(self) -> FloatArray:
        """Components of a twist (linear, angular) that the latch stops, world axes, (n, 6)."""
        rows: FloatArray = self._components.dot(self._frame(self.first).T).reshape(self.count, 6)
        return rows

    def _frame(self, body: int) -> FloatArray:
        frame: FloatArray = self._data.xmat[body].reshape(3, 3)
        return frame

    def errors(self) -> FloatArray:
        """Errors in position of the rows, m, (n,)."""
        latch, frame = self.latch, self._frame(self.first)
        offset = self._point() - self._data.xpos[self.first] - frame.dot(latch.point_in_first)
        # Sums of products of the axes of both bodies: their antisymmetric part is the sum of cross products.
        (_, c, e), (d, _, g), (f, h, _) = frame.dot(self._turn).dot(self._frame(self.second).T).tolist()
        return np.asarray(self._rows().dot((*offset.tolist(), g - h, f - e, c - d)))

    def wrench(self, forces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point in m, force in N and torque about it in N m on body b, world axes, for forces of the rows, (n,)."""
        wrench = forces.dot(self._rows())
        return self._point(), wrench[:3], wrench[3:]

    def _point(self) -> FloatArray:
        point: FloatArray = self._frame(self.second).dot(self.latch.point_in_second)
        point += self._data.xpos[self.second]
        return point
