"""A run of a campaign made again, with its log, and whether it is the one of the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ffsm_mj.assembly.run import simulate
from ffsm_mj.campaign.execution.effort import Effort
from ffsm_mj.campaign.execution.metrics import Scalar, always, evaluated
from ffsm_mj.campaign.execution.worker import Job, prepared_run, processor
from ffsm_mj.campaign.storage.outcomes import ERROR
from ffsm_mj.campaign.storage.store import RunRow
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.run import Run

TOLERANCE = 1e-6
"""How far a number x may be from that of a row of another machine or of other versions, times max(1, |x|)."""
_RESIDUALS = ("checks.", "drift", "conservation.", "deepest_overlap_m")
"""What is rounding, and another on another machine."""


@dataclass(frozen=True)
class Rerun:
    """A run made again.

    Attributes:
        index: Its number in the design.
        run: The run, with everything that it logged.
        exact: Whether it was made as the row was, so that every number must be the same bit by bit.
        differences: What is not as it must be, one line each.
    """

    index: int
    run: Run
    exact: bool
    differences: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """What was compared and found, in a sentence."""
        if self.differences:
            return f"run {self.index} is not the row's: {'; '.join(self.differences)}"
        if self.exact:
            return f"run {self.index} is the row's, bit by bit"
        why = f"made by another processor or other versions: outcome and impacts are the same, numbers to {TOLERANCE:g}"
        return f"run {self.index} is the row's, {why}"


def rerun(
    job: Job, index: int, overrides: Mapping[str, Any], folder: Path, row: RunRow | None, *, same_settings: bool
) -> Rerun:
    """Make a run again and keep its log.

    Args:
        job: The campaign.
        index: Number of the run.
        overrides: What the design sets for it.
        folder: Run folder to write; one that is there is replaced.
        row: What it came to before; None: nothing to compare.
        same_settings: Whether that was with the same settings, versions of packages among them.

    Raises:
        InputError: The run cannot be made.
    """
    assembly = prepared_run(job, overrides).assemble()
    effort = Effort(assembly.system, assembly.actuation.keys)
    run = simulate(assembly, RunFolder(folder, force=True), with_rerun=False, watchers=(effort,))
    if run.outcome == Outcome.INTERRUPTED:
        raise KeyboardInterrupt  # its log is kept, the rest of what was asked for is not made
    if row is None:
        return Rerun(index, run, True, ())
    exact = row.cpu == processor() and same_settings
    outcome, metrics = run.outcome, dict[str, Scalar]()
    try:
        metrics = evaluated(run, effort.told(), job.metrics, always(run.checks(), truncated=job.truncated))
    except (Exception, SystemExit):  # noqa: BLE001 (as it may where rows are made, and is such a row there)
        outcome = ERROR
    return Rerun(index, run, exact, tuple(_differences(row, outcome, metrics, job.metrics, exact=exact)))


def _differences(
    row: RunRow, outcome: str, metrics: Mapping[str, Scalar], asked: Sequence[str], *, exact: bool
) -> list[str]:
    found = [] if row.outcome == outcome else [f"outcome {outcome}, {row.outcome} in the table"]
    for name in dict.fromkeys([*row.metrics, *asked]):
        before, now = row.metrics.get(name), metrics.get(name)
        if before != now and (exact or not _near(name, before, now)):
            found.append(f"{name} {now!r}, {before!r} in the table")
    return found


def _near(name: str, before: Any, now: Any) -> bool:
    if name.startswith(_RESIDUALS):
        return True
    numbers = isinstance(before, float) and isinstance(now, float)
    return numbers and abs(before - now) <= TOLERANCE * max(1.0, abs(before))
