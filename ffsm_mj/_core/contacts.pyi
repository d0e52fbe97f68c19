from collections.abc import Callable, Sequence

from ffsm_mj._core.rows import RowEvaluator
from ffsm_mj._core.stages import Smooth
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.point_modes import PointModes
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.friction.solution import Solution
from ffsm_mj.contact_models.persistent.point_rows import ContactRows, FrictionalRows

class ContactAcceleration:
    rows: ContactRows
    free: FloatArray
    force: FloatArray
    rounding: list[float]
    def __init__(self, M: Callable[[], FloatArray] | None, rows: ContactRows, force: FloatArray) -> None: ...
    def pushing(self, forces: FloatArray) -> list[int]: ...
    def own_acceleration(self, forces: FloatArray) -> FloatArray: ...
    def gap_accelerations(self, forces: FloatArray) -> FloatArray: ...
    def bilateral_forces(self, which: Sequence[int]) -> FloatArray: ...
    def validity(self, which: Sequence[int]) -> float: ...
    def stage(self, qvel: FloatArray) -> tuple[Stage, FloatArray]: ...
    def unilateral_forces(self, expected: Sequence[int] = ()) -> FloatArray: ...

class FrictionState:
    contact_points: tuple[ContactPoint, ...]
    rows: FrictionalRows
    force: FloatArray
    modes: PointModes
    problem: FrictionProblem
    rounding: FloatArray
    def __init__(
        self, contact_points: tuple[ContactPoint, ...], rows: FrictionalRows, force: FloatArray, modes: PointModes
    ) -> None: ...
    def sticking(self) -> Solution | None: ...
    def limit_ratios(self, forces: FloatArray) -> list[float]: ...
    def stage_here(self) -> tuple[Stage, FloatArray]: ...

class StageForces:
    contact_points: tuple[ContactPoint, ...]
    modes: PointModes | None
    def __init__(
        self, smooth: Smooth, evaluator: RowEvaluator, contact_points: tuple[ContactPoint, ...], modes: PointModes | None
    ) -> None: ...
    def add(self, applied: FloatArray) -> Stage: ...
