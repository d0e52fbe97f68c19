"""A campaign in a folder: begun, gone on with, extended, looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.campaign.evaluation.results import Results, TableRow, column_of, measured
from ffsm_mj.campaign.evaluation.statistics import Proportion, Quantile, quantile
from ffsm_mj.campaign.execution import engines
from ffsm_mj.campaign.execution.driver import Driver
from ffsm_mj.campaign.execution.engines import Engine
from ffsm_mj.campaign.execution.metrics import COUNT
from ffsm_mj.campaign.execution.rerun import Rerun, rerun
from ffsm_mj.campaign.execution.stopping import FIRST, StoppingRule
from ffsm_mj.campaign.execution.worker import Job
from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.plan.loading import Plan, load_campaign
from ffsm_mj.campaign.storage.folder import CAMPAIGN, CampaignFolder
from ffsm_mj.campaign.storage.outcomes import RETRIED
from ffsm_mj.campaign.storage.settings import differences, row_versions, settings_hash, settings_of
from ffsm_mj.campaign.storage.status import Status, status_of
from ffsm_mj.campaign.storage.store import RunRow, Store
from ffsm_mj.campaign.storage.table import as_arrow, table_rows
from ffsm_mj.errors import InputError


class Campaign:
    """Many runs of one scenario and their table. The folder is all there is: every method reads what it holds now.

    Attributes:
        config: The campaign file.
        design: What is drawn for every run.
        folder: Where it is kept.
    """

    def __init__(self, plan: Plan, design: Design, folder: CampaignFolder, controllers: Mapping[str, Any]) -> None:
        """Use :meth:`load` or :meth:`open`."""
        self.config: CampaignFile = plan.config
        self.design, self.folder = design, folder
        self._plan, self._laws = plan, dict(controllers)
        self._settings = _settings(plan, self._laws)

    @classmethod
    def load(
        cls,
        campaign: str | Path,
        out: str | Path,
        *,
        overrides: Sequence[str] = (),
        controllers: Mapping[str, Any] = MappingProxyType({}),
    ) -> Campaign:
        """Begin a campaign, or take up the one that the folder holds where it is the same.

        Args:
            campaign: A campaign file, or the name of a shipped one.
            out: Its folder.
            overrides: ``key=value`` each, of keys of the campaign file.
            controllers: Control laws of the caller's own, classes by kind.

        Raises:
            InputError: The file is wrong, or the folder holds a campaign with other settings.
            LogWriteError: The folder cannot be written (full disk).
        """
        return cls.begin(load_campaign(campaign, overrides, controllers), Path(out), controllers)

    @classmethod
    def begin(cls, plan: Plan, out: Path, controllers: Mapping[str, Any] = MappingProxyType({})) -> Campaign:
        """The same for a plan."""
        folder = CampaignFolder(out)
        with folder.driven():
            if not folder.begun:
                design = plan.design()
                base = plan.base
                files = base.system.logged_files
                folder.write(plan.config.model_dump(mode="json", exclude_none=True), base.scenario_yaml, files, design)
            found = cls.open(out, controllers)
            found._take_up(plan, controllers)
        return found

    @classmethod
    def open(cls, out: str | Path, controllers: Mapping[str, Any] = MappingProxyType({})) -> Campaign:
        """The campaign that a folder holds.

        Raises:
            InputError: There is none.
        """
        folder = CampaignFolder(Path(out))
        design = folder.design()
        return cls(load_campaign(folder.path / CAMPAIGN, (), controllers), design, folder, controllers)

    def _take_up(self, plan: Plan, controllers: Mapping[str, Any]) -> None:
        """Go on with another plan of the same settings: what rows do not depend on is the plan's."""
        other = _settings(plan, dict(controllers))
        if other != self._settings:
            raise InputError(
                f"{self.folder.path}: holds a campaign with other settings: {differences(self._settings, other)}"
            )
        if plan.config.samples.n not in (None, self.design.n):
            how = "extend adds to it" if plan.config.samples.n > self.design.n else "resume goes on with it"
            raise InputError(
                f"{self.folder.path}: holds a design of {self.design.n} samples, {plan.config.samples.n} are asked for;"
                f" ffsm campaign {how}"
            )
        self.config = plan.config
        self.folder.write_config(plan.config.model_dump(mode="json", exclude_none=True))

    @contextmanager
    def _table(self) -> Iterator[Store]:
        """The table, to be read: whatever it was made with."""
        there = self.folder.table.is_file()
        with closing(Store(self.folder.table, write=False) if there else Store(":memory:")) as store:
            if store.last() >= len(self.design.rows):  # extended since by somebody
                self.design = self.folder.design()
            if store.last() >= len(self.design.rows):
                raise InputError(f"{self.folder.table}: has a row of run {store.last()}, which the design has not")
            yield store

    @contextmanager
    def _open_table(self) -> Iterator[Store]:
        """The table, to be written.

        Raises:
            InputError: Its rows were made with other settings.
        """
        with closing(Store(self.folder.table)) as store:
            store.begin(settings_hash(self._settings), self._settings)
            if store.settings != self._settings:
                told = differences(store.settings, self._settings)
                raise InputError(f"{self.folder.path}: its rows were made with other settings: {told}")
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
        """Make the runs that have no row yet.

        Args:
            executor: Where; None: processes of this machine.
            workers: How many of those; None: as the file says, else as many as there are processors.
            dask: Address of a dask scheduler instead.
            retry: Outcomes of :data:`ffsm_mj.campaign.storage.outcomes.RETRIED` whose rows are to be made again.
            report: Told (rows, runs).

        Returns:
            How far it came.

        Raises:
            InputError: Another process runs this campaign, its settings are others, or no worker can make its runs.
            EngineLostError: Workers were lost for good; what was made is kept.
            LogWriteError: The table cannot be written (full disk); what was written before is kept.
        """
        engine = self._engine(executor, workers, dask)
        with self.folder.driven(), self._open_table() as store:
            self.design = self.folder.design()  # another may have extended it
            if retry:
                store.drop(retry)
            done = store.done()
            left = [(i, self.design.overrides(i)) for i in range(len(self.design.rows)) if i not in done]
            total, made = len(self.design.rows), len(done)
            stopping = StoppingRule(self.config, total, done, store.failed(FIRST), self.results)

            def keep(rows: Sequence[RunRow]) -> None:
                nonlocal made
                store.add(rows)
                stopping.add(rows)
                made += len(rows)
                if report is not None:
                    report(made, total)

            if not stopping.ends():
                Driver(engine, self._job(own=engine.own_processes), keep, stopping.ends).drive(left)
        return replace(self.status(), stopped=stopping.failing if self.status().left else "", enough=stopping.enough)

    def _engine(self, executor: Executor | None, workers: int | None, dask: str) -> Engine:
        if workers is not None and workers < 1:
            raise InputError(f"workers: {workers} is less than 1")
        if executor is not None:
            return engines.given(executor, workers)
        if dask:
            return engines.dask(dask)
        if any(not engines.importable(law) for law in self._laws.values()):
            return engines.loop()
        return engines.pool(workers or self.config.limits.workers)

    def _job(self, *, own: bool) -> Job:
        metrics, timeout = self.config.kept_metrics, self.config.limits.timeout_s or 0.0
        scenario = str(self.folder.scenario.resolve())
        return Job(
            scenario,
            metrics,
            row_versions(),
            settings_hash(self._settings),
            timeout,
            self._laws,
            own,
            truncated=self.config.truncated,
        )

    def extend(self, n: int) -> None:
        """Add runs to the design; those that it has stay as they are.

        Args:
            n: Size of the sample then.

        Raises:
            InputError: Samples of this kind cannot be extended, or n is no size for them.
        """
        with self.folder.driven():
            self.design = self._plan.extended(self.folder.design(), n)
            samples = self.config.samples.model_copy(update={"n": n})
            self.config = self.config.model_copy(update={"samples": samples})
            self.folder.write_design(self.design)
            self.folder.write_config(self.config.model_dump(mode="json", exclude_none=True))

    def rows(self) -> list[RunRow]:
        """All rows so far, in order of their numbers."""
        with self._table() as store:
            return store.rows()

    def table_rows(self) -> list[TableRow]:
        """A dictionary per run; see :func:`ffsm_mj.campaign.storage.table.table_rows`."""
        return table_rows(self.rows(), self.design, self.config.conditions)

    def table(self) -> Any:
        """All rows as a ``pyarrow.Table``; ``to_pandas()`` makes it a data frame."""
        return as_arrow(self.table_rows())

    def status(self) -> Status:
        """How far it is."""
        with self._table() as store:
            return status_of(store, self.config.campaign, len(self.design.rows))

    def results(self) -> Results:
        """All rows so far with the names of their columns, as report and statistics look at them."""
        rows, design, config = self.table_rows(), self.design, self.config
        parameters = tuple(column_of(name, "parameter", rows) for name in design.parameters)
        metrics = tuple(column_of(name, "metric", rows) for name in config.kept_metrics)
        return Results(config.campaign, design.kind, design.n, len(design.rows), parameters, metrics, rows)

    def fraction(self, what: str = "success") -> Proportion:
        """Share of the runs that are a success, or for which a metric is true, with its interval."""
        rows = self.results().sample
        return Proportion(sum(row.get(what) is True for row in rows), len(rows))

    def quantile(self, metric: str, share: float) -> Quantile:
        """Quantile of a metric over the runs that did not fail, with its interval.

        Raises:
            InputError: None of them has it as a number.
        """
        values = measured(self.results().sample, metric)
        if not len(values):
            raise InputError(f"{metric}: no run that did not fail has it as a number")
        return quantile(values, share)

    def rerun(self, index: int) -> Rerun:
        """Make a run again and keep its log in the folder.

        Args:
            index: Its number.

        Raises:
            InputError: There is no such run, or it cannot be made.
        """
        if not 0 <= index < len(self.design.rows):
            raise InputError(f"run {index}: the design has 0 to {len(self.design.rows) - 1}")
        with self._table() as store:
            row = store.row(index)
            same = store.settings == self._settings
        self.folder.refuse_links()
        folder = self.folder.rerun(index)
        return rerun(self._job(own=False), index, self.design.overrides(index), folder, row, same_settings=same)

    def kept(self) -> list[int]:
        """Numbers of the runs whose logs the file asks for: failures and the worst of metrics, those that have an end."""
        rows, keep = self.rows(), self.config.keep
        ended = [row for row in rows if row.outcome not in RETRIED]
        wanted = [row.index for row in ended if row.failed][: keep.failures]
        for metric, count in keep.worst.items():
            known = [row for row in ended if isinstance(row.metrics.get(metric), int | float)]
            wanted += [row.index for row in sorted(known, key=lambda row: -row.metrics[metric])[:count]]
        return list(dict.fromkeys(wanted))


def _settings(plan: Plan, laws: Mapping[str, Any]) -> str:
    """What rows depend on."""
    config = plan.config
    sampling = {
        "samples": config.samples.model_dump(mode="json", exclude={"n"}),
        "dispersions": config.model_dump(mode="json", exclude_none=True)["dispersions"],
    }
    # A campaign that leaves the key out is what it was before there was one.
    counted = {} if config.truncated == COUNT else {"truncated": config.truncated}
    files = plan.base.system.logged_files
    return settings_of(plan.base.scenario_yaml, files, sampling | counted, config.kept_metrics, laws)
