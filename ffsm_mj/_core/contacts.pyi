from ffsm_mj._core.row_evaluator import RowEvaluator
from ffsm_mj._core.rows import PointRows
from ffsm_mj._core.stages import Smooth
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.modes import PointModes
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem, Solution

class ContactEvaluation:
    contact_points: tuple[ContactPoint, ...]
    rows: PointRows
    force: FloatArray
    modes: PointModes
    problem: FrictionProblem
    rounding: FloatArray
    def __init__(
        self, contact_points: tuple[ContactPoint, ...], rows: PointRows, force: FloatArray, modes: PointModes
    ) -> None: ...
    def settled(self) -> Solution | None: ...
    def limit_ratios(self, forces: FloatArray) -> list[float]: ...
    def present_stage(self) -> tuple[Stage, FloatArray]: ...

class StageForces:
    contact_points: tuple[ContactPoint, ...]
    modes: PointModes
    def __init__(
        self, smooth: Smooth, evaluator: RowEvaluator, contact_points: tuple[ContactPoint, ...], modes: PointModes
    ) -> None: ...
    def add(self, applied: FloatArray) -> Stage: ...
