"""The analysis of the truncation after a run or a log replay: its budget, its progress, and Ctrl-C, which ends it alone."""

from __future__ import annotations

from collections.abc import Callable

from ffsm_mj.analysis.run import Run
from ffsm_mj.cli.progress import Stage
from ffsm_mj.errors import described, raised_at
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Tolerance
from ffsm_mj.verification.truncation import ExplainedChecks, has_question

PATIENCE = 3
"""Number of times that Ctrl-C may be hit while an analysis ends and what was found is printed."""


def explained_checks(
    run: Run,
    checks: tuple[Check, ...],
    budget_s: float | None,
    stage: Stage,
    name: str,
    stopped: Callable[[], bool],
    tolerance: Tolerance = DEFAULT_TOLERANCE,
) -> ExplainedChecks:
    """Find out whether checks fail by truncation within a budget, with progress on a terminal.

    Args:
        run: The run.
        checks: Its checks.
        budget_s: Value of ``--truncation``: largest wall time, s; 0: no analysis; None: the usual time.
        stage: Begins a stage of the progress.
        name: Displayed name of the run.
        stopped: Polled before every step: whether Ctrl-C was hit, which ends the analysis only.
        tolerance: Tolerance of the checks.
    """
    if not has_question(checks, tolerance):
        return ExplainedChecks(checks)
    if budget_s == 0.0:
        return ExplainedChecks(checks, "--truncation off")
    from ffsm_mj.replay import explain  # slow imports, which a run that passes does not need
    from ffsm_mj.replay.truncation import AnalysisLimits, usual_seconds

    seconds = usual_seconds(run.log) if budget_s is None else budget_s
    report = stage(f"truncation of {name}, at most {seconds:.3g} s", "samples")
    try:
        return explain(run, checks, tolerance=tolerance, limits=AnalysisLimits(seconds, stopped=stopped, report=report))
    except KeyboardInterrupt:  # hit again and again while a step does not end
        return ExplainedChecks(checks, "interrupted")
    except Exception as error:  # noqa: BLE001 (whatever it raises, the run is over and its report is not lost)
        return ExplainedChecks(checks, described(error) + raised_at(error))
