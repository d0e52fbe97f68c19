"""The structured Riccati solvers against 40 digits, against SciPy in the loop, and their guards."""

from __future__ import annotations

from itertools import product

import mpmath as mp
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

import ffsm_mj
from ffsm_controllers.osdre import riccati
from ffsm_controllers.osdre.riccati import planar_riccati, planar_robust, relative_residual
from ffsm_mj._core.riccati_doubling import Doubling, RiccatiError
from ffsm_mj._core.riccati_planar import ACCEPTED_RESIDUAL, PlanarRiccati, newton, principal_axes, turned
from tests import long_share


def flat(block):
    return tuple(np.ravel(block).tolist())


def problem(rng, ratio):
    """(A21, A22, B2, Q) with sigma_min(B2) / sigma_max(B2) = ratio; Q full or diagonal."""
    scale = rng.choice([0.1, 1.0, 3.0])
    A21, A22 = scale * rng.normal(size=(2, 2)), scale * rng.normal(size=(2, 2))
    left, _ = np.linalg.qr(rng.normal(size=(2, 2)))
    right, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    B2 = left @ np.hstack((np.diag([1.0, ratio]), np.zeros((2, 1)))) @ right
    root = rng.normal(size=(4, 4))
    Q = root @ root.T + 0.1 * np.eye(4) if rng.integers(2) else np.diag([1.0, 1.0, 0.5, 0.5])
    return A21, A22, B2, Q


def along(A21, A22, S):
    """A problem as the solver takes it: along the principal axes of S."""
    values, axes = principal_axes(S[0, 0], S[0, 1], S[1, 1])
    return turned(flat(A21), axes), turned(flat(A22), axes), values, axes


def solved(solver, A21, A22, S):
    """P2 and P3 on the outputs' own axes, residual, fallback."""
    problem = along(A21, A22, S)
    blocks, residual, fallback = solver.solve(*problem)
    back = (problem[-1][0], -problem[-1][1])
    return *(np.reshape(turned(block, back), (2, 2)) for block in blocks), residual, fallback


def wide(A21, A22, B2):
    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, :2], A[2:, 2:] = np.eye(2), A21, A22
    return A, np.vstack((np.zeros((2, 3)), B2))


def exact(A, S, Q, start):
    """Newton-Kleinman in 40 digits from a start that is good to a few."""
    n = len(A)
    with mp.workdps(40):
        A, S, Q, K = (mp.matrix(np.asarray(M, dtype=float).tolist()) for M in (A, S, Q, start))
        for _ in range(3):
            closed, W = A - S * K, -(Q + K * S * K)
            operator = mp.zeros(n * n)
            for i, j, k in product(range(n), repeat=3):
                operator[n * i + j, n * k + j] += closed[k, i]
                operator[n * i + j, n * i + k] += closed[k, j]
            x = mp.lu_solve(operator, mp.matrix([W[i, j] for i, j in product(range(n), repeat=2)]))
            K = mp.matrix(n, n)
            for i, j in product(range(n), repeat=2):
                K[i, j] = x[n * i + j]
        return np.array([[float(K[i, j]) for j in range(n)] for i in range(n)])


def assert_exact(problem, Q, blocks):
    """1e-12 of the largest entry, against 40 digits."""
    A21, A22, S = problem
    A, wide_S, weight = np.zeros((4, 4)), np.diag((0.0, 0.0, *S)), np.zeros((4, 4))
    A[:2, 2:], A[2:, :2], A[2:, 2:] = np.eye(2), np.reshape(A21, (2, 2)), np.reshape(A22, (2, 2))
    (weight[:2, :2], weight[:2, 2:], weight[2:, 2:]), P2, P3 = (
        [np.reshape(block, (2, 2)) for block in Q],
        *(np.reshape(block, (2, 2)) for block in blocks),
    )
    weight[2:, :2] = weight[:2, 2:].T
    start = np.block([[np.zeros((2, 2)), P2], [P2.T, P3]])
    start[:2, :2] = -(A.T @ start + start @ A + weight - start @ wide_S @ start)[:2, 2:]  # what P1 is missing from
    true = exact(A, wide_S, weight, start)
    error = max(np.abs(P2 - true[:2, 2:]).max(), np.abs(P3 - true[2:, 2:]).max())
    assert error <= 1e-12 * max(np.abs(true[:2, 2:]).max(), np.abs(true[2:, 2:]).max())


