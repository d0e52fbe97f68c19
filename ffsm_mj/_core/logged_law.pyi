from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj._core.tick import TickLaw
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.replay.replayed_rows import LoggedRows

class LoggedLaw(TickLaw):
    def __init__(
        self, data: Any, effort: FloatArray, powered: npt.NDArray[np.bool_], copied: IntArray, copy: FloatArray
    ) -> None: ...
    def begin(self, logged: LoggedRows, predicted: FloatArray) -> None: ...
    def go_to(self, line: int) -> None: ...
