from collections.abc import Sequence
from typing import Any

from ffsm_mj._core.loops import LoopStage
from ffsm_mj._core.stages import Smooth
from ffsm_mj._core.tick import OnSample, SteadyForces
from ffsm_mj.arrays import FloatArray, IntArray

class SteadyLoops(SteadyForces):
    def __init__(self, rows: LoopStage) -> None: ...

class LoadSample(OnSample):
    values: FloatArray
    def __init__(self, counts: IntArray, others: Sequence[Any]) -> None: ...
    def bind(self, smooth: Smooth) -> None: ...
