"""Repetition of a run of a campaign with its log, and comparison with the row in the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.prepare import uninterrupted
from ffsm_mj.assembly.run import simulate
from ffsm_mj.campaign.execution.metrics import Scalar, check_metrics, metric_values
from ffsm_mj.campaign.execution.worker import Job, checks_with_verdict, prepared_run, processor
from ffsm_mj.campaign.storage.outcomes import ERROR
from ffsm_mj.campaign.storage.store import RunRow
from ffsm_mj.log.run_folder import RunFolder

TOLERANCE = 1e-6
"""Allowed difference from a row of another processor or other versions, times max(1, |x|) for a number x."""
_RESIDUALS = ("checks.", "drift", "conservation.", "deepest_overlap_m")
"""Metrics that are rounding errors, which differ between processors."""


@dataclass(frozen=True)
class Rerun:
    """A repeated run.

    Attributes:
        index: Index of the run in the design.
        run: The run with its log.
        exact: Whether processor, versions and settings are those of the row, so that all numbers must agree bit for bit.
        differences: Unexpected differences from the row, one line each.
    """

    index: int
    run: Run
    exact: bool
    differences: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """Result of the comparison, in a sentence."""
        if self.differences:
            return f"run {self.index} differs from its row: {'; '.join(self.differences)}"
        if self.exact:
            return f"run {self.index} agrees with its row bit for bit"
        return f"run {self.index} agrees with its row to {TOLERANCE:g} (another processor, or other versions or settings)"


def rerun(
    job: Job, index: int, overrides: Mapping[str, Any], folder: Path, row: RunRow | None, *, same_settings: bool
) -> Rerun:
    """Repeat a run and write its log.

    Args:
        job: The campaign.
        index: Index of the run.
        overrides: Overrides of the run from the design.
        folder: Run folder to write; an existing one is replaced.
        row: Row to compare with; None: no comparison.
        same_settings: Whether the row has the present settings, including package versions.

    Raises:
        InputError: The run cannot be prepared.
    """
    assembly = prepared_run(job, index, overrides).assemble()
    # If it is interrupted, its log is kept, and the remaining runs are not executed.
    run = uninterrupted(simulate(assembly, RunFolder(folder, force=True), with_rerun=False))
    if row is None:
        return Rerun(index, run, True, ())
    exact = row.cpu == processor() and same_settings
    outcome, metrics = run.outcome, dict[str, Scalar]()
    try:
        checked = check_metrics(checks_with_verdict(run, lambda: run.log), truncated=job.truncated)
        metrics = metric_values(run, job.metrics, checked, job.own.metrics)
    except (Exception, SystemExit):  # noqa: BLE001 (a worker makes a row with the outcome error of it)
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
