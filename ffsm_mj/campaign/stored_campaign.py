"""Stored state of a campaign: design, rows, progress and statistics."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from ffsm_mj.campaign.evaluation.results import Results, TableRow, column_of, metric_numbers
from ffsm_mj.campaign.evaluation.statistics import Proportion, Quantile, quantile
from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.plan.loading import Plan
from ffsm_mj.campaign.script_classes import ScriptClasses
from ffsm_mj.campaign.storage.folder import CampaignFolder
from ffsm_mj.campaign.storage.settings import campaign_settings
from ffsm_mj.campaign.storage.status import Status, status_of
from ffsm_mj.campaign.storage.store import RunRow, Store
from ffsm_mj.campaign.storage.table import as_arrow, table_rows
from ffsm_mj.errors import InputError


class StoredCampaign:
    """A campaign in its folder, for reading. The folder has the whole state: every method reads its present content.

    Attributes:
        config: The campaign file.
        design: Samples of all runs.
        folder: Folder of the campaign.
    """

    def __init__(self, plan: Plan, design: Design, folder: CampaignFolder, own: ScriptClasses) -> None:
        """Store the parts; use :meth:`ffsm_mj.campaign.campaign.Campaign.open`."""
        self.config: CampaignFile = plan.config
        self.design, self.folder = design, folder
        self._plan, self._own = plan, own
        self._settings = campaign_settings(plan, own)

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
        """A dictionary per run; see :func:`ffsm_mj.campaign.storage.table.table_rows`."""
        return table_rows(self.rows(), self.design, self.config.conditions)

    def table(self) -> Any:
        """All rows as a ``pyarrow.Table``; its method ``to_pandas`` gives a data frame."""
        return as_arrow(self.table_rows())

    def status(self) -> Status:
        """Progress of the campaign."""
        with self._table() as store:
            return status_of(store, self.config.campaign, len(self.design.rows))

    def results(self) -> Results:
        """All rows so far with the names of their columns, for report and statistics."""
        rows, design, config = self.table_rows(), self.design, self.config
        parameters = tuple(column_of(name, "parameter", rows) for name in design.parameters)
        metrics = tuple(column_of(name, "metric", rows) for name in config.kept_metrics)
        return Results(config.campaign, design.kind, design.n, len(design.rows), parameters, metrics, rows)

    def fraction(self, what: str = "success") -> Proportion:
        """Fraction of the runs that are a success, or for which a metric is true, with its confidence interval."""
        rows = self.results().sample
        return Proportion(sum(row.get(what) is True for row in rows), len(rows))

    def quantile(self, metric: str, share: float) -> Quantile:
        """Quantile of a metric over the runs that did not fail, with its confidence interval.

        Args:
            metric: Name of the metric.
            share: Probability of the quantile, e.g. 0.95.

        Raises:
            InputError: No run that did not fail has a number for the metric.
        """
        values = metric_numbers(self.results().sample, metric)
        if not len(values):
            raise InputError(f"{metric}: no run that did not fail has a number for it")
        return quantile(values, share)
