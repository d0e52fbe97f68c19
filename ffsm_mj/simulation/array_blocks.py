"""Memory of arrays: which array, or field of MuJoCo data, an array is a view of."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

_Part = tuple[int, int, Any, str]
"""First and last address, the object that owns the memory, and the name of its field."""


class ArrayBlocks:
    """Blocks of memory that belong to some objects."""

    def __init__(self, objects: Iterable[Any]) -> None:
        """Note the blocks of arrays that own their memory, and of the fields of MuJoCo data and models."""
        self._blocks = sorted((block for each in objects for block in _blocks(each)), key=lambda block: block[:2])
        self._starts = [start for start, *_ in self._blocks]

    def reduced(self, array: np.ndarray[Any, Any]) -> Any:
        """How to pickle an array that is a view: as one of a block, or else of the array whose memory it shows.

        NotImplemented for one that shows other memory, which is copied.
        """
        low, high = np.lib.array_utils.byte_bounds(array)
        place = bisect_right(self._starts, low) - 1
        start, end, owner, field = self._blocks[place] if place >= 0 else (0, 0, None, "")
        if not array.size or high > end:
            if not isinstance(array.base, np.ndarray) or not array.base.flags.forc:
                return NotImplemented
            owner, field, start = array.base, "", _address(array.base)
        offset = _address(array) - start
        return view, (owner, field, offset, array.shape, array.strides, array.dtype, array.flags.writeable)


def view(
    owner: Any, field: str, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], dtype: Any, writeable: bool
) -> np.ndarray[Any, Any]:
    """View of the memory of an array, or of a field of MuJoCo data."""
    whole = getattr(owner, field) if field else owner
    flat = np.lib.stride_tricks.as_strided(whole, (whole.size,), (whole.itemsize,)).view(np.uint8)
    made: np.ndarray[Any, Any] = np.ndarray(shape, dtype, flat.data, offset, strides)
    made.flags.writeable = writeable
    return made


def _address(array: np.ndarray[Any, Any]) -> int:
    return int(array.__array_interface__["data"][0])


def _blocks(owner: Any) -> list[_Part]:
    if isinstance(owner, np.ndarray):
        is_block = owner.base is None and owner.size and owner.dtype != object and owner.flags.forc
        return [(*np.lib.array_utils.byte_bounds(owner), owner, "")] if is_block else []
    if not isinstance(owner, (mujoco.MjData, mujoco.MjModel)):
        return []
    fields = ((name, getattr(owner, name)) for name in dir(owner) if not name.startswith("_"))
    # Some fields are copies, whose memory soon belongs to other arrays.
    arrays = [(name, each) for name, each in fields if isinstance(each, np.ndarray) and each.size and not each.flags.owndata]
    return [(*np.lib.array_utils.byte_bounds(each), owner, name) for name, each in arrays]