@pytest.mark.long(one_of=100)
@pytest.mark.parametrize("score", range(100))
def test_thousands_against_forty_digits(score):
    """1e-12 relative of warm solutions, down to sigma_min / sigma_max = 1e-2: S is squared there, 1e-16 / 1e-4 is left."""
    rng = np.random.default_rng([20240601, score])
    for _ in range(20):
        A21, A22, B2, Q = problem(rng, 10.0 ** rng.uniform(-2, 0))
        *given, axes = along(A21, A22, B2 @ B2.T)
        solver = planar_riccati(Q)
        solver.solve(*given, axes)
        blocks, residual, fallback = solver.solve(*given, axes)
        if not fallback:
            assert residual <= ACCEPTED_RESIDUAL
        assert_exact(given, [turned(flat(block), axes) for block in (Q[:2, :2], Q[:2, 2:], Q[2:, 2:])], blocks)


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["baseline", "no-actuation", "free-flying", "slow-impact"])
def test_along_the_papers_runs(scenario, monkeypatch):
    """Residual at rounding at every tick, near-singular poses included; some against 40 digits where sigma allows."""
    seen = []

    class Kept(PlanarRiccati):
        def __init__(self, Q, robust):
            super().__init__(Q, robust)
            self.weight = Q

        def solve(self, A21, A22, S, axes):
            answer = super().solve(A21, A22, S, axes)
            seen.append(((A21, A22, S), self.weight, *answer))
            return answer

    monkeypatch.setattr(riccati, "PlanarRiccati", Kept)
    run = ffsm_mj.run(scenario)
    assert len(seen) > 7000
    assert max(residual for *_, residual, _ in seen) <= ACCEPTED_RESIDUAL
    assert 1 <= sum(fallback for *_, fallback in seen) <= 5
    reports = [report for phase in run.summary()["controller"]["phases"] if (report := phase["reports"])]
    assert sum(report["riccati_fallbacks"] for report in reports) == sum(fallback for *_, fallback in seen)
    assert max(report["worst_riccati_residual"] for report in reports) == max(residual for *_, residual, _ in seen)
    checked = 0
    for given, Q, blocks, *_ in seen[:: 100 if long_share.every_case else 500]:
        if given[2][1] >= 1e-4 * given[2][0]:  # S has the squares of sigma
            assert_exact(given, Q, blocks)
            checked += 1
    assert checked > 10


def test_every_accepted_solution_is_stabilising_and_exact(rng):
    """Thousands of warm starts, near-singular ones too: residual at rounding and stable, or a counted fallback."""
    fallbacks = 0
    for _ in range(1500):
        A21, A22, B2, Q = problem(rng, 10.0 ** rng.uniform(-4, 0))
        solver = planar_riccati(Q)
        solved(solver, A21, A22, B2 @ B2.T)
        A21 = A21 + 1e-3 * rng.normal(size=(2, 2))  # a tick later
        B2 = B2 + 1e-3 * rng.normal(size=(2, 3))
        S = B2 @ B2.T
        P2, P3, residual, fallback = solved(solver, A21, A22, S)
        fallbacks += fallback
        if not fallback:
            assert residual <= ACCEPTED_RESIDUAL
        A, _ = wide(A21, A22, B2)
        lower = S @ np.hstack((P2.T, P3))
        A[2:] -= lower
        assert np.linalg.eigvals(A).real.max() < 0.0
    assert fallbacks < 75


def test_a_start_that_leads_elsewhere_is_refused(rng):
    """Newton from a destabilising start finds another solution, or none: the stability test must say no."""
    refused = 0
    for _ in range(200):
        A21, A22, B2, Q = problem(rng, 0.3)
        values, axes = principal_axes(*(B2 @ B2.T).ravel()[[0, 1, 3]])
        weight = tuple(turned(flat(block), axes) for block in (Q[:2, :2], Q[:2, 2:], Q[2:, 2:]))
        start = (flat(-5.0 * np.eye(2)), flat(-5.0 * np.eye(2)))
        (_, P3), residual = newton(turned(flat(A21), axes), turned(flat(A22), axes), values, weight, start)
        if residual == np.inf:
            refused += 1
            continue
        A, B = wide(A21, A22, B2)
        expected = solve_continuous_are(A, B, Q, np.eye(3))
        P3 = np.reshape(turned(P3, (axes[0], -axes[1])), (2, 2))
        np.testing.assert_allclose(P3, expected[2:, 2:], rtol=1e-7)
    assert refused > 100


