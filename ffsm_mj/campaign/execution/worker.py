"""One run of a campaign, where it is made: in a worker process, on a cluster, or here."""

from __future__ import annotations

import faulthandler
import os
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.models import Reader
from ffsm_mj.assembly.prepare import PreparedRun, as_overrides, recipe
from ffsm_mj.assembly.run import simulate
from ffsm_mj.campaign.execution.effort import Effort
from ffsm_mj.campaign.execution.metrics import COUNT, always, columns_of, evaluated
from ffsm_mj.campaign.storage.outcomes import ERROR, TIMEOUT
from ffsm_mj.campaign.storage.settings import row_versions
from ffsm_mj.campaign.storage.store import RunRow
from ffsm_mj.errors import FfsmError, InputError, described, raised_at
from ffsm_mj.model.files import read_model
from ffsm_mj.records.events import Outcome
from ffsm_mj.records.facts import logged_models
from ffsm_mj.replay.truncation import refined
from ffsm_mj.report.run import Run
from ffsm_mj.scenario.loading import validated
from ffsm_mj.scenario.source import YamlSource, read_yaml
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, STEP_LAWS, Check
from ffsm_mj.verification.refined import explained


@dataclass(frozen=True)
class Job:
    """What a worker must know to make runs of a campaign; it pickles.

    Attributes:
        scenario: The base scenario, every default written out, beside its models: where all workers can read it.
        metrics: What is measured.
        versions: Packages with which the campaign was begun.
        digest: Hash of the campaign's settings: where it is the same, so are the scenario and its models.
        timeout_s: Wall time that a run may take; 0: any.
        laws: Control laws of a script, classes by kind.
        truncated: What becomes of runs whose checks fail by the truncation of the step alone: ``count`` or ``fail``.
        own_process: Whether the process is the campaign's own, so that it may be ended where a run is stuck.
        grace_s: A run that does not end by itself so long after its time is up is stuck.
    """

    scenario: str
    metrics: tuple[str, ...]
    versions: Mapping[str, str]
    digest: str = ""
    timeout_s: float = 0.0
    checks: Mapping[str, Any] = field(default_factory=dict)
    own_process: bool = True
    grace_s: float = 5.0
    truncated: str = COUNT


class OtherVersionsError(FfsmError):
    """A worker has other packages than those with which the campaign was begun."""


class _TimeIsUpError(Exception):
    """A run takes too long."""


def probe(job: Job) -> str:
    """Whether runs can be made here at all; returns the name of this machine.

    Raises:
        OtherVersionsError: There are other packages here.
        InputError: The scenario cannot be read here.
    """
    here = row_versions()
    for package, wanted in job.versions.items():
        if here.get(package, "none") != wanted:
            raise OtherVersionsError(
                f"worker {platform.node()}: {package} {here.get(package, 'none')}, where the campaign has {wanted}"
            )
    _read(job.scenario, job.digest)
    return platform.node()


def make_rows(job: Job, runs: Sequence[tuple[int, Mapping[str, Any]]]) -> list[RunRow]:
    """Make some runs, one after the other; those after an interrupted one are left out.

    Args:
        job: The campaign.
        runs: Number and overrides of each.

    Raises:
        OtherVersionsError: There are other packages here.
        InputError: The scenario cannot be read here.
    """
    _probed(job.scenario, tuple(sorted(job.versions.items())), job.digest)
    rows: list[RunRow] = []
    with one_blas_thread():  # asked for once, not by every run
        for index, overrides in runs:
            row = make_row(job, index, overrides)
            if row.outcome == "interrupted":
                break
            rows.append(row)
    return rows


@lru_cache(maxsize=4)
def _probed(scenario: str, versions: tuple[tuple[str, str], ...], digest: str) -> None:
    probe(Job(scenario, (), dict(versions), digest))


