"""The analysis of the truncation after a run or a log replay: its budget, its progress, and Ctrl-C, which ends it alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ffsm_mj.cli.progress import Report
from ffsm_mj.errors import described, raised_at
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay.truncation import AnalysisLimits, analyze_truncation, usual_seconds
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.truncation import TruncationAnalysis

PATIENCE = 3
"""Number of times that Ctrl-C may be hit while an analysis ends and what was found is printed."""


def truncation_analysis(
    log: RunLog,
    checks: Sequence[Check],
    budget_s: float | None,
    stage: Callable[[str, str], Report | None],
    name: str,
    stopped: Callable[[], bool],
) -> TruncationAnalysis:
    """Analyse the truncation of a run within a budget, with progress on a terminal.

    Args:
        log: The run.
        checks: Its checks.
        budget_s: Value of ``--truncation``: largest wall time, s; 0: no analysis; None: the usual time.
        stage: Begins a stage of the progress.
        name: Displayed name of the run.
        stopped: Polled before every step: whether Ctrl-C was hit, which ends the analysis only.
    """
    if budget_s == 0.0:
        return TruncationAnalysis(None, "--truncation off")
    seconds = usual_seconds(log) if budget_s is None else budget_s
    report = stage(f"truncation of {name}, at most {seconds:.3g} s", "samples")
    try:
        return analyze_truncation(log, checks, AnalysisLimits(seconds, stopped=stopped, report=report))
    except KeyboardInterrupt:  # hit again and again while a step does not end
        return TruncationAnalysis(None, "interrupted")
    except Exception as error:  # noqa: BLE001 (whatever it raises, the run is over and its report is not lost)
        return TruncationAnalysis(None, described(error) + raised_at(error))
