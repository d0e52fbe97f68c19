"""A campaign in a folder: start, run, extend and repeat runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.campaign.evaluation.kept_logs import runs_to_keep
from ffsm_mj.campaign.execution.driver import Driver
from ffsm_mj.campaign.execution.engines import choose_engine, dask_address
from ffsm_mj.campaign.execution.rerun import Rerun, rerun
from ffsm_mj.campaign.execution.stopping import FIRST, StoppingRule
from ffsm_mj.campaign.execution.worker import Job
from ffsm_mj.campaign.plan.loading import Plan, load_campaign
from ffsm_mj.campaign.script_classes import NO_CLASSES, ScriptClasses, own_classes
from ffsm_mj.campaign.storage.folder import CAMPAIGN, CampaignFolder
from ffsm_mj.campaign.storage.settings import campaign_settings, differences, row_versions, settings_hash
from ffsm_mj.campaign.storage.status import Status
from ffsm_mj.campaign.storage.store import RunRow, Store
from ffsm_mj.campaign.stored_campaign import StoredCampaign
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command, on_command_line


class Campaign(StoredCampaign):
    """Many runs of one scenario with dispersed parameters, and the table of their results."""

    @classmethod
    def load(
        cls,
        campaign: Mapping[str, Any] | str | Path,
        out: str | Path,
        *,
        overrides: Sequence[str] = (),
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
    ) -> Campaign:
        """Create a campaign, or continue the one in the folder if it has the same settings.

        Args:
            campaign: A campaign file, the name of a shipped campaign, or the keys of one, with a scenario as
                :func:`ffsm_mj.run` takes it.
            out: Folder of the campaign.
            overrides: ``key=value`` overrides of the campaign file.
            controllers: Control laws of the caller, classes by kind.
            estimators: Estimators of the caller, likewise.

        Raises:
            InputError: The file is invalid, or the folder holds a campaign with other settings.
            LogWriteError: The folder cannot be written (full disk).
        """
        own = own_classes(campaign.get("scenario") if isinstance(campaign, Mapping) else None, controllers, estimators)
        return cls.begin(load_campaign(campaign, overrides, own), Path(out), own)

    @classmethod
    def begin(cls, plan: Plan, out: Path, own: ScriptClasses = NO_CLASSES) -> Campaign:
        """Create or continue a campaign from a plan; see :meth:`load`."""
        folder = CampaignFolder(out)
        with folder.locked():
            if not folder.is_initialized:
                design = plan.design()
                base = plan.base
                files = base.logged_files
                folder.write(plan.config.model_dump(mode="json", exclude_none=True), base.scenario_yaml, files, design)
            found = cls.open_with(out, own)
            found._adopt(plan)
        return found

    @classmethod
    def open(
        cls,
        out: str | Path,
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
    ) -> Campaign:
        """Open the campaign in a folder; see :meth:`load`.

        Raises:
            InputError: The folder holds no campaign.
        """
        return cls.open_with(Path(out), ScriptClasses(dict(controllers), dict(estimators)))

    @classmethod
    def open_with(cls, out: Path, own: ScriptClasses) -> Campaign:
        """Open the campaign in a folder with classes and metrics of a script; see :meth:`open`."""
        folder = CampaignFolder(out)
        design = folder.design()
        return cls(load_campaign(folder.path / CAMPAIGN, (), own), design, folder, own)

    def _adopt(self, plan: Plan) -> None:
        """Replace the campaign file by that of a plan with the same settings: rows do not depend on the other keys.

        Raises:
            InputError: The settings or the number of samples differ.
        """
        other = campaign_settings(plan, self._own)
        with self._table() as store:
            stored = store.settings or self._settings  # classes and functions of a script are known from the rows only
        if other != stored:
            raise InputError(f"{self.folder.path}: holds a campaign with other settings: {differences(stored, other)}")
        if plan.config.samples.n not in (None, self.design.n):
            larger = plan.config.samples.n > self.design.n
            how = "extend(n) enlarges it" if larger else "Campaign.open continues it"
            if on_command_line():
                words = ("extend", self.folder.path, plan.config.samples.n) if larger else ("resume", self.folder.path)
                how = f"'{command('campaign', *words)}' {'enlarges' if larger else 'continues'} it"
            raise InputError(
                f"{self.folder.path}: holds a design of {self.design.n} samples, not {plan.config.samples.n}; {how}"
            )
        self.config = plan.config
        self.folder.write_config(plan.config.model_dump(mode="json", exclude_none=True))

    @contextmanager
    def _writable_table(self) -> Iterator[Store]:
        """The table, opened for writing.

        Raises:
            InputError: Its rows have other settings.
        """
        with closing(Store(self.folder.table)) as store:
            store.begin(settings_hash(self._settings), self._settings)
            if store.settings != self._settings:
                found = differences(store.settings, self._settings)
                raise InputError(f"{self.folder.path}: its rows were made with other settings: {found}")
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
        """Execute the runs that have no row yet.

        Args:
            executor: Executor for the runs; None: processes on this machine.
            workers: Number of processes; None: that of the campaign file, else one per processor.
            dask: Address of a Dask scheduler to use instead, or ``local`` for a cluster on this machine.
            retry: Outcomes of :data:`ffsm_mj.campaign.storage.outcomes.RETRIED` whose runs are repeated.
            report: Called with (number of rows, number of runs) after every batch.

        Returns:
            Progress of the campaign.

        Raises:
            InputError: Another process runs this campaign, the settings differ, or no worker can execute its runs.
            EngineLostError: The workers are lost; the rows so far are kept.
            LogWriteError: The table cannot be written (full disk); earlier rows are kept.
        """
        with self.folder.locked(), self._writable_table() as store, dask_address(dask, workers) as address:
            engine = choose_engine(executor, workers, address, self._own.every.values(), self.config.limits.workers)
            self.design = self.folder.design()  # another process may have extended it
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

    def _job(self, *, own: bool) -> Job:
        return Job(
            scenario=str(self.folder.scenario.resolve()),
            metrics=self.config.kept_metrics,
            versions=row_versions(),
            digest=settings_hash(self._settings),
            timeout_s=self.config.limits.timeout_s or 0.0,
            own=self._own,
            own_process=own,
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
            self.design = self._plan.extended(self.folder.design(), n)
            samples = self.config.samples.model_copy(update={"n": n})
            self.config = self.config.model_copy(update={"samples": samples})
            self.folder.write_design(self.design)
            self.folder.write_config(self.config.model_dump(mode="json", exclude_none=True))

    def rerun(self, index: int) -> Rerun:
        """Repeat a run and write its log into the folder of the campaign.

        Args:
            index: Index of the run in the design.

        Raises:
            InputError: There is no such run, or it cannot be prepared.
        """
        if not 0 <= index < len(self.design.rows):
            raise InputError(f"run {index}: the design has the runs 0 to {len(self.design.rows) - 1}")
        with self._table() as store:
            row = store.row(index)
            same = store.settings == self._settings
        self.folder.refuse_links()
        folder = self.folder.rerun(index)
        return rerun(self._job(own=False), index, self.design.overrides(index), folder, row, same_settings=same)

    def kept(self) -> list[int]:
        """Indices of the runs whose logs the campaign file asks for."""
        return runs_to_keep(self.rows(), self.config.keep)
