from collections.abc import Sequence

from ffsm_mj._core.forces import ActiveForces
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact_models.persistent.contact_points import Extremes, SingleState
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops

class RowMemory:
    unclosed: FloatArray | None
    def array(self, name: str) -> FloatArray: ...
    def resultants(self, forces: FloatArray) -> FloatArray: ...

class PointRows:
    groups: Sequence[SingleState]
    memory: RowMemory
    active: dict[tuple[bytes, bytes], ActiveForces]
    loop_rates: FloatArray | None
    J: FloatArray
    gamma: FloatArray
    response: FloatArray
    G: FloatArray
    axes: FloatArray
    qvel: FloatArray
    states: tuple[FeatureState, ...]
    extremes: Extremes
    slips: FloatArray
    speed_rounding: FloatArray
    gaps: list[float]
    rates: list[float]
    scales: list[float]
    insides: list[float]
    def __init__(self, groups: Sequence[SingleState], memory: RowMemory) -> None: ...
    def close_loops(self, loops: ClosedLoops) -> None: ...
    def wrenches(self, forces: FloatArray) -> FloatArray: ...
    def resultant(
        self, part: slice, forces: FloatArray, friction: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]: ...
    def largest_slip(self, which: BoolArray) -> float: ...
    def across(self, components: FloatArray) -> FloatArray: ...
