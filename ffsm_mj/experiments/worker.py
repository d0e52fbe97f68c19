"""Execution of single runs of a campaign, in a worker process, on a cluster or in this process; and their repetition."""

from __future__ import annotations

import faulthandler
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.models import Reader
from ffsm_mj.assembly.prepare import PreparedRun, recipe, uninterrupted
from ffsm_mj.assembly.run import simulate
from ffsm_mj.errors import FfsmError, InputError, described, raised_at
from ffsm_mj.experiments.metrics import COUNT, Scalar, ScriptClasses, check_metrics, columns_of, metric_values
from ffsm_mj.experiments.settings import row_versions
from ffsm_mj.experiments.store import ERROR, TIMEOUT, RunRow
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.files import read_model
from ffsm_mj.records.events import Outcome
from ffsm_mj.records.metadata import logged_properties
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay import explain
from ffsm_mj.replay.truncation import AnalysisLimits, usual_steps
from ffsm_mj.scenario.loading import validated
from ffsm_mj.scenario.overrides import as_texts
from ffsm_mj.scenario.source import YamlSource, read_yaml
from ffsm_mj.verification.check_result import Check

PlannedRun = tuple[int, Mapping[str, Any]]
"""Index of a run in the design, and its overrides."""


@dataclass(frozen=True)
class Job:
    """Data that a worker needs to execute runs of a campaign; picklable.

    Attributes:
        scenario: Path of the resolved base scenario, beside its models; every worker must be able to read it.
        metrics: Names of the metrics.
        versions: Package versions of the campaign.
        digest: Hash of the campaign's settings; it identifies the scenario and its models.
        timeout_s: Greatest wall time of a run, s; 0: no limit.
        classes: Control laws, estimators and metrics of a script.
        exclusive_process: Whether the process executes nothing else, so that it may be ended if a run is stuck.
        grace_s: Time after the timeout at which a run that has not stopped is stuck, s.
        truncated: Whether runs whose checks fail by the truncation of the step alone pass: ``count``, or not: ``fail``.
    """

    scenario: str
    metrics: tuple[str, ...]
    versions: Mapping[str, str]
    digest: str = ""
    timeout_s: float = 0.0
    classes: ScriptClasses = field(default_factory=ScriptClasses)
    exclusive_process: bool = True
    grace_s: float = 5.0  # a step in Python ends well within this time, and then looks at the clock
    truncated: str = COUNT


class OtherVersionsError(FfsmError):
    """The package versions of a worker differ from those of the campaign."""


class _TimeoutError(Exception):
    """A run exceeds its wall time."""


def probe(job: Job) -> None:
    """Check that runs can be executed here.

    Raises:
        OtherVersionsError: The package versions differ from those of the campaign.
        InputError: The scenario cannot be read here.
    """
    local_versions = row_versions()
    for package, wanted in job.versions.items():
        if local_versions.get(package, "none") != wanted:
            raise OtherVersionsError(
                f"worker {platform.node()}: {package} {local_versions.get(package, 'none')}, where the campaign has {wanted}"
            )
    _read(job.scenario, job.digest)


@lru_cache(maxsize=4)
def _probed(scenario: str, versions: tuple[tuple[str, str], ...], digest: str) -> None:
    probe(Job(scenario, (), dict(versions), digest))


def execute_runs(job: Job, runs: Sequence[PlannedRun]) -> list[RunRow]:
    """Execute runs one after the other, up to the first that is interrupted; returns their rows.

    Raises:
        OtherVersionsError: The package versions differ from those of the campaign.
        InputError: The scenario cannot be read here.
    """
    _probed(job.scenario, tuple(sorted(job.versions.items())), job.digest)
    rows: list[RunRow] = []
    for index, overrides in runs:
        row = _row(job, index, overrides)
        if row.outcome == Outcome.INTERRUPTED:
            break
        rows.append(row)
    return rows


