"""Contents of MuJoCo data and models that change in a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

_EMPTY = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
_OF_SOLVER = ("efc_", "iefc_", "dof_island", "island_", "map_", "tendon_efcadr", "tree_", "contact")
"""Fields of MuJoCo's own constraints and contacts, of which nothing lasts from one step to the next."""
_NUMBERS = ("time", "flg_")
"""The time, and which quantities are computed at the present state."""
_ARRAYS = frozenset(
    name
    for name, value in ((name, getattr(_EMPTY, name)) for name in dir(_EMPTY) if not name.startswith("_"))
    if isinstance(value, np.ndarray)
)


@dataclass(frozen=True)
class Fields:
    """Arrays and numbers of a MuJoCo struct.

    Attributes:
        is_kept: Whether a field is saved, by name.
    """

    is_kept: Callable[[str], bool]

    def content(self, struct: Any) -> dict[str, Any]:
        """Copies of arrays, and numbers, by name."""
        return {
            name: value.copy() if isinstance(value, np.ndarray) else value
            for name in dir(struct)
            if self.is_kept(name) and isinstance(value := getattr(struct, name), (np.ndarray, int, float))
        }

    def write(self, struct: Any, content: dict[str, Any]) -> None:
        """Write them back."""
        for name, value in content.items():
            if isinstance(value, np.ndarray):
                getattr(struct, name)[...] = value
            else:
                setattr(struct, name, value)


def _is_of_state(name: str) -> bool:
    return name.startswith(_NUMBERS) or (name in _ARRAYS and not name.startswith(_OF_SOLVER))


DATA = Fields(_is_of_state)
MODEL = Fields(("body_pos", "body_quat").__contains__)
"""The pose of a grasped object on the hand is written into the model when a grasp closes."""
