"""Small dense linear systems, by the functions of LAPACK that NumPy calls too at several times their cost."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.tolerances import EPSILON, RANK


def solved(system: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of linear equations; large where they are singular, as at the limit of Painleve's paradox."""
    solution: FloatArray
    _, _, solution, singular = _lapack().dgesv(system, right)
    if singular:
        return np.asarray(np.linalg.lstsq(system, right, rcond=EPSILON)[0])
    return solution


def independent_rows(square: FloatArray) -> IntArray:
    """Indices of a largest set of independent rows of a positive semidefinite matrix, by Cholesky with pivots."""
    if not len(square):
        return np.zeros(0, dtype=np.int64)
    _, order, rank, _ = _lapack().dpstrf(square, tol=RANK * square.diagonal().max())
    return np.asarray(order[:rank] - 1, dtype=np.int64)


def range_basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the space that independent columns span, of the same shape, by Householder's method."""
    basis: FloatArray
    lapack = _lapack()
    reflectors, scales, _, _ = lapack.dgeqrf(columns)
    basis, _, _ = lapack.dorgqr(reflectors, scales)
    return basis


@cache
def _lapack() -> Any:
    from scipy.linalg import lapack  # a third of a second to import

    return lapack
