"""Results of a study: rows of all variants, and how many runs completed, passed their checks and were a success."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.evaluation.results import Results, TableRow, column_of, numbers
from ffsm_mj.campaign.execution.metrics import FAULT
from ffsm_mj.studies.config import StudyFile

SUCCESS = "success"


@dataclass(frozen=True)
class VariantCounts:
    """Counts of the runs of a variant.

    Attributes:
        runs: Number of runs of the design.
        done: Number of runs that have a row.
        outcomes: Number of runs by outcome, the most frequent first.
        violated: Completed runs of which a check fails.
        met: Completed runs that meet the success condition, whether or not their checks pass; None without a condition.
        successes: Of these, runs whose checks pass; None without a condition.
    """

    runs: int
    done: int
    outcomes: Mapping[str, int]
    violated: int
    met: int | None
    successes: int | None

    @property
    def completed(self) -> int:
        """Number of completed runs."""
        return self.outcomes.get("completed", 0)


@dataclass(frozen=True)
class MetricFault:
    """A metric of the caller that raised an exception, or gave no valid number, in some runs of a variant.

    Attributes:
        metric: Name of the metric.
        variant: Name of the variant.
        runs: Indices of these runs.
        message: What was wrong in the first of them.
    """

    metric: str
    variant: str
    runs: tuple[int, ...]
    message: str

    def sentence(self) -> str:
        """The fault in one line."""
        more = f" and {len(self.runs) - 1} more" if len(self.runs) > 1 else ""
        return f"metric {self.metric} has no value in run {self.runs[0]}{more} of {self.variant}: {self.message}"


@dataclass(frozen=True)
class StudyResults:
    """Rows of all variants so far.

    Attributes:
        config: The study file.
        variants: Results by variant, in the order of the study file.
        not_applicable: Why the other variants have none.
    """

    config: StudyFile
    variants: Mapping[str, Results]
    not_applicable: Mapping[str, str]

    @property
    def metrics(self) -> tuple[str, ...]:
        """Columns of the metrics of the study."""
        return next(iter(self.variants.values())).metrics

    @property
    def complete(self) -> bool:
        """Whether every run of every variant has a row."""
        return all(each.complete for each in self.variants.values())

    def counts(self, variant: str) -> VariantCounts:
        """Counts of the runs of a variant."""
        rows = self.variants[variant].rows
        completed = [row for row in rows if row["outcome"] == "completed"]
        met = [row for row in completed if self._is_met(row, rows)]
        has_condition = bool(self.config.conditions)
        return VariantCounts(
            self.variants[variant].runs,
            len(rows),
            dict(Counter(str(row["outcome"]) for row in rows).most_common()),
            sum(row["failed"] for row in completed),
            len(met) if has_condition else None,
            sum(not row["failed"] for row in met) if has_condition else None,
        )

    def _is_met(self, row: TableRow, rows: Sequence[TableRow]) -> bool:
        conditions = self.config.conditions
        return all(each.holds({each.metric: row.get(column_of(each.metric, "metric", rows))}) for each in conditions)

    def values(self, variant: str, metric: str) -> FloatArray:
        """Values of a metric over the runs of a variant that completed and pass their checks; NaN where a run has none."""
        return numbers([row for row in self.variants[variant].rows if not row["failed"]], metric)

    def metric_faults(self) -> list[MetricFault]:
        """Metrics of the caller that had no value, by metric and variant."""
        found: dict[tuple[str, str], list[TableRow]] = {}
        for variant, results in self.variants.items():
            for row in results.rows:
                for name in row:
                    if name.startswith(FAULT):
                        found.setdefault((name, variant), []).append(row)
        return [
            MetricFault(name.removeprefix(FAULT), variant, tuple(row["run"] for row in rows), str(rows[0][name]))
            for (name, variant), rows in found.items()
        ]
