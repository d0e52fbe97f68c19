from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.actuation.actuation import Envelope
from ffsm_mj.arrays import FloatArray

class Sampler:
    jacp: FloatArray
    jacr: FloatArray
    twist: FloatArray
    def __init__(self, model: Any, data: Any, *, base: int = -1, tip: int = -1) -> None: ...
    def copy(self, copies: Sequence[tuple[FloatArray, FloatArray]]) -> None: ...
    def take(self, line: int) -> None: ...

class JointWork:
    def __init__(self, data: Any, on_joint: FloatArray, external: FloatArray, account: FloatArray) -> None: ...
    def open(self) -> bool: ...
    def close(self) -> None: ...

class Limits:
    def __init__(
        self,
        envelope: Envelope,
        effort: FloatArray,
        powered: npt.NDArray[np.bool_],
        velocity: FloatArray,
        table: FloatArray,
        ctrl: FloatArray,
    ) -> None: ...
    def apply(self) -> bool: ...
