"""Progress of a campaign: its runs by outcome, and what fails."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ffsm_mj.experiments.store import RunRow, Store

_SHOWN = 3
"""Number of failed runs that are listed."""
EXCESS = "excess."
"""Prefix of metrics with the residual of a failing check over its tolerance."""


@dataclass(frozen=True)
class FailingCheck:
    """A check that fails in some runs.

    Attributes:
        name: Name of the check.
        runs: Number of runs in which it fails.
        excess: Largest residual over tolerance; infinite if one is not finite.
        worst: Index of the run with the largest residual.
    """

    name: str
    runs: int
    excess: float
    worst: int


@dataclass(frozen=True)
class Status:
    """Progress of a campaign.

    Attributes:
        name: Name of the campaign.
        runs: Number of runs of the design.
        done: Number of runs that have a row.
        failed: Number of failed runs: not completed, or a check fails.
        outcomes: Number of runs by outcome.
        messages: One line for each of the first failed runs.
        checks: Failing checks, the most frequent first.
        stopped: Why the campaign stopped early because runs fail; empty if it did not.
        enough: Why the campaign ended early because a result is known; empty if it did not.
        variants: Progress of each variant.
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
    variants: Mapping[str, Status] = field(default_factory=dict)

    @property
    def left(self) -> int:
        """Number of runs without a row."""
        return self.runs - self.done


def status_of(store: Store, name: str, runs: int) -> Status:
    """Progress of a campaign according to its table.

    Args:
        store: The table.
        name: Name of the campaign.
        runs: Number of runs of the design.
    """
    outcomes = store.outcomes()
    failed = store.failures()
    messages = tuple(f"run {row.index}: {_why(row)}" for row in failed[:_SHOWN])
    return Status(name, runs, sum(outcomes.values()), len(failed), outcomes, messages, failing_checks(failed))


def status_of_variants(name: str, variants: Mapping[str, Status]) -> Status:
    """Progress of a campaign with variants."""
    outcomes: Counter[str] = Counter()
    for part in variants.values():
        outcomes.update(part.outcomes)
    runs, done, failed = (sum(getattr(part, key) for part in variants.values()) for key in ("runs", "done", "failed"))
    stopped = "; ".join(f"{name}: {part.stopped}" for name, part in variants.items() if part.stopped)
    return Status(name, runs, done, failed, outcomes, (), stopped=stopped, variants=variants)


def failing_checks(failed: Iterable[RunRow]) -> tuple[FailingCheck, ...]:
    """Failing checks of failed runs of any outcome, the most frequent first."""
    by_check: dict[str, list[tuple[float, int]]] = {}
    for row in failed:
        for name, excess in _excesses(row).items():
            by_check.setdefault(name, []).append((excess, row.index))
    # The first of several runs with the largest excess.
    worst = {name: max(margins, key=lambda one: (one[0], -one[1])) for name, margins in by_check.items()}
    checks = [FailingCheck(name, len(margins), *worst[name]) for name, margins in by_check.items()]
    return tuple(sorted(checks, key=lambda check: (-check.runs, -check.excess, check.name)))


def _excesses(row: RunRow) -> dict[str, float]:
    """Residual over tolerance of each check that fails in a run."""
    excesses = {key.removeprefix(EXCESS): value for key, value in row.metrics.items() if key.startswith(EXCESS)}
    return {
        name.replace("_", " "): float(value) if isinstance(value, int | float) else math.inf
        for name, value in excesses.items()
    }


def _why(row: RunRow) -> str:
    """Reason for the failure of a run."""
    if row.outcome == "completed":
        fails = [f"{name} ({excess:.3g} times its tolerance)" for name, excess in _excesses(row).items()]
        alone = row.metrics.get("fails_by_truncation", False)
        short = " by the truncation of the step alone" if alone else ""
        text = f"checks fail{short}: {', '.join(fails)}" if fails else f"a check fails{short}"
        return f"{text}; truncation: not analysed" if alone is None else text
    return f"{row.outcome}: {row.message}" if row.message else row.outcome
