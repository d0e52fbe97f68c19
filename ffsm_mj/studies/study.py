"""A study in a folder: start, run, continue, and read its results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.campaign.campaign import Campaign
from ffsm_mj.campaign.evaluation.results import TableRow
from ffsm_mj.campaign.execution.engines import dask_address
from ffsm_mj.campaign.execution.file_metrics import FileMetric, execute_metrics, read_metrics
from ffsm_mj.campaign.execution.rerun import Rerun
from ffsm_mj.campaign.script_classes import NO_CLASSES, ScriptClasses
from ffsm_mj.campaign.storage.status import Status
from ffsm_mj.campaign.storage.table import as_arrow
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.invocation import option
from ffsm_mj.studies.comparison import StudyComparison, compare_variants
from ffsm_mj.studies.folder import VARIANTS, StudyFolder, StudyRecord
from ffsm_mj.studies.plan import StudyPlan, load_study
from ffsm_mj.studies.results import StudyResults
from ffsm_mj.studies.sentences import sentences

Metrics = Mapping[str, Callable[[Run], Any]] | str | Path
"""Metrics of the caller: functions by name, or a Python file."""


def functions_of(metrics: Metrics) -> dict[str, Callable[[Run], Any]]:
    """Metrics of the caller by name; a file is not executed."""
    return dict(read_metrics(Path(metrics))) if isinstance(metrics, str | Path) else dict(metrics)


class _MissingMetric:
    """Placeholder of a metric whose function is not given, for reading results."""

    def __call__(self, _: Run) -> Any:
        raise NotImplementedError


class Study:
    """Variants of a scenario, run with the same samples. The folder has the whole state.

    Attributes:
        config: The study file.
        folder: Folder of the study.
        campaigns: Campaign of each variant that its scenario can run, by name.
        not_applicable: Why the control laws of the other variants cannot be created for their scenarios, by name.
    """

    def __init__(self, folder: StudyFolder, own: ScriptClasses = NO_CLASSES) -> None:
        """Read the study in a folder; use :meth:`load` or :meth:`open`."""
        self.folder, self.config = folder, folder.config()
        self._record = record = folder.record()
        self._missing = [name for name in record.metrics if name not in own.metrics]
        functions = {name: own.metrics.get(name, _MissingMetric()) for name in record.metrics}
        self._own = ScriptClasses(own.controllers, own.estimators, functions)
        self.not_applicable = record.not_applicable
        self.campaigns = {
            name: Campaign.open_with(folder.variant(name), self._own)
            for name in self.config.variants
            if name not in record.not_applicable
        }
        if not self.campaigns:
            raise InputError(f"{folder.path}: none of its variants is applicable")

    @classmethod
    def load(
        cls,
        study: str | Path,
        out: str | Path,
        *,
        overrides: Sequence[str] = (),
        metrics: Metrics = MappingProxyType({}),
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
    ) -> Study:
        """Create a study, or continue the one in the folder if its variants have the same settings.

        Args:
            study: A study file, or the name of a shipped study.
            out: Folder of the study.
            overrides: ``key=value`` overrides of the study file.
            metrics: Metrics of the caller: functions of a run by name, or a Python file whose functions they are.
            controllers: Control laws of the caller, classes by kind.
            estimators: Estimators of the caller, likewise.

        Raises:
            InputError: The file is invalid, or the folder holds a study with other settings.
            LogWriteError: The folder cannot be written (full disk).
        """
        own = ScriptClasses(dict(controllers), dict(estimators), functions_of(metrics))
        return cls.begin(load_study(study, overrides, own), Path(out))

    @classmethod
    def begin(cls, plan: StudyPlan, out: Path) -> Study:
        """Create or continue a study from a plan; see :meth:`load`."""
        folder, own = StudyFolder(out), plan.own
        execute_metrics(own.metrics)
        with folder.locked():
            folder.refuse_other_files()
            if folder.is_initialized:
                _refuse_fewer(folder, plan)
            designs = {}
            for name, variant in plan.variants.items():
                designs[name] = Campaign.begin(variant, folder.variant(name), own).design.rows
            first = next(iter(designs))
            for name, rows in designs.items():
                if rows != designs[first]:
                    raise InputError(f"{folder.variant(name)}: its samples are not those of {folder.variant(first)}")
            files = [each for each in own.metrics.values() if isinstance(each, FileMetric)]
            record = StudyRecord(plan.not_applicable, tuple(own.metrics), files[0].file if files else "")
            folder.write(plan.config, record, files[0].text if files else "")
        return cls(folder, own)

    @classmethod
    def open(
        cls,
        out: str | Path,
        *,
        metrics: Metrics = MappingProxyType({}),
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
    ) -> Study:
        """Open the study in a folder; see :meth:`load`. Metrics of the caller are needed to run it, not to read it.

        Raises:
            InputError: The folder holds no study.
        """
        return cls(StudyFolder(Path(out)), ScriptClasses(dict(controllers), dict(estimators), functions_of(metrics)))

    def run(
        self,
        executor: Executor | None = None,
        *,
        workers: int | None = None,
        dask: str = "",
        retry: Sequence[str] = (),
        report: Callable[[float, float], None] | None = None,
    ) -> dict[str, Status]:
        """Execute the runs of all variants that have no row yet, one variant after the other.

        Args:
            executor: Executor for the runs; None: processes on this machine.
            workers: Number of processes; None: that of the study file, else one per processor.
            dask: Address of a Dask scheduler to use instead, or ``local`` for a cluster on this machine.
            retry: Outcomes of :data:`ffsm_mj.campaign.storage.outcomes.RETRIED` whose runs are repeated.
            report: Called with (number of rows, number of runs) of the whole study after every batch.

        Returns:
            Progress of each variant.

        Raises:
            InputError: Another process runs this study, the settings differ, or no worker can execute its runs.
            EngineLostError: The workers are lost; the rows so far are kept.
            LogWriteError: A table cannot be written (full disk); earlier rows are kept.
        """
        self._refuse_missing_metrics()
        with self.folder.locked(), dask_address(dask, workers) as address:
            progress = self.status()
            for name, campaign in self.campaigns.items():
                others = sum(each.done for other, each in progress.items() if other != name)
                total = sum(each.runs for each in progress.values())
                told = None if report is None else _with(report, others, total)
                progress[name] = campaign.run(executor, workers=workers, dask=address, retry=retry, report=told)
        return progress

    def rerun(self, variant: str, index: int) -> Rerun:
        """Repeat a run of a variant and write its log into the folder of the variant.

        Args:
            variant: Name of the variant.
            index: Index of the run.

        Raises:
            InputError: There is no such variant or run, or it cannot be prepared.
        """
        if variant not in self.campaigns:
            raise InputError(f"{self.folder.path}: {unknown_name('variant', variant, self.campaigns)}")
        self._refuse_missing_metrics()
        return self.campaigns[variant].rerun(index)

    def _refuse_missing_metrics(self) -> None:
        """Refuse to run without the metrics of the caller, and execute their file.

        Raises:
            InputError: Functions are missing, or the file raises an exception.
        """
        if self._missing:
            of = self._record.metrics_file or "a script"
            how = f"give {option('metrics', '...')} with {'that file' if self._record.metrics_file else 'its functions'}"
            raise InputError(f"{self.folder.path}: metrics of {of} are needed to run it ({', '.join(self._missing)}); {how}")
        execute_metrics(self._own.metrics)

    def status(self) -> dict[str, Status]:
        """Progress of each variant."""
        return {name: campaign.status() for name, campaign in self.campaigns.items()}

    def results(self) -> StudyResults:
        """All rows so far, for comparison and report."""
        found = {name: campaign.results() for name, campaign in self.campaigns.items()}
        return StudyResults(self.config, found, self.not_applicable)

    def comparison(self) -> StudyComparison:
        """Paired differences of the variants."""
        return compare_variants(self.results())

    def sentences(self) -> list[str]:
        """What the results show so far, one sentence each."""
        results = self.results()
        return sentences(results, compare_variants(results))

    def table_rows(self) -> list[TableRow]:
        """A dictionary per run and variant, with the name of the variant first."""
        return [{"variant": name, **row} for name, campaign in self.campaigns.items() for row in campaign.table_rows()]

    def table(self) -> Any:
        """All rows as a ``pyarrow.Table``; its method ``to_pandas`` gives a data frame."""
        return as_arrow(self.table_rows())


def _with(report: Callable[[float, float], None], others: int, total: int) -> Callable[[float, float], None]:
    """Progress of a variant as progress of the whole study."""
    return lambda done, _: report(others + done, total)


def _refuse_fewer(folder: StudyFolder, plan: StudyPlan) -> None:
    """Refuse a study that lacks a variant of the folder; one that adds variants continues it.

    Raises:
        InputError: A variant is missing.
    """
    before, now = folder.record().not_applicable, {*plan.variants, *plan.not_applicable}
    made = [path.name for path in sorted((folder.path / VARIANTS).iterdir())] if (folder.path / VARIANTS).is_dir() else []
    missing = [name for name in [*made, *before] if name not in now]
    if missing:
        raise InputError(f"{folder.path}: holds the variants {', '.join(missing)}, which the study file does not have")
