"""Weights of quadratic costs in a scenario."""

from __future__ import annotations

import numpy as np

from ffsm_mj.controller_protocol import Fault, FloatArray, ScenarioFaults

Weight = tuple[float, ...] | tuple[tuple[float, ...], ...]


def _matrix(weight: Weight, size: int, key: str, of: str) -> FloatArray:
    """Weight as a symmetric matrix.

    Raises:
        ScenarioFaults: Wrong size, or not symmetric.
    """
    rows = [row if isinstance(row, tuple) else (row,) for row in weight]
    flat = not any(isinstance(row, tuple) for row in weight)
    if len(rows) != size or (not flat and any(len(row) != size for row in rows)):
        raise ScenarioFaults([Fault(f"must be {size} numbers (a diagonal) or {size} rows of {size}, {of}", (key,))])
    matrix = np.diag(np.array(weight)) if flat else np.array(rows)
    if not np.array_equal(matrix, matrix.T):
        raise ScenarioFaults([Fault("must be symmetric", (key,))])
    return np.asarray(matrix, dtype=np.float64)


def state_weight(weight: Weight, p: int) -> FloatArray:
    """Weight Q of an output and its rates, (2 p, 2 p).

    Raises:
        ScenarioFaults: Not positive semidefinite, or singular on the output; path ``Q``.
    """
    Q = _matrix(weight, 2 * p, "Q", f"for {p} outputs and their rates")
    eigenvalues = np.linalg.eigvalsh(Q)
    if eigenvalues[0] < -1e-12 * max(eigenvalues[-1], 0.0):
        raise ScenarioFaults(
            [Fault(f"must be positive semidefinite; its smallest eigenvalue is {eigenvalues[0]:.3g}", ("Q",))]
        )
    position = np.linalg.eigvalsh(Q[:p, :p])
    if position[0] <= 1e-12 * position[-1] or position[-1] <= 0.0:
        message = (
            "its position block must be regular, or no gain brings the tip to the target; raise its first diagonal entries"
        )
        raise ScenarioFaults([Fault(message, ("Q",))])
    return Q


def input_weight(weight: Weight, count: int) -> FloatArray:
    """Weight R of the efforts of some joints, (n, n).

    Raises:
        ScenarioFaults: Not positive definite; path ``R``.
    """
    R = _matrix(weight, count, "R", "one per driven joint")
    smallest = np.linalg.eigvalsh(R)[0]
    if smallest <= 0.0:
        raise ScenarioFaults([Fault(f"must be positive definite; its smallest eigenvalue is {smallest:.3g}", ("R",))])
    return R
