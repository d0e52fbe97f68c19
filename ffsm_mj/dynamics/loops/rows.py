"""Bilateral rows of a model: relative motions that vanish, as linear functions of the generalised velocity.

A source of rows says what is constrained in the bodies, joints and tendons of the logged system; bound to a model, which may
be another one that represents this system, it evaluates rows J with J qdot = 0, and their rates J qddot + gamma = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from ffsm_mj.arrays import FloatArray


class Rows(NamedTuple):
    """Rows at one state.

    Attributes:
        J: Constrained velocities as functions of the generalised velocity, (n, nv).
        gamma: Their rates at zero generalised acceleration, (n,).
    """

    J: FloatArray
    gamma: FloatArray


class BoundRows(Protocol):
    """Rows of one source in a model, at the state in its data; positions and velocities must be current."""

    @property
    def count(self) -> int:
        """Number of rows n."""

    def evaluate(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write the rows, (n, nv), and their rates at zero generalised acceleration, (n,)."""

    def errors(self) -> FloatArray:
        """Errors in position of the rows, (n,): m, or rad for a hinge that another one leads."""


class RowSource(Protocol):
    """What is constrained, in ids of the logged system."""

    @property
    def count(self) -> int:
        """Number of rows."""

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundRows:
        """Rows in a model.

        Args:
            model: MuJoCo model.
            data: Its data.
            bodies: Id in this model of each body of the logged system.
            dofs: Index in this model of each degree of freedom of the logged system.
        """
