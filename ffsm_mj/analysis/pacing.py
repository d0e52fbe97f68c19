"""How well a run in real time kept its pace, from the columns of its clock."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ffsm_mj.analysis.run import Run

_PROMPT_S = 1e-4
"""A tick that begins within this of its time is prompt, s."""
_LATE, _LAW, _OVERRUNS = "clock.late_s", "clock.law_s", "clock.overruns"


@dataclass(frozen=True)
class Pacing:
    """Control ticks against the clock.

    Attributes:
        ticks: Number of ticks.
        overruns: Control periods that took longer to compute than they last.
        prompt: Share of the ticks that began within 100 us of their time.
        late_median_s: Median of how late they began, s.
        late_999_s: What 99.9 % of them were not later than, s.
        late_most_s: The latest, s.
        law_median_s: Median of the time to the command of a tick, s.
        law_most_s: The longest, s.
    """

    ticks: int
    overruns: int
    prompt: float
    late_median_s: float
    late_999_s: float
    late_most_s: float
    law_median_s: float
    law_most_s: float

    @classmethod
    def of(cls, run: Run) -> Pacing | None:
        """Pacing of a run; None if it did not wait for a clock, or has no rows."""
        if _LATE not in run.keys or not len(run.time):
            return None
        late, law = run[_LATE], run[_LAW]
        return cls(
            len(late),
            int(run[_OVERRUNS][-1]),
            float((late <= _PROMPT_S).mean()),
            *(float(value) for value in np.quantile(late, (0.5, 0.999, 1.0))),
            *(float(value) for value in np.quantile(law, (0.5, 1.0))),
        )

    def summary(self) -> dict[str, float]:
        """``realtime`` of ``summary.json``."""
        return asdict(self)

    def line(self) -> str:
        """One line for a terminal."""
        overruns = "no overruns" if not self.overruns else f"{self.overruns} overruns"
        late = f"{100.0 * self.prompt:.4g} % within 100 us of their time, the latest {_short(self.late_most_s)}"
        law = f"command after {_short(self.law_median_s)}, at most {_short(self.law_most_s)}"
        return f"real time: {self.ticks} ticks, {overruns}; {late}; {law}"


def _short(time_s: float) -> str:
    return f"{1e3 * time_s:.3g} ms" if time_s < 1.0 else f"{time_s:.3g} s"
