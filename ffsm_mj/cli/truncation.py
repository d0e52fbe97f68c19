"""The analysis of the truncation after a run or a log replay: its budget, its progress, and Ctrl-C, which ends it alone."""

from __future__ import annotations

from collections.abc import Callable

from ffsm_mj.assembly.interrupts import noted
from ffsm_mj.cli.progress import Report
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay.truncation import AnalysisLimits, analyze_truncation, usual_seconds
from ffsm_mj.verification.truncation import TruncationAnalysis


def truncation_analysis(
    log: RunLog, budget_s: float | None, stage: Callable[[str, str], Report | None], name: str
) -> TruncationAnalysis:
    """Analyse the truncation of a run within a budget, with progress on a terminal.

    Ctrl-C and SIGTERM end the analysis only: what the command has found before is printed nevertheless.

    Args:
        log: The run.
        budget_s: Value of ``--truncation``: largest wall time, s; 0: no analysis; None: the usual time.
        stage: Begins a stage of the progress.
        name: Displayed name of the run.
    """
    if budget_s == 0.0:
        return TruncationAnalysis(None, "--truncation off")
    seconds = usual_seconds(log) if budget_s is None else budget_s
    report = stage(f"truncation of {name}, at most {seconds:.3g} s", "samples")
    try:
        # The first signal is seen before the next step; a second one does not wait for the end of a long one.
        with noted() as stopped:
            return analyze_truncation(log, AnalysisLimits(seconds, stopped=stopped, report=report))
    except KeyboardInterrupt:
        return TruncationAnalysis(None, "interrupted")
