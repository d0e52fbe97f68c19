"""Scale at which viewers draw the markers of a run."""

from __future__ import annotations

from ffsm_mj.analysis.run import Run
from ffsm_mj.log.drawing import marker_scale
from ffsm_mj.log.scenario import compile_log


def scale_of(run: Run) -> float:
    """Scale of the markers of a run, from the models in its log."""
    return marker_scale(compile_log(run.log))
