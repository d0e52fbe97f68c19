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


def triangular_solution(R: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Solution of R x = right, or of R^T x = right, with an upper triangular R; the least one where R is singular."""
    sizes = np.abs(R.diagonal())
    if sizes.min() <= EPSILON * sizes.max():
        return np.asarray(np.linalg.lstsq(R.T if transposed else R, right, rcond=None)[0])
    solution: FloatArray = _lapack().dtrtrs(R, right, trans=int(transposed))[0]
    return solution


def cholesky_factor(square: FloatArray, least: float) -> FloatArray | None:
    """Lower factor of a positive semidefinite matrix; None where a pivot is below a share of the largest element."""
    factor: FloatArray
    factor, failed = _lapack().dpotrf(square, lower=1, clean=1)
    return None if failed or not _is_regular(factor, square, least) else factor


def least_norm_forces(square: FloatArray, accelerations: FloatArray) -> FloatArray:
    """Forces of least norm that cancel accelerations, square times these, with a positive semidefinite matrix."""
    forces: FloatArray
    if len(square) == 1 and square[0, 0] > 0.0:
        forces = accelerations / -square[0, 0]
        return forces
    factor, forces, failed = _lapack().dposv(square, accelerations, lower=1)
    if failed or not _is_regular(factor, square, RANK):
        return least_norm_solution(square, -accelerations)
    return -forces


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


def _is_regular(factor: FloatArray, square: FloatArray, least: float) -> bool:
    """Whether all pivots of a matrix exceed a share of its largest diagonal element."""
    return bool(min(factor.diagonal().tolist()) ** 2 > least * max(square.diagonal().tolist()))


def range_basis(square: FloatArray) -> FloatArray | None:
    """Orthonormal basis of the range of a positive semidefinite matrix, (n, rank); None if its rank is n."""
    order, rank = _pivots(square) if len(square) else (np.zeros(0, dtype=np.int64), 0)
    if rank == len(square):
        return None
    basis: FloatArray
    lapack = _lapack()
    # The columns of the largest pivots span the range; Householder's method makes them orthonormal.
    reflectors, scales, _, _ = lapack.dgeqrf(square[:, order[:rank] - 1])
    basis, _, _ = lapack.dorgqr(reflectors, scales)
    return basis


def _pivots(square: FloatArray) -> tuple[IntArray, int]:
    """Pivots of the Cholesky factorisation, largest first and counted from 1, (n,), and the rank."""
    _, order, rank, _ = _lapack().dpstrf(square, tol=RANK * square.diagonal().max())
    return order, int(rank)


@cache
def _lapack() -> Any:
    from scipy.linalg import lapack  # a third of a second to import

    return lapack
