from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray, IntArray

class SphereBounds:
    def __init__(self, a: IntArray, b: IntArray, radii: FloatArray, senses: FloatArray) -> None: ...
    def gaps(self, data: Any) -> FloatArray: ...

class PiecesOfBody:
    count: int
    def __init__(
        self,
        body: int,
        centres: FloatArray,
        radii: FloatArray,
        cores: FloatArray,
        widths: FloatArray,
        normals: FloatArray,
        offsets: FloatArray,
    ) -> None: ...

class PieceBounds:
    def __init__(self, a: PiecesOfBody, b: PiecesOfBody) -> None: ...
    def within(
        self, among: npt.NDArray[np.uint8], pairs: IntArray | None, data: Any, reach: float, without: int
    ) -> list[tuple[float, int]]: ...

class Instant:
    time: float
    def __init__(self, model: Any, data: Any) -> None: ...

def stay_apart(a: PiecesOfBody, i: int, b: PiecesOfBody, k: int, before: Instant, after: Instant, least: float) -> bool: ...
