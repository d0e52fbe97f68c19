"""How what was drawn changes a value of the scenario: plain data and arithmetic, no chance."""

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
    """What one entry of ``dispersions`` does to a value.

    Attributes:
        operation: What it does.
        columns: Positions in a row of what is drawn for it; one, or with a random axis its size, height and azimuth.
        at: Positions that lead to the number in a list of numbers, or of lists; empty for a value that is one number.
        span: First and last-but-one position of the numbers of a vector or quaternion.
        axis: Axis or direction, any length; None where it is drawn.
    """

    operation: Operation
    columns: tuple[int, ...]
    at: tuple[int, ...] = ()
    span: tuple[int, int] | None = None
    axis: Vector3 | None = None

    def applied(self, value: Any, row: Sequence[Any]) -> Any:
        """The value after it, lists as lists.

        Args:
            value: Plain value of the key, not changed.
            row: Everything that is drawn for the run.
        """
        drawn = row[self.columns[0]]
        if self.span is None:
            old = value
            for position in self.at:
                old = old[position]
            return _replaced(value, self.at, _number(self.operation, old, drawn))
        first, end = self.span
        direction = self._direction(row)
        part = list(value[first:end])
        if self.operation == "rotation":
            new = turned(part, direction, drawn)
        else:
            start = part if self.operation == "vector_offset" else [0.0] * 3
            new = [s + drawn * d for s, d in zip(start, direction, strict=True)]
        return [*value[:first], *new, *value[end:]]

    def _direction(self, row: Sequence[Any]) -> Vector3:
        """Unit vector."""
        if self.axis is not None:
            length = math.hypot(*self.axis)
            return (self.axis[0] / length, self.axis[1] / length, self.axis[2] / length)
        height, azimuth = row[self.columns[1]], row[self.columns[2]]
        ring = math.sqrt(max(0.0, 1.0 - height * height))
        return (ring * math.cos(azimuth), ring * math.sin(azimuth), height)


def turned(quaternion: Sequence[float], axis: Vector3, angle: float) -> list[float]:
    """A quaternion (w, x, y, z) turned on about an axis of the frame that it is told in.

    Args:
        quaternion: Of any length but zero.
        axis: Unit vector.
        angle: rad.

    Returns:
        A quaternion of length 1.
    """
    s = math.sin(0.5 * angle)
    w, v = math.cos(0.5 * angle), np.array([s * a for a in axis])
    w0, v0 = quaternion[0], np.array(quaternion[1:])
    product = np.array([w * w0 - v @ v0, *(w * v0 + w0 * v + np.cross(v, v0))])
    return (product / np.linalg.norm(product)).tolist()  # type: ignore[no-any-return]


def _number(operation: Operation, old: Any, drawn: Any) -> Any:
    if operation == "scale":
        return old * drawn
    return old + drawn if operation == "offset" else drawn


def _replaced(value: Any, at: tuple[int, ...], new: Any) -> Any:
    """The value with one number in it replaced."""
    if not at:
        return new
    return [_replaced(item, at[1:], new) if i == at[0] else item for i, item in enumerate(value)]