def _row(job: Job, index: int, overrides: Mapping[str, Any]) -> RunRow:
    """Execute one run; a failure of any kind gives a row too."""
    started, used = time.perf_counter(), time.process_time()
    try:
        result = _run(job, index, overrides, started)
    except _TimeoutError:
        result = {"outcome": TIMEOUT, "message": f"took more than {job.timeout_s:g} s"}
    except InputError as error:
        result = {"outcome": ERROR, "message": f"InputError: {'; '.join(error.lines)}"}
    except (Exception, SystemExit) as error:  # noqa: BLE001 (a control law or metric of a plug-in may raise anything)
        result = {"outcome": ERROR, "message": described(error) + raised_at(error)}
    wall, cpu = time.perf_counter() - started, time.process_time() - used
    return RunRow(index, cpu=processor(), wall_s=round(wall, 6), cpu_s=round(cpu, 6), **result)


def _run(job: Job, index: int, overrides: Mapping[str, Any], started: float) -> dict[str, Any]:
    assembly = prepared_run(job, index, overrides).assemble()

    def check_time(*_: float) -> None:
        if job.timeout_s and time.perf_counter() - started > job.timeout_s:
            raise _TimeoutError

    with _StuckRunGuard(job):
        run = simulate(assembly, columns=columns_of(job.metrics, job.classes.metrics), report=check_time)
        # A replay with shorter steps needs all rows, which are not kept: the run is repeated.
        checks = checks_with_verdict(
            run, lambda: simulate(prepared_run(job, index, overrides).assemble(), report=check_time).log, check_time
        )
        counted = check_metrics(checks, truncated=job.truncated)
        metrics = metric_values(run, job.metrics, counted, job.classes.metrics)
    return {
        "outcome": run.outcome,
        "message": run.message,
        "phase": run.phases[-1].name if run.phases else "",
        "metrics": metrics,
        "model": logged_properties(run.log.header.metadata),
    }


def checks_with_verdict(run: Run, log: Callable[[], RunLog], look: Callable[[], None] = lambda: None) -> tuple[Check, ...]:
    """All checks of a run of a campaign; failing ones with their share of truncation if all may fail by it.

    The analysis is limited by steps, not by time: its result is the same in every worker and in a rerun.

    Args:
        run: The run.
        log: Returns its log with all rows.
        look: Called before every step of the analysis; an exception that it raises ends it.
    """
    checks = all_checks(run)
    if run.outcome != Outcome.COMPLETED or not all(check.passes or check.may_be_truncation for check in checks):
        return checks

    def stopped() -> bool:
        look()
        return False

    return explain(run, checks, limits=AnalysisLimits(steps=usual_steps(run.log), stopped=stopped), log=log).checks


class _StuckRunGuard:
    """Context that ends the process if a run is stuck: no exception stops C code that does not return."""

    def __init__(self, job: Job) -> None:
        self._after = job.timeout_s + job.grace_s if job.timeout_s and job.exclusive_process else 0.0

    def __enter__(self) -> None:
        if self._after:
            faulthandler.dump_traceback_later(self._after, exit=True, file=_null_device())

    def __exit__(self, *_: object) -> None:
        if self._after:
            faulthandler.cancel_dump_traceback_later()


@cache
def _null_device() -> Any:
    return Path(os.devnull).open("w", encoding="utf-8")


def prepared_run(job: Job, index: int, overrides: Mapping[str, Any]) -> PreparedRun:
    """Prepare a run of a campaign.

    The seed of its noise is that of the scenario plus its index, unless the campaign sets seeds: runs of one index have the
    same noise under every control law.

    Raises:
        InputError: The overrides are invalid, or a model does not compile with them.
    """
    base = _read(job.scenario, job.digest)
    seed = base.data.get("seed", 0) if isinstance(base.data, Mapping) else 0
    seeds = {} if "seed" in overrides or not isinstance(seed, int) else {"seed": seed + index}
    source = base.overridden(as_texts({**overrides, **seeds}))
    laws, estimators = job.classes.controllers, job.classes.estimators
    config = validated(source, laws, estimators)
    return recipe(config, source, laws, _model_reader(job.scenario, job.digest), estimators=estimators)


