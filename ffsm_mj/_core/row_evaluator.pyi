from collections.abc import Collection, Sequence
from typing import Any

from ffsm_mj._core.rows import PointRows
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint, Patch
from ffsm_mj.dynamics.motion import Motion

class RowEvaluator:
    data: Any
    at_limits: list[int]
    def __init__(
        self,
        motion: Motion,
        data: Any,
        contact_points: Sequence[ContactPoint],
        flat: Collection[Patch] = (),
    ) -> None: ...
    def rows(self) -> PointRows: ...
