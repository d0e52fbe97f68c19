"""Early end of a campaign: too many runs fail, or an interval is narrow enough."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ffsm_mj.campaign.evaluation.convergence import narrow_enough
from ffsm_mj.campaign.evaluation.results import Results
from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.campaign.storage.store import RunRow

FIRST = 50
"""Number of first runs whose failures decide whether the campaign continues."""


class StoppingRule:
    """Decides from the rows so far whether a campaign ends.

    Attributes:
        failing: Message that too many runs fail; empty if they do not.
        enough: Message that the interval of ``stop`` is narrow enough; empty if it is not.
    """

    def __init__(
        self, config: CampaignFile, runs: int, done: Iterable[int], failed: int, results: Callable[[], Results]
    ) -> None:
        """Start with the rows of a campaign that may have been interrupted.

        Args:
            config: Campaign file with the limits.
            runs: Total number of runs.
            done: Indices of runs that have a row.
            failed: Number of failures among the first ``FIRST`` runs.
            results: Returns all rows so far.
        """
        self._config, self._results = config, results
        self._first, self._failed = min(FIRST, runs), failed
        self._done, self._complete, self._evaluated_at = set(done), 0, 0
        self._advance()
        self.failing, self.enough = "", ""

    def add(self, rows: Iterable[RunRow]) -> None:
        """Count new rows."""
        for row in rows:
            self._done.add(row.index)
            self._failed += row.failed and row.index < self._first
        self._advance()

    def _advance(self) -> None:
        while self._complete in self._done:
            self._complete += 1

    def ends(self) -> bool:
        """Whether the campaign ends now."""
        self.failing, self.enough = self._failing(), self._enough()
        return bool(self.failing or self.enough)

    def _failing(self) -> str:
        share = self._config.limits.max_failed
        if self._failed <= share * self._first:
            return ""
        return f"{self._failed} of the first {self._first} runs failed, more than limits.max_failed = {share:g}"

    def _enough(self) -> str:
        """Evaluated when the first 2^k runs are complete: more frequent evaluation would spoil the confidence."""
        stop, power = self._config.stop, 1 << (self._complete.bit_length() - 1) if self._complete else 0
        if stop is None or power <= self._evaluated_at:
            return ""
        self._evaluated_at = power
        if not narrow_enough(self._results(), stop.metric, stop.width):
            return ""
        return f"the 95 % interval of {stop.metric} is narrower than {stop.width:g} after {power} runs"
