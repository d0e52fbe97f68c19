"""Latches as bilateral rows: the relative velocities that they stop, the rates of these rows, and their errors in position.

A latch joins bodies a and b at a point P, fixed in each of them at the closing, with axes fixed in a. Its rows are
components c of the relative twist (u, w) of b and a at P_b, the point of b: rows of both bodies at one point keep the
angular momentum. With (a, alpha) the relative acceleration of the material points at P_b and om_a the spin of a,

    d/dt (c . u) = c . a - 2 c . (om_a x u),        d/dt (c . w) = c . alpha - c . (om_a x w)

Rows of rotation are multiplied by a length, so that all singular values are speeds.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray


@dataclass(frozen=True)
class LatchedBodies:
    """Two bodies joined by a latch, by what is fixed in each of them.

    Attributes:
        first: Id of body a, in which the axes are fixed.
        second: Id of body b.
        point_in_first: P in the frame of a, m, (3,).
        point_in_second: P in the frame of b, m, (3,).
        axes_in_first: Axes of the latch in the frame of a, by column; the last one is that of a hinge or slide, (3, 3).
        axes_in_second: The same axes at the closing in the frame of b, (3, 3).
        stopped: Components of the relative twist along these axes that it stops, linear ones first, (n, 6).
    """

    first: int
    second: int
    point_in_first: FloatArray
    point_in_second: FloatArray
    axes_in_first: FloatArray
    axes_in_second: FloatArray
    stopped: FloatArray

    @classmethod
    def at(
        cls, data: Any, bodies: tuple[int, int], point: FloatArray, axes: FloatArray, stopped: FloatArray
    ) -> LatchedBodies:
        """Join two bodies at the state in ``data``.

        Args:
            data: MuJoCo data with current kinematics.
            bodies: Ids of a and b.
            point: P, world axes, m, (3,).
            axes: Axes of the latch by column, world axes, (3, 3).
            stopped: Components along these axes that it stops, (n, 6).
        """
        frames = [_frame(data, body) for body in bodies]
        points = [frame.T @ (point - data.xpos[body]) for frame, body in zip(frames, bodies, strict=True)]
        first, second = (frame.T @ axes for frame in frames)
        return cls(bodies[0], bodies[1], points[0], points[1], first, second, stopped)


def stopped_along_axes(kind: str) -> FloatArray:
    """Components along the axes of a latch that it stops, (n, 6): its axis is the last one."""
    free = {
        "rigid": [],
        "ball": [3, 4, 5],
        "hinge": [5],
        "slide": [2],
        "cylindrical": [2, 5],
    }[kind]
    return np.delete(np.eye(6), free, axis=0)


class LatchRows:
    """Rows of some latches at one state.

    Attributes:
        rows: Stopped relative velocities as functions of qvel, (n, nv).
        rates: Their rates of change at zero acceleration, (n,).
        errors: Errors in position, m, (n,).
        parts: Rows of each latch.
    """

    def __init__(self, model: Any, data: Any, latches: tuple[LatchedBodies, ...], length_m: float = 1.0) -> None:
        """Evaluate the rows of latches at the state in ``data``, positions and velocities current.

        Args:
            model: MuJoCo model.
            data: Its data.
            latches: The latches.
            length_m: Length by which rows of rotation are multiplied.
        """
        found = [_rows_of(model, data, latch, length_m) for latch in latches]
        self.rows = np.concatenate([np.empty((0, model.nv)), *(each[0] for each in found)])
        self.rates = np.concatenate([np.empty(0), *(each[1] for each in found)])
        self.errors = np.concatenate([np.empty(0), *(each[2] for each in found)])
        ends = np.cumsum([0, *(len(each[1]) for each in found)]).tolist()
        self.parts = [slice(start, end) for start, end in pairwise(ends)]
        self._latches, self._data, self._length_m = latches, data, length_m

    def wrench(self, which: int, force: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Point, force and torque on body b of one latch for the forces of all rows, world axes.

        Args:
            which: Number of the latch.
            force: Forces of all rows, (n,).
        """
        latch = self._latches[which]
        axes = _frame(self._data, latch.first) @ latch.axes_in_first
        along = force[self.parts[which]] @ latch.stopped
        return _point_of_second(self._data, latch), axes @ along[:3], self._length_m * (axes @ along[3:])


def _rows_of(model: Any, data: Any, latch: LatchedBodies, length_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows, their rates at zero acceleration, and errors in position of one latch."""
    frame, other = _frame(data, latch.first), _frame(data, latch.second)
    axes, turned = frame @ latch.axes_in_first, other @ latch.axes_in_second
    point = _point_of_second(data, latch)
    J, rate, spin = np.zeros((6, model.nv)), np.zeros((6, model.nv)), np.empty((3, model.nv))
    part = np.empty((6, model.nv))
    for body, sign in ((latch.second, 1.0), (latch.first, -1.0)):
        mujoco.mj_jac(model, data, part[:3], part[3:], point, body)
        J += sign * part
        mujoco.mj_jacDot(model, data, part[:3], part[3:], point, body)
        rate += sign * part
    mujoco.mj_jacBody(model, data, None, spin, latch.first)
    twist, om = J @ data.qvel, spin @ data.qvel
    bias = rate @ data.qvel - np.concatenate((2.0 * np.cross(om, twist[:3]), np.cross(om, twist[3:])))
    offset = point - data.xpos[latch.first] - frame @ latch.point_in_first
    # Half the sum of the cross products of equal axes: the rotation vector to second order in the error.
    rotation = 0.5 * np.cross(axes.T, turned.T).sum(axis=0)
    if not latch.stopped[:, 5].any() and latch.stopped[:, 3].any():  # free about the last axis
        rotation = np.cross(axes[:, 2], turned[:, 2])
    along = np.zeros((6, 6))
    along[:3, :3], along[3:, 3:] = axes.T, length_m * axes.T
    stopped = latch.stopped @ along
    return stopped @ J, stopped @ bias, stopped @ np.concatenate((offset, rotation))


def _frame(data: Any, body: int) -> FloatArray:
    return np.asarray(data.xmat[body].reshape(3, 3))


def _point_of_second(data: Any, latch: LatchedBodies) -> FloatArray:
    return np.asarray(data.xpos[latch.second] + _frame(data, latch.second) @ latch.point_in_second)
