"""Contents of MuJoCo data and models that change in a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.model.grasp import WRITTEN

_OF_SOLVER = ("efc_", "iefc_", "dof_island", "island_", "map_", "tendon_efcadr", "tree_", "contact")
"""Fields of MuJoCo's own constraints and contacts, of which nothing lasts from one step to the next."""
_NUMBERS = ("time", "flg_")
"""The time, and which quantities are computed at the present state."""


@dataclass(frozen=True)
class Fields:
    """Arrays and numbers of a MuJoCo struct.

    Attributes:
        is_kept: Whether a field is saved, by name.
    """

    is_kept: Callable[[str], bool]

    def content(self, struct: Any) -> dict[str, Any]:
        """Copies of arrays, and numbers, by name."""
        values = ((name, getattr(struct, name)) for name in dir(struct) if self.is_kept(name))
        return {
            name: value.copy() if isinstance(value, np.ndarray) else value
            for name, value in values
            if isinstance(value, np.ndarray) or (isinstance(value, (int, float)) and name.startswith(_NUMBERS))
        }

    def write(self, struct: Any, content: dict[str, Any]) -> None:
        """Write them back."""
        for name, value in content.items():
            if isinstance(value, np.ndarray):
                getattr(struct, name)[...] = value
            else:
                setattr(struct, name, value)


def _is_of_state(name: str) -> bool:
    return not name.startswith(("_", *_OF_SOLVER))


DATA = Fields(_is_of_state)
MODEL = Fields(WRITTEN.__contains__)
"""The pose of a grasped object on the hand, and the latch's joints, are written into the model when a grasp closes."""
