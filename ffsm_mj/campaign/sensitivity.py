"""Which parameters a metric depends on: rank correlations, and Sobol's indices where the design allows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.results import Results, numbers
from ffsm_mj.campaign.statistics import CONFIDENCE, is_constant

_RESAMPLES = 999


def rank_correlation(results: Results, parameter: str, metric: str) -> float | None:
    """Spearman's correlation over the runs that did not fail and have both.

    Returns:
        -1 to 1; None where one of them is constant, or has no order.
    """
    from scipy.stats import spearmanr  # SciPy's statistics cost: for those who use them

    rows = [row for row in results.sample if not row["failed"]]
    x, y = numbers(rows, parameter), numbers(rows, metric)
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    if len(x) < 3 or is_constant(x) or is_constant(y):
        return None
    return float(spearmanr(x, y).statistic)


@dataclass(frozen=True)
class Index:
    """Sobol's indices of one parameter, each with its interval by bootstrap.

    Attributes:
        parameter: Its column.
        first: Share of the variance that it explains by itself.
        first_interval: Of that.
        total: Share that is left while only it is unknown.
        total_interval: Of that.
    """

    parameter: str
    first: float
    first_interval: tuple[float, float]
    total: float
    total_interval: tuple[float, float]


def sobol_indices(results: Results, metric: str) -> list[Index]:
    """Sobol's indices from a Saltelli design.

    Raises:
        ValueError: The design is another, or a run of it failed, has no row, or lacks the metric: one missing number would
            make all indices meaningless. Or the metric is constant. The message says which.
    """
    values = _whole(results, metric)
    from scipy import stats

    d, n = len(results.parameters), results.n
    f_a, f_b, f_ab = values[:n], values[n : 2 * n], values[2 * n :].reshape(d, 1, n)
    parts = {"f_A": f_a[None], "f_B": f_b[None], "f_AB": f_ab}
    found = stats.sobol_indices(func=parts, n=n, rng=np.random.default_rng(0))
    again = found.bootstrap(confidence_level=CONFIDENCE, n_resamples=_RESAMPLES)
    return [
        Index(
            parameter,
            float(np.ravel(found.first_order)[k]),
            _ends(again.first_order.confidence_interval, k),
            float(np.ravel(found.total_order)[k]),
            _ends(again.total_order.confidence_interval, k),
        )
        for k, parameter in enumerate(results.parameters)
    ]


def _whole(results: Results, metric: str) -> FloatArray:
    if results.kind != "saltelli":
        raise ValueError(f"Sobol indices need samples of kind saltelli, these are {results.kind}")
    if not results.complete:
        raise ValueError(f"{results.runs - len(results.rows)} runs are not made yet")
    failed = [row["run"] for row in results.rows if row["failed"]]
    if failed:
        raise ValueError(f"{len(failed)} runs failed, run {failed[0]} the first; indices need every run")
    values = numbers(results.rows, metric)
    lacking = np.flatnonzero(~np.isfinite(values))
    if len(lacking):
        raise ValueError(f"{len(lacking)} runs have no {metric}, run {lacking[0]} the first; indices need every run")
    if is_constant(values):
        raise ValueError("constant")
    return values


def _ends(interval: object, k: int) -> tuple[float, float]:
    low, high = (np.ravel(getattr(interval, end))[k] for end in ("low", "high"))
    return float(low), float(high)
