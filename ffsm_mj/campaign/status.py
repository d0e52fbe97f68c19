"""How far a campaign is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ffsm_mj.campaign.store import Row, Store

_SHOWN = 3
"""So many failures are told of."""


@dataclass(frozen=True)
class Status:
    """How far a campaign is.

    Attributes:
        name: Of the campaign.
        runs: How many the design has.
        done: How many have a row.
        failed: How many of those failed: did not come to their end, or violate a law.
        outcomes: How many by outcome.
        messages: The first failed runs, a line each.
        stopped: Why it was given up before its end; empty where it was not.
        enough: What was known well enough to end it; empty where that is not why it ended.
    """

    name: str
    runs: int
    done: int
    failed: int
    outcomes: Mapping[str, int]
    messages: tuple[str, ...]
    stopped: str = ""
    enough: str = ""

    @property
    def left(self) -> int:
        """How many are to be made."""
        return self.runs - self.done


def status_of(store: Store, name: str, runs: int) -> Status:
    """What the table of a campaign tells.

    Args:
        store: The table.
        name: Name of the campaign.
        runs: How many its design has.
    """
    outcomes = store.outcomes()
    messages = tuple(f"run {row.index}: {_why(row)}" for row in store.failures(_SHOWN))
    return Status(name, runs, sum(outcomes.values()), store.failed(runs), outcomes, messages)


def _why(row: Row) -> str:
    """Why a run failed."""
    if row.outcome == "completed":
        return "a law is violated"
    return f"{row.outcome}: {row.message}" if row.message else row.outcome
