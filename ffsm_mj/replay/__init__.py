"""Log replay: a run recomputed from the states, efforts and models in its log.

Logged energies, momenta, work, limits and impacts are not used, only compared. From every sample the motion is integrated
with the logged efforts, step by step as in the run: it must end at the next sample, or at the state before the next event.
The balance is computed by the code that computes it in a run. Each interval starts at a logged state, so errors do not
accumulate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.process import one_blas_thread
from ffsm_mj.errors import InputError
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay.log_replay import LogReplay
from ffsm_mj.replay.scene import log_scene, state_metadata
from ffsm_mj.replay.truncation import AnalysisLimits, analyze_truncation, usual_seconds
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, CheckAccumulator, Tolerance, accumulate_checks
from ffsm_mj.verification.independent.kept_rows import KeptRows, before_loss, kept_rows
from ffsm_mj.verification.model_checks import ModelChecks, ReplayResult
from ffsm_mj.verification.truncation import ExplainedChecks, has_question


@one_blas_thread()
def replay_log(
    log: RunLog,
    report: Callable[[float, float], None] | None = None,
    rows: Callable[[FloatArray], None] | None = None,
) -> ReplayResult:
    """Recompute a run from its log.

    Args:
        log: The log.
        report: Called with the number of samples done and their total.
        rows: Called with the recomputed samples block by block, (n, number of signals).
    """
    try:
        scene = log_scene(log)
        replay = LogReplay(scene, log)
    # A log whose models cannot be built still has rows: the checks that need none are evaluated on them.
    except InputError as error:
        checks = ModelChecks(log, kept_rows(log))
        return ReplayResult({}, 0, 0, "", error.lines[0], accumulate_checks(log), log, checks)
    seen = CheckAccumulator(log.header.layout, dict(log.header.metadata) | state_metadata(scene))
    kept = KeptRows(log.header.layout, log.header.metadata)
    # Checks that do not use the engine need rows next to impacts and some of the whole run: only these are kept in memory.
    kept.expect(record.time_s for record in log.impact_records)
    with collected_warnings([]):
        for block in log.blocks():
            kept.rows(before_loss(log, block))
            again = replay.take(block)
            # Checks are evaluated on recomputed rows: a log that states a small residual does not pass by that.
            seen.rows(again, forces_apart=replay.forces_apart)
            if rows is not None:
                rows(again)
            if report is not None:
                report(seen.samples, max(scene.scenario.ticks + 1, seen.samples))
        replay.finish()
        kept.finish()
    replay.sampling.end()
    by_name, verified_to_s = replay.agreements()
    worst = {name: agreement.worst for name, agreement in by_name.items() if agreement.worst is not None}
    numbers = sum(agreement.numbers for agreement in by_name.values())
    gaps, checks = replay.sampling.sentence(), ModelChecks(log, kept)
    return ReplayResult(worst, seen.samples, numbers, gaps, "", seen, log, checks, verified_to_s)


def explain(
    run: Run,
    checks: Sequence[Check] | None = None,
    *,
    tolerance: Tolerance = DEFAULT_TOLERANCE,
    limits: AnalysisLimits | None = None,
    log: Callable[[], RunLog] | None = None,
) -> ExplainedChecks:
    """Evaluate all checks of a run, and find out of those that fail whether they fail by the truncation of the step alone.

    If a check of energy, momenta or heat fails, the steps of the run are made again from the states in its log, in halves
    and shorter, which takes several times as long as the run. ``check.truncation`` of a failing check is the share of
    truncation in its residual, ``check.fails_by_truncation`` the verdict: None if there is none, for the reason in
    ``obstacle`` of the result.

    Args:
        run: The run.
        checks: Its checks at ``tolerance``, if they are known already, as from :func:`replay_log`; None: computed.
        tolerance: See :func:`ffsm_mj.verification.checks.tolerances`.
        limits: What ends the analysis early; None: the wall time of the run itself, 20 s at least.
        log: Returns the log with all rows, for a run that does not keep them; None: ``run.log`` has them.

    Raises:
        KeyError: A tolerance for an unknown check.
    """
    stated = all_checks(run, tolerance) if checks is None else tuple(checks)
    # Steps are made again only where a check fails that truncation could explain: it takes several times as long as the run.
    if not has_question(stated, tolerance):
        return ExplainedChecks(stated)
    limits = limits if limits is not None else AnalysisLimits(usual_seconds(run.log))
    analysis = analyze_truncation(run.log if log is None else log(), stated, limits)
    return ExplainedChecks(analysis.judged(stated, tolerance), analysis.obstacle)
