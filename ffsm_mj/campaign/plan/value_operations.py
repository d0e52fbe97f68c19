"""Operations of sampled scalars on values of a scenario: plain data, no random numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.campaign.plan.dispersions import Operation

Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class ValueOperation:
    """Operation of one entry of ``dispersions`` on a value.

    Attributes:
        operation: Kind of the operation.
        columns: Columns of its scalars in a row: one, or magnitude, height and azimuth for a random axis.
        at: Position of the number in nested lists; empty if the value is a number.
        span: First and end position of a vector or quaternion.
        axis: Axis or direction of any length; None if it is sampled.
    """

    operation: Operation
    columns: tuple[int, ...]
    at: tuple[int, ...] = ()
    span: tuple[int, int] | None = None
    axis: Vector3 | None = None

    def applied(self, value: Any, row: Sequence[Any]) -> Any:
        """Apply the operation to a value; returns the new value.

        Args:
            value: Plain value of the key; not modified.
            row: Sampled scalars of the run.
        """
        sampled = row[self.columns[0]]
        if self.span is None:
            old = value
            for position in self.at:
                old = old[position]
            return _replaced(value, self.at, _number(self.operation, old, sampled))
        first, end = self.span
        direction = self._direction(row)
        part = list(value[first:end])
        if self.operation == "rotation":
            new = rotated(part, direction, sampled)
        else:
            start = part if self.operation == "vector_offset" else [0.0] * 3
            new = [s + sampled * d for s, d in zip(start, direction, strict=True)]
        return [*value[:first], *new, *value[end:]]

    def _direction(self, row: Sequence[Any]) -> Vector3:
        """Unit vector of the axis or direction."""
        if self.axis is not None:
            length = math.hypot(*self.axis)
            return (self.axis[0] / length, self.axis[1] / length, self.axis[2] / length)
        height, azimuth = row[self.columns[1]], row[self.columns[2]]
        ring = math.sqrt(max(0.0, 1.0 - height * height))
        return (ring * math.cos(azimuth), ring * math.sin(azimuth), height)


def rotated(quaternion: Sequence[float], axis: Vector3, angle: float) -> list[float]:
    """Rotate an attitude about an axis of its parent frame.

    Args:
        quaternion: Attitude (w, x, y, z), of any length except zero.
        axis: Unit vector.
        angle: Angle, rad.

    Returns:
        Unit quaternion.
    """
    s = math.sin(0.5 * angle)
    w, v = math.cos(0.5 * angle), np.array([s * a for a in axis])
    w0, v0 = quaternion[0], np.array(quaternion[1:])
    product = np.array([w * w0 - v @ v0, *(w * v0 + w0 * v + np.cross(v, v0))])
    return (product / np.linalg.norm(product)).tolist()  # type: ignore[no-any-return]


def _number(operation: Operation, old: Any, sampled: Any) -> Any:
    if operation == "scale":
        return old * sampled
    return old + sampled if operation == "offset" else sampled


def _replaced(value: Any, at: tuple[int, ...], new: Any) -> Any:
    """Copy of a value with one number replaced."""
    if not at:
        return new
    return [_replaced(item, at[1:], new) if i == at[0] else item for i, item in enumerate(value)]
