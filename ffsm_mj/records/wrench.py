"""A force on a body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray

_NO_TORQUE = np.zeros(3)


class Wrench(NamedTuple):
    """What acts on a body at a point, in world axes.

    Attributes:
        body: Id of the body.
        point: Where the force acts, m, (3,).
        force: N, (3,).
        torque: N m, beside the moment of the force, (3,).
    """

    body: int
    point: FloatArray
    force: FloatArray
    torque: FloatArray = _NO_TORQUE
