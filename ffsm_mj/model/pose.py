"""Where a model stands that does not move."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from ffsm_mj.config import StrictModel
from ffsm_mj.model.number_faults import MOST_LENGTH

_UNIT = 1e-3
Coordinate = Annotated[float, Field(ge=-MOST_LENGTH, le=MOST_LENGTH)]


class Pose(StrictModel):
    """Where a fixed body stands: the pose of its file's world frame in the scene's."""

    position_m: Annotated[tuple[Coordinate, ...], Field(min_length=3, max_length=3)] = (0.0, 0.0, 0.0)
    """Position in world axes, m."""
    quaternion: Annotated[tuple[float, ...], Field(min_length=4, max_length=4)] = (1.0, 0.0, 0.0, 0.0)
    """Orientation w, x, y, z; of length 1 to within 1e-3, made exact."""

    @field_validator("quaternion")
    @classmethod
    def _unit(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        length = np.linalg.norm(value)
        if not abs(length - 1.0) <= _UNIT:
            raise ValueError(f"the quaternion (w, x, y, z) must have length 1, it has {length:.6g}")
        return value
