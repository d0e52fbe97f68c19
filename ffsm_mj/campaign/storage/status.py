"""How far a campaign is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ffsm_mj.campaign.storage.store import RunRow, Store

_SHOWN = 3
"""So many failures are told of."""
EXCESS = "excess."
"""How metrics begin that say of a check that fails how many times its tolerance the residual is."""


@dataclass(frozen=True)
class FailingCheck:
    """A check that fails in some runs.

    Attributes:
        name: Of the check.
        runs: In how many.
        excess: The largest residual over its tolerance; infinite where one is not finite.
        worst: Number of that run.
    """

    name: str
    runs: int
    excess: float
    worst: int


@dataclass(frozen=True)
class Status:
    """How far a campaign is.

    Attributes:
        name: Of the campaign.
        runs: How many the design has.
        done: How many have a row.
        failed: How many of those failed: did not come to their end, or fails a check.
        outcomes: How many by outcome.
        messages: The first failed runs, a line each.
        checks: The checks that fail, the most frequent first.
        stopped: Why it was given up before its end; empty where it was not.
        enough: What was known well enough to end it; empty where that is not why it ended.
    """

    name: str
    runs: int
    done: int
    failed: int
    outcomes: Mapping[str, int]
    messages: tuple[str, ...]
    checks: tuple[FailingCheck, ...] = ()
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
    failed = store.failures(runs)
    messages = tuple(f"run {row.index}: {_why(row)}" for row in failed[:_SHOWN])
    return Status(name, runs, sum(outcomes.values()), store.failed(runs), outcomes, messages, failing_checks(failed))


def failing_checks(failed: Iterable[RunRow]) -> tuple[FailingCheck, ...]:
    """What the failed runs say of their checks, whatever their outcome; the most frequent first."""
    found: dict[str, list[tuple[float, int]]] = {}
    for row in failed:
        for name, excess in _excesses(row).items():
            found.setdefault(name, []).append((excess, row.index))
    # Of equal ones the first run is the worst.
    worst = {name: max(each, key=lambda one: (one[0], -one[1])) for name, each in found.items()}
    made = [FailingCheck(name, len(each), *worst[name]) for name, each in found.items()]
    return tuple(sorted(made, key=lambda check: (-check.runs, -check.excess, check.name)))


def _excesses(row: RunRow) -> dict[str, float]:
    """Residual over tolerance of each check that fails in a run."""
    told = {key.removeprefix(EXCESS): value for key, value in row.metrics.items() if key.startswith(EXCESS)}
    return {
        name.replace("_", " "): float(value) if isinstance(value, int | float) else math.inf for name, value in told.items()
    }


def _why(row: RunRow) -> str:
    """Why a run failed."""
    if row.outcome == "completed":
        fails = [f"{name} ({excess:.3g} times its tolerance)" for name, excess in _excesses(row).items()]
        short = " by the truncation of the step alone" if row.metrics.get("fails_by_truncation") is True else ""
        return f"checks fail{short}: {', '.join(fails)}" if fails else f"a check fails{short}"
    return f"{row.outcome}: {row.message}" if row.message else row.outcome