def make_row(job: Job, index: int, overrides: Mapping[str, Any]) -> RunRow:
    """Make one run. Whatever goes wrong in it is a row, too."""
    begun, used = time.perf_counter(), time.process_time()
    try:
        told = _run(job, overrides, begun)
    except _TimeIsUpError:
        told = {"outcome": TIMEOUT, "message": f"took more than {job.timeout_s:g} s"}
    except InputError as error:
        told = {"outcome": ERROR, "message": f"InputError: {'; '.join(error.lines)}"}
    except (Exception, SystemExit) as error:  # noqa: BLE001 (a law or a metric of somebody's may fail in any way)
        told = {"outcome": ERROR, "message": described(error) + raised_at(error)}
    wall, cpu = time.perf_counter() - begun, time.process_time() - used
    return RunRow(index, cpu=processor(), wall_s=round(wall, 6), cpu_s=round(cpu, 6), **told)


def _run(job: Job, overrides: Mapping[str, Any], begun: float) -> dict[str, Any]:
    assembly = prepared_run(job, overrides).assemble()
    effort = Effort(assembly.system, assembly.actuation.keys)

    def look(*_: float) -> None:
        if job.timeout_s and time.perf_counter() - begun > job.timeout_s:
            raise _TimeIsUpError

    with _stopped_when_stuck(job):
        run = simulate(assembly, columns=columns_of(job.metrics), watchers=(effort,), report=look)
        laws = run.checks()
        if _may_be_truncation(run, laws):
            # Its rows are not kept: it is made once more, and replayed in shorter steps.
            log = simulate(prepared_run(job, overrides).assemble(), report=look).log
            laws = explained(laws, DEFAULT_TOLERANCE, lambda: refined(log, look))
        counted = always(laws, truncated=job.truncated)
        metrics = evaluated(run, effort.told(), job.metrics, counted)
    return {
        "outcome": run.outcome,
        "message": run.message,
        "phase": run.phases[-1].name if run.phases else "",
        "metrics": metrics,
        "model": dict(_by_dotted_key(logged_models(run.log.header.facts))),
    }


def _may_be_truncation(run: Run, laws: Sequence[Check]) -> bool:
    """Whether only checks of energy and momenta fail, in a run that came to its end."""
    failing = [law for law in laws if not law.passes]
    return run.outcome == Outcome.COMPLETED and bool(failing) and all(law.name in STEP_LAWS for law in failing)


def _by_dotted_key(nested: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in nested.items():
        if isinstance(value, Mapping):
            yield from _by_dotted_key(value, f"{above}{key}.")
        else:
            yield above + key, value


class _stopped_when_stuck:  # noqa: N801 (a context manager)
    """Ends this process where a run in it is stuck: C code that does not come back hears no exception."""

    def __init__(self, job: Job) -> None:
        self._after = job.timeout_s + job.grace_s if job.timeout_s and job.own_process else 0.0

    def __enter__(self) -> None:
        if self._after:
            faulthandler.dump_traceback_later(self._after, exit=True, file=_nowhere())

    def __exit__(self, *_: object) -> None:
        if self._after:
            faulthandler.cancel_dump_traceback_later()


@cache
def _nowhere() -> Any:
    return Path(os.devnull).open("w", encoding="utf-8")


def prepared_run(job: Job, overrides: Mapping[str, Any]) -> PreparedRun:
    """A run of the campaign, made ready.

    Raises:
        InputError: The overrides or what they make of a model are wrong.
    """
    source = _read(job.scenario, job.digest).overridden(as_overrides(overrides))
    return recipe(validated(source, job.checks), source, job.checks, _model_reader(job.scenario, job.digest))


# A worker makes runs of several campaigns, and a folder may hold another one than it did: the digest tells them apart.
@lru_cache(maxsize=4)
def _read(scenario: str, digest: str) -> YamlSource:  # noqa: ARG001
    return read_yaml(Path(scenario))


@lru_cache(maxsize=4)
def _model_reader(scenario: str, digest: str) -> Reader:  # noqa: ARG001
    """Reads each model of a campaign once."""
    return cache(read_model)


@cache
def processor() -> str:
    """Model of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