# A worker may serve several campaigns, and the content of a folder may change: the digest distinguishes them.
@lru_cache(maxsize=4)
def _read(scenario: str, digest: str) -> YamlSource:  # noqa: ARG001
    return read_yaml(Path(scenario))


@lru_cache(maxsize=4)
def _model_reader(scenario: str, digest: str) -> Reader:  # noqa: ARG001
    """Reader that reads each model of a campaign once."""
    return cache(read_model)


@cache
def processor() -> str:
    """Name of the processor model."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


TOLERANCE = 1e-6
"""Allowed difference from a row of another processor or other versions, times max(1, |x|) for a number x.

Rounding grows by a factor at each impact: a run with so many that it differs by more is not reproducible elsewhere.
"""
_RESIDUALS = ("checks.", "excess.", "drift", "conservation.", "deepest_overlap_m")
"""Metrics that are rounding errors, which differ between processors."""


@dataclass(frozen=True)
class Rerun:
    """A repeated run.

    Attributes:
        index: Index of the run in the design.
        run: The run with its log.
        exact: Whether processor, versions and settings are those of the row, so that all numbers must agree bit for bit.
        deviations: Unexpected differences from the row, one line each.
    """

    index: int
    run: Run
    exact: bool
    deviations: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """Result of the comparison, in a sentence."""
        if self.deviations:
            return f"run {self.index} differs from its row: {'; '.join(self.deviations)}"
        if self.exact:
            return f"run {self.index} agrees with its row bit for bit"
        return f"run {self.index} agrees with its row to {TOLERANCE:g} (another processor, or other versions or settings)"


def rerun(
    job: Job, index: int, overrides: Mapping[str, Any], folder: Path, row: RunRow | None, *, same_settings: bool
) -> Rerun:
    """Repeat a run and write its log.

    Args:
        job: The campaign.
        index: Index of the run.
        overrides: Overrides of the run from the design.
        folder: Run folder to write; an existing one is replaced.
        row: Row to compare with; None: no comparison.
        same_settings: Whether the row has the present settings, including package versions.

    Raises:
        InputError: The run cannot be prepared.
    """
    assembly = prepared_run(job, index, overrides).assemble()
    # If it is interrupted, its log is kept, and the remaining runs are not executed.
    run = uninterrupted(simulate(assembly, RunFolder(folder, force=True), with_rerun=False))
    if row is None:
        return Rerun(index, run, True, ())
    exact = row.cpu == processor() and same_settings
    outcome, metrics = run.outcome, dict[str, Scalar]()
    try:
        checked = check_metrics(checks_with_verdict(run, lambda: run.log), truncated=job.truncated)
        metrics = metric_values(run, job.metrics, checked, job.classes.metrics)
    except (Exception, SystemExit):  # noqa: BLE001 (a worker makes a row with the outcome error of it)
        outcome = ERROR
    return Rerun(index, run, exact, tuple(_deviations(row, outcome, metrics, job.metrics, exact=exact)))


def _deviations(row: RunRow, outcome: str, metrics: Mapping[str, Scalar], asked: Sequence[str], *, exact: bool) -> list[str]:
    changes = [] if row.outcome == outcome else [f"outcome {outcome}, {row.outcome} in the table"]
    for name in dict.fromkeys([*row.metrics, *asked]):
        before, now = row.metrics.get(name), metrics.get(name)
        if before != now and (exact or not _near(name, before, now)):
            changes.append(f"{name} {now!r}, {before!r} in the table")
    return changes


def _near(name: str, before: Any, now: Any) -> bool:
    if name.startswith(_RESIDUALS):
        return True
    numbers = isinstance(before, float) and isinstance(now, float)
    return numbers and abs(before - now) <= TOLERANCE * max(1.0, abs(before))
