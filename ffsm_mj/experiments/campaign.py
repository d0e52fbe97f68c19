"""Campaigns in their folders: start, run, extend, compare and repeat runs; sweeps."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.experiments.comparison import VariantComparison, compare_variants, refuse_other_samples
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.driver import FIRST, Driver, StoppingRule
from ffsm_mj.experiments.executors import choose_workers, importable
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.folder import (
    CAMPAIGN,
    VARIANTS,
    CampaignFolder,
    Record,
    campaign_settings,
    row_versions,
    settings_changes,
    settings_hash,
)
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
    Status,
    TableRow,
    VariantResults,
    as_arrow,
    column_of,
    finite,
    numbers,
    runs_to_keep,
    status_of,
    status_of_variants,
    table_rows,
)
from ffsm_mj.experiments.sentences import sentences_of
from ffsm_mj.experiments.statistics import Proportion, Quantile, quantile
from ffsm_mj.experiments.store import RunRow, Store
from ffsm_mj.experiments.worker import Job, Rerun, rerun
from ffsm_mj.invocation import command, on_command_line, option
from ffsm_mj.scenario.shipped import scenario_path

_NONE: Mapping[str, Any] = MappingProxyType({})


class Campaign:
    """Many runs of one scenario with dispersed parameters, and the table of their results.

    The folder has the whole state: every method reads its present content. With variants, each is a campaign of its own in a
    folder below, and what is read of single runs is read from ``variants[NAME]``.

    Attributes:
        config: The campaign file.
        design: Samples of all runs.
        folder: Folder of the campaign.
        variants: Campaigns of the variants that their scenarios can run, by name; empty without variants.
        not_applicable: Why the control laws of the other variants cannot be created for their scenarios, by name.
    """

    def __init__(self, plan: Plan, design: Design, folder: CampaignFolder, classes: ScriptClasses) -> None:
        """Store the parts; use :meth:`load` or :meth:`open`."""
        self.config: CampaignFile = plan.config
        self.design, self.folder = design, folder
        self.variants: Mapping[str, Campaign] = {}
        self.not_applicable: Mapping[str, str] = {}
        self._plan, self._classes = plan, classes
        self._settings = campaign_settings(plan, classes)

    @classmethod
    def load(
        cls,
        campaign: Mapping[str, Any] | str | Path,
        out: str | Path,
        *,
        overrides: Sequence[str] = (),
        metrics: Metrics = _NONE,
        controllers: Mapping[str, Any] = _NONE,
        estimators: Mapping[str, Any] = _NONE,
    ) -> Campaign:
        """Create a campaign, or continue the one in the folder if it has the same settings.

        Args:
            campaign: A campaign file, the name of a shipped campaign, or the keys of one, with a scenario as
                :func:`ffsm_mj.run` takes it; its paths are then relative to the current folder.
            out: Folder of the campaign.
            overrides: ``key=value`` overrides of the campaign file.
            metrics: Metrics of the caller: functions of a run by name, or a Python file whose functions they are.
            controllers: Control laws of the caller, classes by kind.
            estimators: Estimators of the caller, likewise.

        Raises:
            InputError: The file is invalid, or the folder holds a campaign with other settings.
            LogWriteError: The folder cannot be written (full disk).
        """
        classes = script_classes(
            campaign.get("scenario") if isinstance(campaign, Mapping) else None, controllers, estimators
        )
        return cls.begin(load_campaign(campaign, overrides, replace(classes, metrics=functions_of(metrics))), Path(out))

    @classmethod
    def begin(cls, plan: Plan | VariantsPlan, out: Path) -> Campaign:
        """Create or continue a campaign from a plan; see :meth:`load`."""
        folder = CampaignFolder(out)
        execute_metrics(plan.classes.metrics)
        with folder.locked():
            with_variants = isinstance(plan, VariantsPlan)
            if folder.is_initialized and folder.has_variants != with_variants:
                kind = "without" if with_variants else "with"
                raise InputError(f"{out}: holds a campaign {kind} variants; choose another {option('out')}")
            return cls._with_variants(plan, folder) if isinstance(plan, VariantsPlan) else cls._began(plan, folder, out)

    @classmethod
    def _began(cls, plan: Plan, folder: CampaignFolder, shown: Path) -> Campaign:
        """The campaign of a plan in its folder; ``shown`` is the folder in messages, for a variant that of the whole."""
        if not folder.is_initialized:
            design = plan.design()
            config, files = plan.config.model_dump(mode="json", exclude_none=True), plan.base.logged_files
            folder.write(config, plan.base.scenario_yaml, files, design, *_recorded(plan.classes, {}))
        campaign = cls(stored_plan(folder.path / CAMPAIGN, plan.classes), folder.design(), folder, plan.classes)
        campaign._adopt(plan, shown)
        return campaign

    @classmethod
    def _with_variants(cls, plan: VariantsPlan, folder: CampaignFolder) -> Campaign:
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
            folder.refuse_other_files()
        first: Campaign | None = None
        for name, variant in plan.variants.items():
            with folder.variant(name).locked():
                begun = cls._began(variant, folder.variant(name), folder.path)
            first = first or begun
            if begun.design.rows != first.design.rows:
                raise InputError(f"{begun.folder.path}: its samples are not those of {first.folder.path}")
        config = plan.config.model_dump(mode="json", exclude_none=True)
        folder.write_variants(config, *_recorded(plan.classes, plan.not_applicable))
        return cls._of_variants(plan.config, folder, plan.classes, plan.not_applicable)

    @classmethod
    def _of_variants(
        cls, config: CampaignFile, folder: CampaignFolder, classes: ScriptClasses, not_applicable: Mapping[str, str]
    ) -> Campaign:
        """Open the variants in a folder.

        Raises:
            InputError: There is none, or one of them cannot be read.
        """
        variants = {n: cls.stored(folder.variant(n), classes) for n in config.variants if n not in not_applicable}
        if not variants:
            raise InputError(f"{folder.path}: none of its variants is applicable")
        first = next(iter(variants.values()))
        campaign = cls(first._plan, first.design, folder, classes)
        campaign.config, campaign.variants, campaign.not_applicable = config, variants, not_applicable
        return campaign

    @classmethod
    def open(
        cls,
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
        if folder.has_variants:
            return cls._of_variants(read_campaign(folder.path / CAMPAIGN), folder, classes, record.not_applicable)
        return cls.stored(folder, classes)

    @classmethod
    def stored(cls, folder: CampaignFolder, classes: ScriptClasses) -> Campaign:
        """Open a campaign without variants with all classes and functions of the caller; see :meth:`open`."""
        design = folder.design()
        return cls(stored_plan(folder.path / CAMPAIGN, classes), design, folder, classes)

    def _adopt(self, plan: Plan, shown: Path) -> None:
        """Replace the campaign file by that of a plan with the same settings: rows do not depend on the other keys.

        Raises:
            InputError: The settings or the number of samples differ.
        """
        other = campaign_settings(plan, self._classes)
        with self._table() as store:
            stored = store.settings or self._settings  # classes and functions of a script are known from the rows only
        if other != stored:
            raise InputError(f"{self.folder.path}: holds a campaign with other settings: {settings_changes(stored, other)}")
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
        self.folder.write_config(config.model_dump(mode="json", exclude_none=True))

    @contextmanager
    def _table(self) -> Iterator[Store]:
        """The table, opened for reading; its rows may have other settings.

        Raises:
            InputError: The table cannot be read, or has rows that do not belong to the design.
        """
        if self.variants:
            names = ", ".join(self.variants)
            raise InputError(f"{self.folder.path}: has variants; name one: campaign.variants[NAME], NAME of {names}")
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
        """A dictionary per run, with the name of its variant first; see :func:`ffsm_mj.experiments.results.table_rows`."""
        if self.variants:
            return [{"variant": name, **row} for name, part in self.variants.items() for row in part.table_rows()]
        return table_rows(self.rows(), self.design, self.config.conditions)

    def table(self) -> Any:
        """All rows as a ``pyarrow.Table``; its method ``to_pandas`` gives a data frame."""
        return as_arrow(self.table_rows())

    def status(self) -> Status:
        """Progress of the campaign and of each variant."""
        if self.variants:
            return status_of_variants(
                self.config.campaign, {name: variant.status() for name, variant in self.variants.items()}
            )
        with self._table() as store:
            return status_of(store, self.config.campaign, len(self.design.rows))

    def results(self) -> Results:
        """All rows so far with the names of their columns, for report and statistics."""
        rows, design, config = self.table_rows(), self.design, self.config
        parameters = tuple(column_of(name, "parameter", rows) for name in design.parameters)
        metrics = tuple(column_of(name, "metric", rows) for name in config.all_metrics)
        return Results(design.kind, design.n, len(design.rows), parameters, metrics, rows)

    def variant_results(self) -> VariantResults:
        """All rows so far, by variant; of a campaign without, those of the empty name."""
        variants = {name: part.results() for name, part in (self.variants or {"": self}).items()}
        return VariantResults(self.config, variants, self.not_applicable)

    def fraction(self, what: str = "success") -> Proportion:
        """Fraction of the runs that are a success, or for which a metric is true, with its confidence interval."""
        rows = self.results().sample
        return Proportion(int((numbers(rows, what) == 1.0).sum()), len(rows))

    def quantile(self, metric: str, share: float) -> Quantile:
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

    @contextmanager
    def _writable_table(self) -> Iterator[Store]:
        """The table, opened for writing.

        Raises:
            InputError: Its rows have other settings.
        """
        with closing(Store(self.folder.table)) as store:
            store.begin(settings_hash(self._settings), self._settings)
            if store.settings != self._settings:
                changed = settings_changes(store.settings, self._settings)
                raise InputError(f"{self.folder.path}: its rows were made with other settings: {changed}")
            yield store

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
            report: Called with (number of rows, number of runs) after every batch.

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
        with self.folder.locked():
            return self._run(executor, workers, dask, retry, report)

    def _run(
        self,
        executor: Executor | None,
        workers: int | None,
        dask: str,
        retry: Sequence[str],
        report: Callable[[float, float], None] | None,
    ) -> Status:
        """Execute the runs of a campaign whose folder is locked; see :meth:`run`."""
        if self.variants:
            progress = {name: variant.status() for name, variant in self.variants.items()}
            total = sum(part.runs for part in progress.values())
            for name, variant in self.variants.items():
                others = sum(status.done for other, status in progress.items() if other != name)
                shown = None if report is None else _of_whole(report, others, total)
                with variant.folder.locked():
                    progress[name] = variant._run(executor, workers, dask, retry, shown)
            return status_of_variants(self.config.campaign, progress)
        with self._writable_table() as store:
            classes = [class_ for _, class_ in self._classes.every]
            pool = choose_workers(executor, workers, dask, classes, self.config.limits.workers)
            self.design = self.folder.design()  # another process may have extended it
            if retry:
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

            if not stopping.ends():
                Driver(pool, self._job(exclusive=pool.exclusive_processes), store_rows, stopping.ends).drive(left)
        return replace(self.status(), stopped=stopping.failing if self.status().left else "", enough=stopping.enough)

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
            for variant in self.variants.values():
                if variant.design.n != n:  # an earlier call that was interrupted has extended it
                    variant.extend(n)
            config = self.config.model_copy(update={"samples": self.config.samples.model_copy(update={"n": n})})
            if not self.variants:
                self.design = self._plan.extended(self.folder.design(), n)
                self.folder.write_design(self.design)
                self._rewrite(config)
                return
            self.config, keys = config, config.model_dump(mode="json", exclude_none=True)
            self.folder.write_variants(keys, *_recorded(self._classes, self.not_applicable, self.folder.record()))

    def rerun(self, index: int, variant: str = "") -> Rerun:
        """Repeat a run and write its log into the folder of the campaign.

        Args:
            index: Index of the run in the design.
            variant: Name of its variant; empty without variants.

        Raises:
            InputError: There is no such run, or it cannot be prepared.
        """
        if variant and not self.variants:
            raise InputError(f"{self.folder.path}: has no variants, {variant!r} is none")
        if variant not in (self.variants or [""]):
            raise InputError(f"{self.folder.path}: {unknown_name('variant', variant, self.variants)}")
        self._load_metrics()
        if variant:
            return self.variants[variant].rerun(index)
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
        return runs_to_keep(self.rows(), self.config.keep)


def _recorded(classes: ScriptClasses, not_applicable: Mapping[str, str], before: Record | None = None) -> tuple[Record, str]:
    """Record of a campaign, and the text of its metrics file; empty if it has none or keeps the one before."""
    files = [metric for metric in classes.metrics.values() if isinstance(metric, FileMetric)]
    file = files[0].file if files else before.metrics_file if before is not None else ""
    return Record(not_applicable, tuple(classes.metrics), file), files[0].text if files else ""


def _of_whole(report: Callable[[float, float], None], others: int, total: int) -> Callable[[float, float], None]:
    """Progress of a variant as progress of the whole campaign."""
    return lambda done, _: report(others + done, total)


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
    overrides: Mapping[str, Any] = _NONE,
    controllers: Mapping[str, Any] = _NONE,
    estimators: Mapping[str, Any] = _NONE,
    workers: int | None = None,
    out: str | Path | None = None,
) -> Any:
    """Run a scenario with every combination of given values.

    Works in a script without a main guard, from standard input and in a notebook.

    Args:
        scenario: See :func:`ffsm_mj.run`.
        values: Values by dotted key of the scenario.
        metrics: Metrics of each run; see docs/campaigns.md.
        overrides: Overrides of the scenario for all runs, by dotted key.
        controllers: Control laws of the caller, classes by kind.
        estimators: Estimators of the caller, likewise.
        workers: Number of processes; None: one per processor.
        out: Folder of the campaign, continued if it holds the same campaign; None: only the table is kept.

    Returns:
        A ``pyarrow.Table`` with a row per run; its method ``to_pandas`` gives a data frame.

    Raises:
        InputError: A key, a value or a metric is invalid.
    """
    keys = {
        "campaign": "sweep",
        "scenario": str(scenario_path(scenario).resolve()) if isinstance(scenario, str | Path) else scenario,
        "overrides": overrides,
        "samples": {"kind": "grid"},
        "dispersions": {key: {"choice": value} for key, value in values.items()},
        "metrics": list(metrics),
        "limits": {"max_failed": 1.0},
    }
    with tempfile.TemporaryDirectory(prefix="ffsm-sweep-") as temporary:
        campaign = Campaign.load(keys, out or temporary, controllers=controllers, estimators=estimators)
        campaign.run(workers=workers)
        return campaign.table()
