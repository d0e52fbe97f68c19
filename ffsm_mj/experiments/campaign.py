"""Campaigns in their folders: start, run, extend, compare and repeat runs; sweeps."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.experiments.comparison import VariantComparison, compare_variants, refuse_other_samples
from ffsm_mj.experiments.driver import FIRST, Driver, StoppingRule
from ffsm_mj.experiments.executors import Workers, choose_workers, importable
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.folder import CAMPAIGN, VARIANTS, CampaignFolder, Record
from ffsm_mj.experiments.metrics import (
    FileMetric,
    Metrics,
    MissingMetric,
    ScriptClasses,
    execute_metrics,
    functions_of,
    script_classes,
)
from ffsm_mj.experiments.planning import Plan, VariantsPlan, load_campaign, read_campaign, stored_plan
from ffsm_mj.experiments.results import (
    Results,
    TableRow,
    VariantResults,
    as_arrow,
    finite,
    logs_to_keep,
    numbers,
    results_of,
    table_rows,
)
from ffsm_mj.experiments.sentences import sentences_of
from ffsm_mj.experiments.settings import campaign_settings, row_versions, settings_changes, settings_hash
from ffsm_mj.experiments.statistics import Estimate, Proportion, quantile
from ffsm_mj.experiments.status import Status, status_of, status_of_variants
from ffsm_mj.experiments.store import RunRow, Store
from ffsm_mj.experiments.worker import Job, Rerun, rerun
from ffsm_mj.invocation import command, on_command_line, option
from ffsm_mj.scenario.overrides import Overrides, by_key
from ffsm_mj.scenario.shipped import scenario_path

_NONE: Mapping[str, Any] = MappingProxyType({})


class Campaign:
    """Many runs of one scenario with dispersed parameters, and the table of their results.

    The folder has the whole state: every method reads its present content.

    Attributes:
        config: The campaign file.
        design: Samples of all runs.
        folder: Folder of the campaign.
        variants: Campaigns of the variants that their scenarios can run, by name; empty without variants.
        not_applicable: Why the control laws of the other variants cannot be created for their scenarios, by name.
    """

    variants: Mapping[str, Campaign] = MappingProxyType({})
    not_applicable: Mapping[str, str] = MappingProxyType({})

    def __init__(self, plan: Plan, folder: CampaignFolder) -> None:
        """Read the design in the folder; use :meth:`load` or :meth:`open`."""
        self.config: CampaignFile = plan.config
        self.folder, self.design = folder, folder.design()
        self._plan, self._classes = plan, plan.classes
        self._settings = campaign_settings(plan)

    @staticmethod
    def load(
        campaign: Mapping[str, Any] | str | Path,
        out: str | Path,
        *,
        overrides: Overrides = (),
        metrics: Metrics = _NONE,
        controllers: Mapping[str, Any] = _NONE,
        estimators: Mapping[str, Any] = _NONE,
    ) -> Campaign:
        """Create a campaign, or continue the one in the folder if it has the same settings.

        Args:
            campaign: A campaign file, the name of a shipped campaign, or the keys of one, with a scenario as
                :func:`ffsm_mj.run` takes it; its paths are then relative to the current folder.
            out: Folder of the campaign.
            overrides: Overrides of the campaign file; see :func:`ffsm_mj.run`.
            metrics: Metrics of the caller: functions of a run by name, or a Python file whose functions they are.
            controllers: Control laws of the caller, classes by kind.
            estimators: Estimators of the caller, likewise.

        Raises:
            InputError: The file is invalid, or the folder holds a campaign with other settings.
            OutputLostError: The folder cannot be written (full disk).
        """
        scenario = campaign.get("scenario") if isinstance(campaign, Mapping) else None
        classes = replace(script_classes(scenario, controllers, estimators), metrics=functions_of(metrics))
        return Campaign.begin(load_campaign(campaign, overrides, classes), Path(out))

    @staticmethod
    def begin(plan: Plan | VariantsPlan, out: Path) -> Campaign:
        """Create or continue a campaign from a plan; see :meth:`load`."""
        folder = CampaignFolder(out)
        execute_metrics(plan.classes.metrics)
        with folder.locked():
            with_variants = isinstance(plan, VariantsPlan)
            if folder.is_initialized and folder.has_variants != with_variants:
                kind = "without" if with_variants else "with"
                raise InputError(f"{out}: holds a campaign {kind} variants; choose another {option('out')}")
            if isinstance(plan, VariantsPlan):
                return VariantCampaign.of_plan(plan, folder)
            return Campaign._of_plan(plan, folder, out)

    @staticmethod
    def open(
        out: str | Path,
        *,
        metrics: Metrics = _NONE,
        controllers: Mapping[str, Any] = _NONE,
        estimators: Mapping[str, Any] = _NONE,
    ) -> Campaign:
        """Open the campaign in a folder; see :meth:`load`. Metrics of the caller are needed to run it, not to read it.

        Raises:
            InputError: The folder holds no campaign.
        """
        folder, functions = CampaignFolder(Path(out)), functions_of(metrics)
        record = folder.record()
        known = {name: functions.get(name, MissingMetric()) for name in record.metrics}
        classes = ScriptClasses(dict(controllers), dict(estimators), known)
        if not folder.has_variants:
            return Campaign(stored_plan(folder.path / CAMPAIGN, classes), folder)
        config = read_campaign(folder.path / CAMPAIGN)
        parts = {name: folder.variant(name) for name in config.variants if name not in record.not_applicable}
        variants = {name: Campaign(stored_plan(part.path / CAMPAIGN, classes), part) for name, part in parts.items()}
        return VariantCampaign(config, folder, classes, variants, record.not_applicable)

    @staticmethod
    def _of_plan(plan: Plan, folder: CampaignFolder, shown: Path) -> Campaign:
        """The campaign of a plan in its locked folder; ``shown`` is the folder in messages, for a variant that of the whole.

        Raises:
            InputError: The folder holds something else, or a campaign with other settings or another number of samples.
        """
        if not folder.is_initialized:
            folder.refuse_other_files(plan.config)
            folder.write_runs(plan.base.scenario_yaml, plan.base.logged_files, plan.design())
            folder.write_record(plan.config, *_recorded(plan.classes))
        campaign = Campaign(stored_plan(folder.path / CAMPAIGN, plan.classes), folder)
        campaign._adopt(plan, shown)
        return campaign

    def _adopt(self, plan: Plan, shown: Path) -> None:
        """Replace the campaign file by that of a plan with the same settings: rows do not depend on the other keys."""
        other = campaign_settings(plan)
        with self._table() as store:
            stored = store.settings or self._settings  # classes and functions of a script are known from the rows only
        if other != stored:
            changes = settings_changes(stored, other)
            raise InputError(f"{self.folder.path}: holds a campaign with other settings: {changes}")
        if plan.config.samples.n not in (None, self.design.n):
            larger = plan.config.samples.n > self.design.n
            how = "extend(n) enlarges it" if larger else "Campaign.open continues it"
            if on_command_line():
                words = ("extend", shown, plan.config.samples.n) if larger else ("resume", shown)
                how = f"'{command('campaign', *words)}' {'enlarges' if larger else 'continues'} it"
            raise InputError(f"{shown}: holds a design of {self.design.n} samples, not {plan.config.samples.n}; {how}")
        self._rewrite(plan.config)

    def _rewrite(self, config: CampaignFile) -> None:
        """Replace the campaign file."""
        self.config = config
        self.folder.write_config(config)

    @contextmanager
    def _table(self) -> Iterator[Store]:
        """The table, opened for reading; its rows may have other settings.

        Raises:
            InputError: The table cannot be read, or has rows that do not belong to the design.
        """
        exists = self.folder.table.is_file()
        with closing(Store(self.folder.table, write=False) if exists else Store(":memory:")) as store:
            if store.last() >= len(self.design.rows):  # another process has extended the design
                self.design = self.folder.design()
            if store.last() >= len(self.design.rows):
                raise InputError(f"{self.folder.table}: has a row of run {store.last()}, which is not in the design")
            yield store

    def rows(self) -> list[RunRow]:
        """All rows so far, in the order of their indices."""
        with self._table() as store:
            return store.rows()

    def table_rows(self) -> list[TableRow]:
        """A dictionary per run; see :func:`ffsm_mj.experiments.results.table_rows`."""
        return table_rows(self.rows(), self.design, self.config.conditions)

    def table(self) -> Any:
        """All rows as a ``pyarrow.Table``; its method ``to_pandas`` gives a data frame."""
        return as_arrow(self.table_rows())

    def status(self) -> Status:
        """Progress of the campaign and of each variant."""
        with self._table() as store:
            return status_of(store, self.config.campaign, len(self.design.rows))

    def results(self) -> Results:
        """All rows so far with the names of their columns, for report and statistics."""
        return results_of(self.rows(), self.design, self.config)

    def variant_results(self) -> VariantResults:
        """All rows so far, by variant; of a campaign without, those of the empty name."""
        variants = {name: part.results() for name, part in (self.variants or {"": self}).items()}
        return VariantResults(self.config, variants, self.not_applicable)

    def fraction(self, what: str = "success") -> Proportion:
        """Fraction of the runs that are a success, or for which a metric is true, with its confidence interval."""
        rows = self.results().sample
        return Proportion(int((numbers(rows, what) == 1.0).sum()), len(rows))

    def quantile(self, metric: str, share: float) -> Estimate:
        """Quantile of a metric over the runs that did not fail, with its confidence interval.

        Args:
            metric: Name of the metric.
            share: Probability of the quantile, e.g. 0.95.

        Raises:
            InputError: No run that did not fail has a number for the metric.
        """
        values = finite(self.results().valid, metric)
        if not len(values):
            raise InputError(f"{metric}: no run that did not fail has a number for it")
        return quantile(values, share)

    def comparison(self) -> VariantComparison:
        """Paired differences of the variants, over the runs that completed and pass their checks in both.

        Raises:
            InputError: The campaign has no variants.
        """
        if not self.variants:
            how = "ffsm_mj.compare_campaigns compares two campaigns"
            raise InputError(f"{self.folder.path}: has no variants to compare; {how}")
        return compare_variants(self.variant_results())

    def sentences(self) -> list[str]:
        """What the results show so far: success, means and quantiles of metrics; of variants, their differences."""
        return self.comparison().lines() if self.variants else sentences_of(self.results(), self.config.conditions)

    def run(
        self,
        executor: Executor | None = None,
        *,
        workers: int | None = None,
        dask: str = "",
        retry: Sequence[str] = (),
        report: Callable[[float, float], None] | None = None,
    ) -> Status:
        """Execute the runs that have no row yet; of variants, one variant after the other.

        Works in a script without a main guard, from standard input and in a notebook.

        Args:
            executor: Executor for the runs; None: processes on this machine.
            workers: Number of processes; None: that of the campaign file, else one per processor.
            dask: Address of a Dask scheduler to use instead.
            retry: Outcomes of :data:`ffsm_mj.experiments.store.RETRIED` whose runs are repeated.
            report: Called with (number of rows, number of runs) at the start and after every batch, as
                :func:`ffsm_mj.progress` likes it.

        Returns:
            Progress of the campaign.

        Raises:
            InputError: Another process runs this campaign, the settings differ, or no worker can execute its runs.
            NoWorkersLeftError: The workers are lost; the rows so far are kept.
            LogWriteError: The table cannot be written (full disk); earlier rows are kept.
        """
        self._load_metrics()
        local = [name for name, class_ in self._classes.every if not importable(class_)]
        if local and executor is None and not dask:
            reason = "cannot be imported by other processes: all runs are executed in this one"
            print(f"{self.config.campaign}: {', '.join(local)} {reason}", file=sys.stderr)
        classes = [class_ for _, class_ in self._classes.every]
        chosen = choose_workers(executor, workers, dask, classes, self.config.limits.workers)
        with self.folder.locked():
            return self._execute(chosen, retry, report)

    def _execute(self, workers: Workers, retry: Sequence[str], report: Callable[[float, float], None] | None) -> Status:
        """Execute the runs of a campaign whose folder is locked; see :meth:`run`."""
        with self._writable_table() as store:
            self.design = self.folder.design()  # another process may have extended it
            store.drop(retry)
            done = store.done()
            left = [(i, self.design.overrides(i)) for i in range(len(self.design.rows)) if i not in done]
            total, finished = len(self.design.rows), len(done)
            stopping = StoppingRule(self.config, total, done, store.failed(FIRST), self.results)

            def store_rows(rows: Sequence[RunRow]) -> None:
                nonlocal finished
                store.add(rows)
                stopping.add(rows)
                finished += len(rows)
                if report is not None:
                    report(finished, total)

            if report is not None:
                report(finished, total)
            if not stopping.ends():
                Driver(workers, self._job(exclusive=workers.exclusive_processes), store_rows, stopping.ends).drive(left)
        status = self.status()
        return replace(status, stopped=stopping.failing if status.left else "", enough=stopping.enough)

    @contextmanager
    def _writable_table(self) -> Iterator[Store]:
        """The table, opened for writing.

        Raises:
            InputError: Its rows have other settings.
        """
        with closing(Store(self.folder.table)) as store:
            store.begin(self._settings)
            if store.settings != self._settings:
                changes = settings_changes(store.settings or "", self._settings)
                raise InputError(f"{self.folder.path}: its rows were made with other settings: {changes}")
            yield store

    def _load_metrics(self) -> None:
        """Execute the file of the metrics of the caller, without which nothing is run.

        Raises:
            InputError: Functions are missing, or the file raises an exception.
        """
        missing = [name for name, function in self._classes.metrics.items() if isinstance(function, MissingMetric)]
        if missing:
            file = self.folder.record().metrics_file
            how = f"give {option('metrics', '...')} with {'that file' if file else 'its functions'}"
            of = f"metrics of {file or 'a script'} are needed to run it ({', '.join(missing)})"
            raise InputError(f"{self.folder.path}: {of}; {how}")
        execute_metrics(self._classes.metrics)

    def _job(self, *, exclusive: bool) -> Job:
        return Job(
            scenario=str(self.folder.scenario.resolve()),
            metrics=self.config.all_metrics,
            versions=row_versions(),
            digest=settings_hash(self._settings),
            timeout_s=self.config.limits.timeout_s or 0.0,
            classes=self._classes,
            exclusive_process=exclusive,
            truncated=self.config.truncated,
        )

    def extend(self, n: int) -> None:
        """Add runs to the design; existing runs do not change.

        Args:
            n: New number of samples.

        Raises:
            InputError: Samples of this kind cannot be extended, or not to this number.
        """
        with self.folder.locked():
            self._extend(n)
            self._rewrite(self.config.with_samples(n))

    def _extend(self, n: int) -> None:
        self.design = self._plan.extended(self.folder.design(), n)
        self.folder.write_design(self.design)

    def rerun(self, index: int, variant: str = "") -> Rerun:
        """Repeat a run and write its log into the folder of the campaign.

        Args:
            index: Index of the run in the design.
            variant: Name of its variant; empty without variants.

        Raises:
            InputError: There is no such run, or it cannot be prepared.
        """
        if variant:
            raise InputError(f"{self.folder.path}: has no variants, {variant!r} is none")
        self._load_metrics()
        if not 0 <= index < len(self.design.rows):
            raise InputError(f"run {index}: the design has the runs 0 to {len(self.design.rows) - 1}")
        with self._table() as store:
            row = store.row(index)
            same = store.settings == self._settings
        self.folder.refuse_links()
        folder = self.folder.rerun(index)
        return rerun(self._job(exclusive=False), index, self.design.overrides(index), folder, row, same_settings=same)

    def logs_to_keep(self) -> list[int]:
        """Indices of the runs whose logs the campaign file asks for."""
        return logs_to_keep(self.rows(), self.config.keep)


class VariantCampaign(Campaign):
    """A campaign whose variants run with the same samples, each as a campaign of its own in a folder below.

    What is read of single runs is read from ``variants[NAME]``.
    """

    def __init__(
        self,
        config: CampaignFile,
        folder: CampaignFolder,
        classes: ScriptClasses,
        variants: Mapping[str, Campaign],
        not_applicable: Mapping[str, str],
    ) -> None:
        """Store the parts; use :meth:`load` or :meth:`open`.

        Raises:
            InputError: There is no variant.
        """
        if not variants:
            raise InputError(f"{folder.path}: none of its variants is applicable")
        self.config, self.folder, self.design = config, folder, next(iter(variants.values())).design
        self.variants, self.not_applicable, self._classes = variants, not_applicable, classes

    @classmethod
    def of_plan(cls, plan: VariantsPlan, folder: CampaignFolder) -> VariantCampaign:
        """The campaign of a plan in its locked folder; one that adds variants to those of the folder continues it.

        Raises:
            InputError: The folder holds something else, or a variant that the plan lacks or that has other settings.
        """
        if folder.is_initialized:
            stored = [path.name for path in sorted((folder.path / VARIANTS).iterdir())]
            known = {*plan.variants, *plan.not_applicable}
            if missing := [name for name in [*stored, *folder.record().not_applicable] if name not in known]:
                text = f"holds the variants {', '.join(missing)}, which the campaign file does not have"
                raise InputError(f"{folder.path}: {text}")
        else:
            folder.refuse_other_files(plan.config)
        variants: dict[str, Campaign] = {}
        for name, variant in plan.variants.items():
            with folder.variant(name).locked():
                variants[name] = begun = Campaign._of_plan(variant, folder.variant(name), folder.path)
            first = next(iter(variants.values()))
            if begun.design.rows != first.design.rows:
                raise InputError(f"{begun.folder.path}: its samples are not those of {first.folder.path}")
        folder.write_record(plan.config, *_recorded(plan.classes, plan.not_applicable))
        return cls(plan.config, folder, plan.classes, variants, plan.not_applicable)

    def rows(self) -> list[RunRow]:
        """Refuse: each variant has rows of its own.

        Raises:
            InputError: Always.
        """
        names = ", ".join(self.variants)
        raise InputError(f"{self.folder.path}: has variants; name one: campaign.variants[NAME], NAME of {names}")

    def table_rows(self) -> list[TableRow]:
        """Rows of all variants, with the name of the variant first."""
        return [{"variant": name, **row} for name, part in self.variants.items() for row in part.table_rows()]

    def status(self) -> Status:
        """Progress of each variant, and of all."""
        return status_of_variants(self.config.campaign, {name: part.status() for name, part in self.variants.items()})

    def _execute(self, workers: Workers, retry: Sequence[str], report: Callable[[float, float], None] | None) -> Status:
        progress = {name: variant.status() for name, variant in self.variants.items()}
        total = sum(part.runs for part in progress.values())
        for name, variant in self.variants.items():
            others = sum(status.done for other, status in progress.items() if other != name)
            shown = None if report is None else partial(_of_whole, report, others, total)
            with variant.folder.locked():
                progress[name] = variant._execute(workers, retry, shown)
        return status_of_variants(self.config.campaign, progress)

    def _extend(self, n: int) -> None:
        for variant in self.variants.values():
            if variant.design.n != n:  # an earlier call that was interrupted has extended it
                variant.extend(n)

    def rerun(self, index: int, variant: str = "") -> Rerun:
        """Repeat a run of a variant."""
        if variant not in self.variants:
            raise InputError(f"{self.folder.path}: {unknown_name('variant', variant, self.variants)}")
        return self.variants[variant].rerun(index)


def _recorded(classes: ScriptClasses, not_applicable: Mapping[str, str] = _NONE) -> tuple[Record, str]:
    """Record of a campaign, and the text of its metrics file; empty if it has none."""
    file = next((metric for metric in classes.metrics.values() if isinstance(metric, FileMetric)), FileMetric("", "", ""))
    return Record(dict(not_applicable), tuple(classes.metrics), file.file), file.text


def _of_whole(report: Callable[[float, float], None], others: int, total: int, done: float, _: float) -> None:
    """Report progress of a variant as progress of the whole campaign."""
    report(others + done, total)


def compare_campaigns(one: Campaign | str | Path, other: Campaign | str | Path) -> VariantComparison:
    """Paired differences of the metrics of two campaigns with the same samples, which are compared as variants are.

    Args:
        one: The first campaign, or its folder.
        other: The second one; differences are second less first.

    Raises:
        InputError: A folder holds no campaign, they have no run in common, or their samples differ.
    """
    first, second = (source if isinstance(source, Campaign) else Campaign.open(source) for source in (one, other))
    names = _names(first.folder.path, second.folder.path)
    results = VariantResults(first.config, {names[0]: first.results(), names[1]: second.results()})
    refuse_other_samples(results)
    return compare_variants(results)


def _names(one: Path, other: Path) -> tuple[str, str]:
    """Names of two folders: as much of the end of their paths as tells them apart."""
    first, second = one.resolve().parts, other.resolve().parts
    for length in range(1, max(len(first), len(second)) + 1):
        if first[-length:] != second[-length:]:
            return "/".join(first[-length:]), "/".join(second[-length:])
    return one.name, other.name


_DEFAULT = ("impacts.0.time_s", "impacts.0.impulse_N_s", "tip.min_error_m", "tip.final_error_m")


def sweep(
    scenario: Scenario | Mapping[str, Any] | str | Path,
    values: Mapping[str, Sequence[Any]],
    *,
    metrics: Sequence[str] = _DEFAULT,
    overrides: Overrides = (),
    controllers: Mapping[str, Any] = _NONE,
    estimators: Mapping[str, Any] = _NONE,
    workers: int | None = None,
    out: str | Path | None = None,
    report: Callable[[float, float], None] | None = None,
) -> Any:
    """Run a scenario with every combination of given values.

    Works in a script without a main guard, from standard input and in a notebook.

    Args:
        scenario: See :func:`ffsm_mj.run`.
        values: Values by dotted key of the scenario.
        metrics: Metrics of each run; see docs/campaigns.md.
        overrides: Overrides of the scenario for all runs; see :func:`ffsm_mj.run`.
        controllers: Control laws of the caller, classes by kind.
        estimators: Estimators of the caller, likewise.
        workers: Number of processes; None: one per processor.
        out: Folder of the campaign, continued if it holds the same campaign; None: only the table is kept.
        report: Called with (number of rows, number of runs) after every batch.

    Returns:
        A ``pyarrow.Table`` with a row per run; its method ``to_pandas`` gives a data frame.

    Raises:
        InputError: A key, a value or a metric is invalid.
    """
    keys = {
        "campaign": "sweep",
        "scenario": str(scenario_path(scenario).resolve()) if isinstance(scenario, str | Path) else scenario,
        "overrides": by_key(overrides),
        "samples": {"kind": "grid"},
        "dispersions": {key: {"choice": value} for key, value in values.items()},
        "metrics": list(metrics),
        "limits": {"max_failed": 1.0},
    }
    with tempfile.TemporaryDirectory(prefix="ffsm-sweep-") as temporary:
        campaign = Campaign.load(keys, out or temporary, controllers=controllers, estimators=estimators)
        campaign.run(workers=workers, report=report)
        return campaign.table()
