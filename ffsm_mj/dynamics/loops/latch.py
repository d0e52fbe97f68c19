"""A latch between two bodies of one model, as what is fixed in each of them at the closing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

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
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.asarray(quaternion, dtype=np.float64))
        R = turn.reshape(3, 3)
        point = np.asarray(position, dtype=np.float64) + R @ point_in_second
        return cls(
            bodies[0], bodies[1], point, np.array(point_in_second), np.array(axes_in_first), R.T @ axes_in_first, stopped
        )

    @property
    def count(self) -> int:
        """Number of components that it stops."""
        return len(self.stopped)


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
