"""Groups of failed runs, and the parameters by which they differ from the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.campaign.evaluation.results import Results, TableRow, is_good, numbers

NO_SUCCESS = "no success"
"""Group of completed runs that pass their checks but do not meet the success condition."""
_LEAST = 5
"""Smallest number of runs on either side for a comparison."""


@dataclass(frozen=True)
class FailureGroup:
    """Runs that failed in the same way.

    Attributes:
        how: Outcome, with the type of an ``error`` or ``internal_error``; for completed runs, what they do not pass.
        phase: Last phase that began; empty if none did.
        runs: Indices of the runs.
        message: Message of the first run.
    """

    how: str
    phase: str
    runs: tuple[int, ...]
    message: str


def groups(results: Results) -> list[FailureGroup]:
    """Groups of runs that are not good, the largest group first."""
    found: dict[tuple[str, str], list[TableRow]] = {}
    for row in results.rows:
        if not is_good(row):
            found.setdefault((_how(row), row["phase"]), []).append(row)
    made = [
        FailureGroup(how, phase, tuple(row["run"] for row in rows), rows[0]["message"])
        for (how, phase), rows in found.items()
    ]
    return sorted(made, key=lambda group: (-len(group.runs), group.runs))


def _how(row: TableRow) -> str:
    if row["outcome"] == "completed":
        short = row.get("fails_by_truncation") is True
        how = "checks fail by the truncation of the step alone" if short else "a check fails"
        return how if row["failed"] else NO_SUCCESS
    error = ""
    if row["outcome"] == "error":
        error = row["message"].partition(":")[0]
    elif row["outcome"] == "internal_error":  # "at t = 0.3 s: ZeroDivisionError: ..."
        error = row["message"].partition(": ")[2].partition(":")[0]
    return f"{row['outcome']} ({error})" if error else str(row["outcome"])


@dataclass(frozen=True)
class ParameterDifference:
    """Difference of a parameter's distribution between good and other runs.

    Attributes:
        parameter: Column of the parameter.
        statistic: Kolmogorov-Smirnov statistic: largest distance of the two distribution functions, 0 to 1.
        probability: p-value, corrected for the number of parameters (Holm).
    """

    parameter: str
    statistic: float
    probability: float


def differences(results: Results) -> list[ParameterDifference]:
    """Differences by parameter, the smallest p-value first; empty if there are too few runs on either side."""
    from scipy.stats import ks_2samp  # slow to import

    good = np.array([is_good(row) for row in results.sample], dtype=np.bool_)
    found = []
    for parameter in results.parameters:
        values = numbers(results.sample, parameter)
        sides = [values[side & np.isfinite(values)] for side in (good, ~good)]
        if min(map(len, sides)) >= _LEAST:
            compared = ks_2samp(*sides)
            found.append((parameter, float(compared.statistic), float(compared.pvalue)))
    corrected = holm([probability for *_, probability in found])
    made = [ParameterDifference(name, distance, p) for (name, distance, _), p in zip(found, corrected, strict=True)]
    return sorted(made, key=lambda difference: (difference.probability, -difference.statistic))


def holm(probabilities: Sequence[float]) -> list[float]:
    """p-values with Holm's correction, which bounds the probability of any false positive."""
    order = sorted(range(len(probabilities)), key=lambda i: probabilities[i])
    corrected = [1.0] * len(probabilities)
    greatest = 0.0
    for rank, i in enumerate(order):
        greatest = max(greatest, min(1.0, (len(probabilities) - rank) * probabilities[i]))
        corrected[i] = greatest
    return corrected
