"""Settings of a simulation loop."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Time grid of a run, and what the control law is told; see the scenario keys of the same names.

    Attributes:
        time_step_s: Integration step, s.
        steps_per_tick: Steps in a control period.
        ticks: Control periods in the run.
        told_above_N_s: Least impulse of an impact of which the control law is told; -inf: it is told of all events of
            contacts; None: of none.
        keeps_states: Whether the log gets the state of the simulation at events.
    """

    time_step_s: float
    steps_per_tick: int
    ticks: int
    told_above_N_s: float | None = -math.inf
    keeps_states: bool = False
