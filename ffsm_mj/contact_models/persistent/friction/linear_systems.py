"""Small dense linear systems, by the functions of LAPACK that NumPy calls too at several times their cost."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import EPSILON, RANK


def solved(system: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of linear equations; large where they are singular, as at the limit of Painleve's paradox."""
    solution: FloatArray
    _, _, solution, singular = _lapack().dgesv(system, right)
    if singular:
        return np.asarray(np.linalg.lstsq(system, right, rcond=EPSILON)[0])
    return solution


def triangular_solution(R: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Solution of R x = right, or of R^T x = right, with an upper triangular R; the least one where R is singular."""
    sizes = np.abs(R.diagonal())
    if sizes.min() <= EPSILON * sizes.max():
        return np.asarray(np.linalg.lstsq(R.T if transposed else R, right, rcond=None)[0])
    solution: FloatArray = _lapack().dtrtrs(R, right, trans=int(transposed))[0]
    return solution


def least_norm_solution(A: FloatArray, b: FloatArray) -> FloatArray:
    """Least-norm solution x of A x = b with a positive semidefinite A, (k, k), as of ``numpy.linalg.lstsq``."""
    solve, *work = _solver(len(b))
    solution: FloatArray = solve(A, b, *work, RANK)[0]
    return solution


@cache
def _solver(k: int) -> tuple[Any, int, int]:
    """LAPACK's solver, and sizes of its work space."""
    lapack = _lapack()
    size, size_of_integers, _ = lapack.dgelsd_lwork(k, k, 1)
    return lapack.dgelsd, int(size), int(size_of_integers)


@cache
def _lapack() -> Any:
    from scipy.linalg import lapack  # a third of a second to import

    return lapack
