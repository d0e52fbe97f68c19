"""Load limit of a closed grasp: it opens at the first time in a step at which the load reaches the limit."""

from __future__ import annotations

import math
from collections.abc import Callable

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing_time import first_at_most_zero
from ffsm_mj.contact_models.grasp.config import LoadLimitConfig
from ffsm_mj.dynamics.step_path import StepPath

_NEAR = 0.9
"""A step is searched inside if the ratio of load to limit exceeds this at one of its ends."""


class LoadLimit:
    """Limits on force and torque between link and object."""

    def __init__(self, config: LoadLimitConfig, load: Callable[[], FloatArray]) -> None:
        """Bind to the load of a grasp: force in N and torque in N m now, (6,)."""
        self._limits, self._load = (config.force_N, config.torque_N_m), load
        self._start = 0.0

    def load(self) -> tuple[float, float]:
        """Force in N and torque in N m at the current state and efforts, as norms."""
        values = self._load().tolist()
        return math.hypot(*values[:3]), math.hypot(*values[3:])

    def ratio(self) -> float:
        """Largest ratio of load to limit at the current state and efforts."""
        return max(size / limit for size, limit in zip(self.load(), self._limits, strict=True) if limit is not None)

    def is_reached(self) -> bool:
        """Whether it is reached at the start of a step."""
        self._start = self.ratio()
        return self._start >= 1.0

    def was_clear(self) -> bool:
        """Whether the load stayed well below it in the last step, by its ends."""
        return max(self._start, self.ratio()) < _NEAR

    def first(self, path: StepPath, duration_s: float) -> float | None:
        """First time within ``duration_s`` of the last step at which it is reached; None if it is not."""

        def margin(time_s: float) -> float:
            path.move_to(time_s)
            return 1.0 - self.ratio()

        return first_at_most_zero(margin, duration_s)
