"""When a campaign ends before its last run: too much fails, or enough is known."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ffsm_mj.campaign.evaluation.convergence import narrow_enough
from ffsm_mj.campaign.evaluation.results import Results
from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.campaign.storage.store import RunRow

FIRST = 50
"""So many runs tell whether the campaign is worth going on with."""


class StoppingRule:
    """Follows the rows as they come.

    Attributes:
        failing: Why too much fails to go on, in a sentence; empty to go on.
        enough: What is known well enough to end, in a sentence; empty to go on.
    """

    def __init__(
        self, config: CampaignFile, runs: int, done: Iterable[int], failed: int, results: Callable[[], Results]
    ) -> None:
        """Begin with what there is.

        Args:
            config: Which states the limits.
            runs: How many there are in all.
            done: Numbers of those that have a row.
            failed: How many of the first of them failed.
            results: Gives all rows so far.
        """
        self._config, self._results = config, results
        self._first, self._failed = min(FIRST, runs), failed
        self._done, self._beginning, self._looked = set(done), 0, 0
        self._advance()
        self.failing, self.enough = "", ""

    def add(self, rows: Iterable[RunRow]) -> None:
        """Rows came."""
        for row in rows:
            self._done.add(row.index)
            self._failed += row.failed and row.index < self._first
        self._advance()

    def _advance(self) -> None:
        while self._beginning in self._done:
            self._beginning += 1

    def ends(self) -> bool:
        """Whether it ends here."""
        self.failing, self.enough = self._failing(), self._enough()
        return bool(self.failing or self.enough)

    def _failing(self) -> str:
        share = self._config.limits.max_failed
        if self._failed <= share * self._first:
            return ""
        return f"{self._failed} of the first {self._first} runs failed, more than limits.max_failed = {share:g}"

    def _enough(self) -> str:
        """Looked at when a power of 2 of the first runs is there: an interval that is looked at often means less."""
        stop, power = self._config.stop, 1 << (self._beginning.bit_length() - 1) if self._beginning else 0
        if stop is None or power <= self._looked:
            return ""
        self._looked = power
        if not narrow_enough(self._results(), stop.metric, stop.width):
            return ""
        return f"the 95 % interval of {stop.metric} is narrower than {stop.width:g} after {power} runs"
