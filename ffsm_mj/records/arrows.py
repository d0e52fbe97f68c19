"""Arrows of forces and torques: the columns of a row that hold them, as contact models declare them."""

from __future__ import annotations

from typing import NamedTuple

from ffsm_mj.arrays import IntArray


class ArrowColumns(NamedTuple):
    """Columns of a force or torque and of its point of application.

    Attributes:
        name: Name of the arrow in viewers.
        meaning: Description for legends, such as ``contact force``.
        vector: Columns of the force or torque, in world axes, (3,).
        point: Columns of its point of application in world axes, (3,), m; NaN in rows in which nothing acts.
        size: Column of its magnitude; None if there is none.
        unit: ``N``, or ``N m`` for a torque.
        is_part: Whether it is a part of another arrow at the same point, as friction is of the contact force.
    """

    name: str
    meaning: str
    vector: IntArray
    point: IntArray
    size: int | None = None
    unit: str = "N"
    is_part: bool = False

    @property
    def is_torque(self) -> bool:
        """Whether the arrow is that of a torque."""
        return self.unit != "N"
