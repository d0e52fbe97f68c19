from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ffsm_mj._core.fields import FieldForces
from ffsm_mj._core.riccati_doubling import Doubling
from ffsm_mj._core.riccati_planar import PlanarRiccati
from ffsm_mj._core.tick import TickLaw
from ffsm_mj.arrays import FloatArray, IntArray

Riccati = TypeVar("Riccati")

class TipKinematics:
    J: FloatArray
    jac_dot: FloatArray
    W: FloatArray
    point: FloatArray
    def __init__(self, model: Any, data: Any, site: int, axes: Sequence[int]) -> None: ...
    def update(self) -> None: ...

class OutputLaw(Generic[Riccati]):
    effort: FloatArray
    report: FloatArray
    def __init__(
        self,
        kinematics: TipKinematics,
        data: Any,
        riccati: Riccati,
        driven: FloatArray,
        axes: Sequence[int],
        target_m: Sequence[float],
        whole_stack: bool,
        extremes: FloatArray,
        damping: float,
        field: FieldForces | None = None,
    ) -> None: ...
    def tick(self) -> None: ...

class PlanarLaw(OutputLaw[PlanarRiccati]): ...
class BlockLaw(OutputLaw[Doubling]): ...

class CommandingLaw(TickLaw):
    def __init__(
        self,
        law: OutputLaw[Any],
        actuators: IntArray,
        effort: FloatArray,
        powered: npt.NDArray[np.bool_],
        places: IntArray,
        telemetry: FloatArray,
        before: Callable[[], None] | None = None,
    ) -> None: ...

def note(extremes: FloatArray, report: FloatArray) -> None: ...
