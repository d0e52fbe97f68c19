from collections.abc import Callable, Iterable
from typing import Any

from ffsm_mj._core.steppers import FreeStepper
from ffsm_mj._core.tick import Limits, RowFiller, SteadyForces, StepWork, TickLaw
from ffsm_mj._core.travel import Travel

class FreeTicks:
    ticks: int
    steps: int
    line: int
    evaluations: int
    law_s: float
    def __init__(
        self,
        data: Any,
        recorder: Any | None,
        rows: RowFiller,
        work: StepWork,
        *,
        watched: Any | None,
        overlaps: dict[Any, Any],
        look: Callable[[float], object] | None,
        count: Callable[[], object] | None,
        after_step: Iterable[Callable[[float], object]],
        step_s: float,
        steps_per_tick: int,
    ) -> None: ...
    def pass_step(self) -> bool: ...
    def begin(self, ticks: int, steps: int, line: int) -> None: ...
    def take(
        self,
        move: Callable[[float], bool] | None,
        stepper: FreeStepper,
        forces: SteadyForces | None,
        event_bound: float,
        travels: tuple[Travel, ...],
        bound_within: float,
        law: TickLaw | None,
        limits: Limits | None,
        *,
        decide: Callable[[float], bool] | None,
        interrupted: Callable[[], object] | None,
        report: Callable[[float], object] | None,
        warnings: list[str],
        ticks: int,
        lines: int,
        until_s: float,
        clock: float,
    ) -> None: ...
