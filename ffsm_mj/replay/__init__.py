"""Log replay: a run recomputed from the states, efforts and models in its log.

Logged energies, momenta, work, limits and impacts are not used, only compared. From every sample the motion is integrated
with the logged efforts, step by step as in the run: it must end at the next sample, or at the state before the next event.
The balance is computed by the code that computes it in a run. Each interval starts at a logged state, so errors do not
accumulate.
"""

from __future__ import annotations

from collections.abc import Callable

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.errors import InputError
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.model.mujoco_warnings import collected_warnings
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay.log_replay import LogReplay
from ffsm_mj.replay.metadata import state_metadata
from ffsm_mj.replay.scene import log_scene
from ffsm_mj.verification.checks import CheckAccumulator, accumulate_checks
from ffsm_mj.verification.friction_check import FrictionCheck
from ffsm_mj.verification.independent.kept_rows import KeptRows, before_loss, kept_rows
from ffsm_mj.verification.independent_checks import IndependentChecks
from ffsm_mj.verification.replay_result import ReplayResult


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
    except InputError as error:
        checked = accumulate_checks(log), log.impact_records, FrictionCheck(log), log, IndependentChecks(log, kept_rows(log))
        return ReplayResult({}, 0, 0, "", error.lines[0], *checked)
    seen = CheckAccumulator(log.header.layout, dict(log.header.metadata) | state_metadata(scene))
    period_s, start_s = scene.scenario.time_step_s * scene.scenario.steps_per_tick, logged_start_s(log.header.metadata)
    sampling = Sampling(period_s, log.instants_s, start_s)
    kept = KeptRows(log.header.layout, log.header.metadata)
    kept.expect(record.time_s for record in log.impact_records)
    with collected_warnings([]):
        for block in log.blocks():
            kept.rows(before_loss(log, block))
            again = replay.take(block, sampling.ticks(block[:, log.header.layout.time]))
            seen.rows(again)
            if rows is not None:
                rows(again)
            if report is not None:
                report(seen.samples, max(scene.scenario.ticks + 1, seen.samples))
        replay.finish()
        kept.finish()
    sampling.end(log.outcome.end_s if log.outcome else None)
    found, verified_to_s = replay.agreements()
    worst = {name: agreement.worst for name, agreement in found.items() if agreement.worst is not None}
    numbers = sum(agreement.numbers for agreement in found.values())
    checked = seen, log.impact_records, FrictionCheck(log), log, IndependentChecks(log, kept)
    return ReplayResult(worst, seen.samples, numbers, sampling.sentence(), "", *checked, verified_to_s=verified_to_s)
