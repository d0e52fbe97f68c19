"""Reaction wheels and thrusters of a spacecraft: where they sit, how they point, and what they can do together.

Wheels are three along the axes, or more with their axes on a cone about z: four are the usual pyramid. On a cone of half
angle atan(sqrt 2) any number of them, evenly spread, is equally strong about all axes: sum a a^T = n/3.

Thrusters push the bus, at the corners of its hull or in pairs on its faces. With the signs s of a corner, jets along
-(a s_x, b s_y, c s_z) turn it by products of two signs. The six functions s_x, s_y, s_z, s_y s_z, s_z s_x, s_x s_y of the
eight corners are orthogonal and each sums to zero, so that forces and torques of jets that only push reach every direction.
"""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError

WHEELS = range(3, 13)
THRUSTERS = (6, 8, 12, 16, 24)
_CANT = (1.0, 2.0, 3.0)
"""Components of a canted jet along the axes, of any length: no two are alike, so that each jet turns the bus."""
_INSET = 0.8
"""Place of a jet of a pair on a face, of the way from the middle of the face to its edge."""
_RANK = 1e-9
"""Singular value of unit columns, over the largest, that counts as zero: they are known to rounding."""


class Jet(NamedTuple):
    """A thruster.

    Attributes:
        place: Where it sits, of half the edges of the bus, (3,).
        push: Unit vector along which it pushes the bus, (3,).
    """

    place: tuple[float, ...]
    push: tuple[float, ...]


def wheel_axes(count: int) -> list[tuple[float, ...]]:
    """Spin axes of some wheels, unit vectors in the axes of the bus.

    Raises:
        InputError: Too few to turn the bus about every axis, or too many.
    """
    if count not in WHEELS:
        raise InputError(
            f"new: --wheels: {count} is not possible; allowed: {WHEELS.start} (along the axes), 4 (a pyramid) to "
            f"{WHEELS.stop - 1} (on a cone); fewer cannot turn the bus about every axis"
        )
    if count == WHEELS.start:
        return [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    across, along = math.sqrt(2.0 / 3.0), math.sqrt(1.0 / 3.0)
    angles = [2.0 * math.pi * (i + 0.5) / count for i in range(count)]
    return [(across * math.cos(angle), across * math.sin(angle), along) for angle in angles]


def jets(count: int) -> list[Jet]:
    """Thrusters of a bus.

    Raises:
        InputError: There is no layout of so many.
    """
    if count not in THRUSTERS:
        allowed = ", ".join(map(str, THRUSTERS))
        raise InputError(f"new: --thrusters: {count} is not possible; allowed: {allowed}")
    if count == THRUSTERS[0]:  # through the centre: they push, and wheels turn
        return [_on_face(axis, side, 0.0) for axis in range(3) for side in (1, -1)]
    if count == 12:  # couples about each axis, by pairs on opposite faces
        return [_on_face(axis, side, end) for axis in range(3) for side in (1, -1) for end in (_INSET, -_INSET)]
    corners = list(product((1.0, -1.0), repeat=3))
    if count == 24:  # three at each corner, along the axes
        return [
            Jet(corner, tuple(-s * (i == axis) for i, s in enumerate(corner))) for corner in corners for axis in range(3)
        ]
    length = math.hypot(*_CANT)
    cants = [_CANT, (*_CANT[1:], _CANT[0])][: count // 8]  # 16: two at each corner
    return [Jet(c, tuple(-s * part / length for s, part in zip(c, cant, strict=True))) for c in corners for cant in cants]


def _on_face(axis: int, side: int, end: float) -> Jet:
    """A jet on a face, off its middle along the next axis; it pushes the face inwards."""
    place, push = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    place[axis], push[axis] = float(side), float(-side)
    place[(axis + 1) % 3] = end
    return Jet(tuple(place), tuple(push))


class Authority(NamedTuple):
    """What thrusters and wheels can do.

    Attributes:
        wrench: Whether the thrusters alone can give any force together with any torque.
        torque: Whether the wheels can turn it every way.
        rank: Rank of the columns of force and torque of thrusters and wheels, 6 at most.
        weakest: Smallest over largest singular value of these columns, torques by half the mean edge of the bus.
    """

    wrench: bool
    torque: bool
    rank: int
    weakest: float


def authority(columns: FloatArray, axes: FloatArray) -> Authority:
    """What thrusters and wheels can do, by the columns that an allocation works with.

    Args:
        columns: Force, and torque over a length, of each thruster that only pushes, (6, n).
        axes: Spin axis of each wheel, which turns both ways, (3, m).
    """
    every = np.hstack((columns, np.vstack((np.zeros_like(axes), axes))))
    values = np.linalg.svd(every, compute_uv=False)
    rank = int((values > _RANK * values[0]).sum())
    weakest = float(values[-1] / values[0]) if len(values) == 6 else 0.0
    by_wheels = np.linalg.matrix_rank(axes, tol=_RANK) == 3
    return Authority(_reaches_all(columns), bool(by_wheels), rank, weakest)


def _reaches_all(columns: FloatArray) -> bool:
    """Whether non-negative shares of columns give every vector: they have full rank, and some positive shares give none.

    Positive shares that add up to nothing exist if the columns come to nothing with shares of at least one each.
    """
    from scipy.optimize import nnls  # half a second to import

    if np.linalg.matrix_rank(columns, tol=_RANK) < len(columns):
        return False
    total = columns.sum(axis=1)
    return bool(nnls(columns, -total)[1] <= _RANK * np.linalg.norm(columns))
