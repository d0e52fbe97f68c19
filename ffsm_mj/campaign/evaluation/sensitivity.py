"""Sensitivity of metrics to parameters: rank correlations, and Sobol indices for Saltelli designs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.campaign.evaluation.results import Results, numbers
from ffsm_mj.campaign.evaluation.statistics import CONFIDENCE, is_constant

_RESAMPLES = 999
_LEAST_POINTS = 8


def rank_correlation(results: Results, parameter: str, metric: str) -> float | None:
    """Spearman's rank correlation over the runs that did not fail and have both values.

    Returns:
        -1 to 1; None if a column is constant or has fewer than three numbers.
    """
    from scipy.stats import spearmanr  # slow to import

    rows = [row for row in results.sample if not row["failed"]]
    x, y = numbers(rows, parameter), numbers(rows, metric)
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    if len(x) < 3 or is_constant(x) or is_constant(y):
        return None
    return float(spearmanr(x, y).statistic)


@dataclass(frozen=True)
class SobolIndices:
    """Sobol indices of one parameter with bootstrap confidence intervals.

    Attributes:
        parameter: Column of the parameter.
        first: First-order index: fraction of the variance due to the parameter alone.
        first_interval: Confidence interval of ``first``.
        total: Total index: fraction of the variance that remains if all other parameters are fixed.
        total_interval: Confidence interval of ``total``.
    """

    parameter: str
    first: float
    first_interval: tuple[float, float]
    total: float
    total_interval: tuple[float, float]


def sobol_indices(results: Results, metric: str) -> list[SobolIndices]:
    """Sobol indices from a Saltelli design.

    Raises:
        ValueError: The design is of another kind, the metric is constant, or a run failed, has no row or lacks the metric:
            the estimators need all values. The message gives the reason.
    """
    blocks = _all_values(results, metric).reshape(len(results.parameters) + 2, results.n)
    estimates = _estimates(blocks)
    rng, tail = np.random.default_rng(0), 0.5 * (1.0 - CONFIDENCE)
    again = [_estimates(blocks[:, rng.integers(results.n, size=results.n)]) for _ in range(_RESAMPLES)]
    low, high = np.quantile(again, (tail, 1.0 - tail), axis=0)
    first, total = ([(float(low[k, i]), float(high[k, i])) for i in range(len(results.parameters))] for k in (0, 1))
    return [
        SobolIndices(parameter, float(estimates[0, i]), first[i], float(estimates[1, i]), total[i])
        for i, parameter in enumerate(results.parameters)
    ]


def _estimates(blocks: FloatArray) -> FloatArray:
    """First-order and total indices, (2, d), from values at the points of a Saltelli design, (d + 2, n)."""
    from scipy import stats

    parts = {"f_A": blocks[None, 0], "f_B": blocks[None, 1], "f_AB": blocks[2:, None]}
    found = stats.sobol_indices(func=parts, n=blocks.shape[1])
    return np.array([np.ravel(found.first_order), np.ravel(found.total_order)])


def _all_values(results: Results, metric: str) -> FloatArray:
    if results.kind != "saltelli":
        raise ValueError(f"Sobol indices need samples of kind saltelli, not {results.kind}")
    if results.n < _LEAST_POINTS:
        raise ValueError(f"n = {results.n} is too small for Sobol indices; at least {_LEAST_POINTS}, 128 give an estimate")
    if not results.complete:
        raise ValueError(f"{results.runs - len(results.rows)} runs have no result yet")
    failed = [row["run"] for row in results.rows if row["failed"]]
    if failed:
        raise ValueError(f"{len(failed)} runs failed, first run {failed[0]}; Sobol indices need every run")
    values = numbers(results.rows, metric)
    lacking = np.flatnonzero(~np.isfinite(values))
    if len(lacking):
        raise ValueError(f"{len(lacking)} runs have no {metric}, first run {lacking[0]}; Sobol indices need every run")
    if is_constant(values[: 2 * results.n]):
        raise ValueError("constant")
    return values
