from collections.abc import Sequence
from typing import Any

from ffsm_mj._core.riccati_doubling import Doubling
from ffsm_mj._core.riccati_planar import PlanarRiccati
from ffsm_mj.arrays import FloatArray

class TipKinematics:
    J: FloatArray
    jac_dot: FloatArray
    W: FloatArray
    point: FloatArray
    def __init__(self, model: Any, data: Any, site: int, axes: Sequence[int]) -> None: ...
    def update(self) -> None: ...

class PlanarLaw:
    effort: FloatArray
    report: FloatArray
    def __init__(
        self,
        kinematics: TipKinematics,
        data: Any,
        riccati: PlanarRiccati,
        driven: FloatArray,
        axes: Sequence[int],
        target_m: Sequence[float],
        whole_stack: bool,
    ) -> None: ...
    def tick(self) -> None: ...

class BlockLaw:
    effort: FloatArray
    report: FloatArray
    inputs: FloatArray
    def __init__(
        self,
        kinematics: TipKinematics,
        data: Any,
        riccati: Doubling,
        driven: FloatArray,
        axes: Sequence[int],
        target_m: Sequence[float],
        whole_stack: bool,
    ) -> None: ...
    def tick(self) -> None: ...
