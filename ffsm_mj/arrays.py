"""Types of arrays, and of what stands for them."""

from __future__ import annotations

from typing import cast

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]


def numbers(array: FloatArray) -> memoryview[float]:
    """The numbers of a contiguous array, which takes and gives single ones, and copies of few, slower than this does."""
    return cast("memoryview[float]", array.data)