def test_fallback_is_counted_and_gives_the_same(rng):
    """After a jump the warm start is useless: the robust method answers, and the report says so."""
    A21, A22, B2, Q = problem(rng, 0.5)
    solver = planar_riccati(Q)
    S = B2 @ B2.T
    P2, P3, _, first = solved(solver, A21, A22, S)
    assert first  # a cold start needs it too
    assert not solved(solver, A21, A22, S)[3]
    solver.set_state({"solutions": np.tile(-50.0 * np.eye(2).ravel(), (3, 2, 1)), "warm": True})
    again = solved(solver, A21, A22, S)
    assert again[3]
    np.testing.assert_allclose(again[0], P2, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(again[1], P3, rtol=1e-10, atol=1e-12)


def test_no_solution_is_an_error():
    solver = planar_riccati(np.diag([1.0, 1.0, 0.5, 0.5]))
    with pytest.raises(RiccatiError):
        solved(solver, np.eye(2), np.eye(2), np.zeros((2, 2)))


def test_principal_axes(rng):
    for _ in range(50):
        root = rng.normal(size=(2, 2))
        S = root @ root.T
        values, axes = principal_axes(S[0, 0], S[0, 1], S[1, 1])
        np.testing.assert_allclose(np.reshape(turned(flat(S), axes), (2, 2)), np.diag(values), atol=1e-14)
        np.testing.assert_allclose(values[::-1], np.linalg.eigvalsh(S), atol=1e-14)
        M = flat(rng.normal(size=(2, 2)))
        np.testing.assert_allclose(turned(turned(M, axes), (axes[0], -axes[1])), M, atol=1e-15)


def stack(A21, A22, B2):
    """A, B and B B^T of any number of outputs."""
    p, n = len(A21), B2.shape[1]
    A = np.zeros((2 * p, 2 * p))
    A[:p, p:], A[p:, :p], A[p:, p:] = np.eye(p), A21, A22
    B = np.vstack((np.zeros((p, n)), B2))
    return A, B, B @ B.T


def many_outputs(rng, p, ratio):
    """(A21, A22, B2, Q) with sigma_min(B2) / sigma_max(B2) = ratio; every third A22 is that of a moving tip, d ydot^+."""
    scale = 10.0 ** rng.uniform(-2, 2)
    A21, A22 = scale * rng.normal(size=(2, p, p))
    if rng.integers(3) == 0:
        A21, A22 = np.zeros((p, p)), scale * np.outer(*rng.normal(size=(2, p)))
    left, _ = np.linalg.qr(rng.normal(size=(p, p)))
    right, _ = np.linalg.qr(rng.normal(size=(p + 1, p + 1)))
    B2 = left * np.geomspace(1.0, ratio, p) @ right[:p]
    root = rng.normal(size=(2 * p, 2 * p))
    Q = root @ root.T + 0.1 * np.eye(2 * p) if rng.integers(2) else np.diag(10.0 ** rng.uniform(-1, 1, 2 * p))
    return A21, A22, B2, Q


@pytest.mark.long
@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_any_number_of_outputs(p, rng):
    """Residual at rounding, stable, SciPy's solution; no equation remembers the one before."""
    for _ in range(200):
        A21, A22, B2, Q = many_outputs(rng, p, 10.0 ** rng.uniform(-1, 0))
        A, B, S = stack(A21, A22, B2)
        solver = Doubling(Q)
        K_lower, residual = solver.solve(A21, A22, B2 @ B2.T)
        assert residual <= ACCEPTED_RESIDUAL
        assert np.linalg.eigvals(A - S @ K_lower_padded(K_lower)).real.max() < 0.0
        expected = solve_continuous_are(A, B, Q, np.eye(p + 1))[p:]
        # Both lose the condition of the equation; A has up to 1e2 here, S the squares of sigma.
        np.testing.assert_allclose(K_lower, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())
        assert solver.solve(np.eye(p), np.eye(p), np.eye(p))[1] <= ACCEPTED_RESIDUAL
        np.testing.assert_array_equal(solver.solve(A21, A22, B2 @ B2.T)[0], K_lower)


def K_lower_padded(K_lower):
    """K with zeros above: S does not see them."""
    return np.vstack((np.zeros_like(K_lower), K_lower))


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("p", [1, 3])
def test_doubling_against_forty_digits(p, rng):
    """1e-12 relative down to sigma_min / sigma_max = 0.1, as for two outputs."""
    for _ in range(3):
        A21, A22, B2, Q = many_outputs(rng, p, 0.1)
        A, B, S = stack(A21 / max(1.0, np.abs(A21).max()), A22 / max(1.0, np.abs(A22).max()), B2)
        K_lower, _ = Doubling(Q).solve(A[p:, :p], A[p:, p:], B2 @ B2.T)
        K = exact(A, S, Q, solve_continuous_are(A, B, Q, np.eye(p + 1)))
        assert np.abs(K_lower - K[p:]).max() <= 1e-12 * np.abs(K).max()


def test_doubling_near_singular_poses(rng):
    """Down to sigma_min / sigma_max = 1e-6: what is accepted stabilises, and hardly one in fifty is given up.

    SciPy's Schur method gives up, or does not stabilise, more often on the same equations.
    """
    lost = lost_by_scipy = 0
    for _ in range(400):
        p = int(rng.integers(1, 5))
        A21, A22, B2, Q = many_outputs(rng, p, 10.0 ** rng.uniform(-6, 0))
        A, B, S = stack(A21, A22, B2)
        try:
            K_lower, _ = Doubling(Q).solve(A21, A22, B2 @ B2.T)
            assert np.linalg.eigvals(A - S @ K_lower_padded(K_lower)).real.max() < 0.0
        except RiccatiError:
            lost += 1
        try:
            K = solve_continuous_are(A, B, Q, np.eye(p + 1))
            lost_by_scipy += np.linalg.eigvals(A - S @ K).real.max() >= 0.0 or relative_residual(A, S, Q, K) > 1e-9
        except np.linalg.LinAlgError:
            lost_by_scipy += 1
    assert lost <= 8
    assert lost < lost_by_scipy


@pytest.mark.parametrize("size", [1e2, 1e4, 1e6, 1e8])
def test_a_tip_almost_at_rest(rng, size):
    """A22 = d ydot^+ of any size: solved to 1e-9 up to 1e6, where K spans twelve decades; then refused, not wrong."""
    refused = 0
    for _ in range(50):
        A21, A22, B2 = np.zeros((3, 3)), size * np.outer(*rng.normal(size=(2, 3))), rng.normal(size=(3, 4))
        A, _, S = stack(A21, A22, B2)
        try:
            with np.errstate(all="ignore"):
                K_lower, residual = Doubling(np.diag([20.0] * 3 + [60.0] * 3)).solve(A21, A22, B2 @ B2.T)
            assert residual <= (1e-9 if size <= 1e6 else 1e-6)
            assert np.linalg.eigvals(A - S @ K_lower_padded(K_lower)).real.max() < 0.0
        except RiccatiError:
            refused += 1
    assert refused == 0 or size > 1e6


def test_what_rounding_leaves_is_corrected(rng):
    """Newton steps afterwards: a few equations need them, and all but some of these then count as exact."""
    needed, solver = [], None
    for _ in range(400):
        A21, A22, B2, Q = many_outputs(rng, 3, 10.0 ** rng.uniform(-2, -1))
        solver = Doubling(Q)
        _, residual = solver.solve(A21, A22, B2 @ B2.T)
        if solver.corrections:
            needed.append(residual)
        else:
            assert residual <= ACCEPTED_RESIDUAL
    assert len(needed) >= 10
    assert sum(residual > ACCEPTED_RESIDUAL for residual in needed) <= len(needed) // 4


def test_a_shift_that_is_an_eigenvalue_is_changed():
    """One output, A with the eigenvalue 2^(1/8), which is the shift that S = 1 and Q = 1 give."""
    S, Q, shift = np.eye(1), np.eye(2), 2.0**0.125
    solver = Doubling(Q)
    K_lower, residual = solver.solve(np.zeros((1, 1)), np.array([[shift]]), S)
    assert residual <= ACCEPTED_RESIDUAL
    A, B, _ = stack(np.zeros((1, 1)), np.array([[shift]]), S)
    np.testing.assert_allclose(K_lower, solve_continuous_are(A, B, Q, S)[1:], rtol=1e-12)


@pytest.mark.parametrize("p", [1, 3])
def test_no_solution_of_any_number_of_outputs_is_an_error(p):
    """Nothing to push with, an output that nothing weighs, numbers that are none."""
    one, none = np.eye(p), np.zeros((p, p))
    for Q, A21, A22, S in (
        (np.eye(2 * p), one, one, none),
        (np.zeros((2 * p, 2 * p)), none, none, one),
        (np.eye(2 * p), np.nan * one, one, one),
    ):
        with pytest.raises(RiccatiError):
            Doubling(Q).solve(A21, A22, S)


def test_doubling_takes_over_where_eigenvectors_are_useless(monkeypatch):
    """A defective Hamiltonian (repeated roots) leaves no basis of eigenvectors: two double integrators, K known."""
    monkeypatch.setattr(riccati, "from_eigenvectors", lambda *_: None)
    zero, one = (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0)
    (P2, P3), residual = planar_robust(zero, zero, (1.0, 1.0), (one, zero, (2.0, 0.0, 0.0, 2.0)))
    assert residual <= ACCEPTED_RESIDUAL
    np.testing.assert_allclose(P2, one, atol=1e-14)
    np.testing.assert_allclose(P3, (2.0, 0.0, 0.0, 2.0), atol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize(("duration_s", "ticks", "corrected"), [(12, 400, 0), (60, 7000, 1)])
def test_along_a_run_in_space(duration_s, ticks, corrected):
    """Every tick of `spatial` at rounding, a tip at rest too, where A22 turns by more than itself."""
    run = ffsm_mj.run("spatial", {"duration_s": float(duration_s)})
    kinds = ("residual", "doublings", "corrections")
    columns = np.column_stack([run[f"controller.osdre_riccati_{kind}"] for kind in kinds])
    seen = columns[np.isfinite(columns).all(axis=1)]
    residual, doublings, corrections = seen.T
    assert len(seen) > ticks
    assert residual.max() <= ACCEPTED_RESIDUAL
    assert doublings.max() <= 2.5 * np.median(doublings)
    assert corrected <= np.count_nonzero(corrections) < 0.05 * len(seen)  # the last part of the run needs some
    reports = [report for phase in run.summary()["controller"]["phases"] if (report := phase["reports"])]
    assert max(report["worst_riccati_residual"] for report in reports) == residual.max()
    assert max(report["most_riccati_doublings"] for report in reports) == doublings.max()
    assert sum(report["riccati_corrections"] for report in reports) == corrections.sum()


@pytest.mark.long
@pytest.mark.parametrize("duration_s", [2, 8, 12, 30])
def test_baseline_with_scipy_in_the_loop(baseline, monkeypatch, duration_s):
    """The run with the oracle at every tick: the same impact, and the same tip on the way and at the end to 1e-6 m."""

    class ByScipy(PlanarRiccati):
        def solve(self, A21, A22, S, axes):
            A, _ = wide(np.reshape(A21, (2, 2)), np.reshape(A22, (2, 2)), np.zeros((2, 3)))
            B = np.vstack((np.zeros((2, 2)), np.diag(np.sqrt(S))))
            K = solve_continuous_are(
                A, B, np.diag([1.0, 1.0, 0.5, 0.5]), np.eye(2)
            )  # the baseline's Q, which no rotation changes
            return (flat(K[:2, 2:]), flat(K[2:, 2:])), 0.0, False

    monkeypatch.setattr(riccati, "PlanarRiccati", ByScipy)
    run = ffsm_mj.run("baseline", {"duration_s": float(duration_s)})
    hits = [impact.time_s for impact in baseline.impacts if impact.time_s < duration_s]
    assert [impact.time_s for impact in run.impacts] == pytest.approx(hits, abs=1e-9)
    np.testing.assert_allclose(baseline.tip[: len(run.tip)], run.tip, rtol=0, atol=1e-6)
    approach, _, regulate = (phase["reports"] for phase in baseline.summary()["controller"]["phases"])
    for report in (approach, regulate):
        assert report["worst_riccati_residual"] <= 1e-13
        assert report["riccati_fallbacks"] >= 1  # the cold start, near-singular poses may add
