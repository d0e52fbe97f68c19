"""The structured Riccati solver against 40 digits, against SciPy in the loop, and its guards."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from ffsm_controllers.osdre.riccati import BlockRiccati, RiccatiError, planar_riccati
from ffsm_controllers.osdre.riccati_planar import ACCEPTED_RESIDUAL, PlanarRiccati, _step, newton, principal_axes, turned
from scipy.linalg import solve_continuous_are

import ffsm_mj


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
    with mp.workdps(40):
        A, S, Q, K = (mp.matrix(np.asarray(M, dtype=float).tolist()) for M in (A, S, Q, start))
        for _ in range(6):
            closed, W = A - S * K, -(Q + K * S * K)
            operator = mp.zeros(16)
            for i in range(4):
                for j in range(4):
                    for k in range(4):
                        operator[4 * i + j, 4 * k + j] += closed[k, i]
                        operator[4 * i + j, 4 * i + k] += closed[k, j]
            x = mp.lu_solve(operator, mp.matrix([W[i, j] for i in range(4) for j in range(4)]))
            K = mp.matrix(4, 4)
            for i in range(4):
                for j in range(4):
                    K[i, j] = x[4 * i + j]
        return np.array([[float(K[i, j]) for j in range(4)] for i in range(4)])


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.1, 0.01])
def test_against_forty_digits(ratio, rng):
    """1e-12 relative down to sigma_min / sigma_max = 1e-2; S is squared there, 1e-16 / 1e-4 is what doubles allow."""
    for _ in range(8):
        A21, A22, B2, Q = problem(rng, ratio)
        A, B = wide(A21, A22, B2)
        start = solve_continuous_are(A, B, Q, np.eye(3))
        S = B2 @ B2.T
        K = exact(A, np.pad(S, ((2, 0), (2, 0))), Q, start)
        solver = planar_riccati(Q)
        solved(solver, A21, A22, S)
        P2, P3, residual, fallback = solved(solver, A21, A22, S)
        assert not fallback
        assert residual <= ACCEPTED_RESIDUAL
        error = max(np.abs(P2 - K[:2, 2:]).max(), np.abs(P3 - K[2:, 2:]).max())
        assert error <= 1e-12 * np.abs(K).max()


def refined(A21, A22, S, Q, blocks):
    """The solution near ``blocks`` in 40 digits, proved by the residual of the whole 4 x 4 equation, not by its steps."""
    with mp.workdps(40):
        A21, A22, S, *Q = (tuple(mp.mpf(x) for x in block) for block in (A21, A22, S, *Q))
        P2, P3 = (tuple(mp.mpf(x) for x in block) for block in blocks)
        for _ in range(2):
            P2, P3 = _step(A21, A22, S, Q, P2, P3)
        A = mp.matrix([[0, 0, 1, 0], [0, 0, 0, 1], [A21[0], A21[1], A22[0], A22[1]], [A21[2], A21[3], A22[2], A22[3]]])
        wide, Q1, Q12, Q3 = mp.diag([0, 0, *S]), *(mp.matrix([[b[0], b[1]], [b[2], b[3]]]) for b in Q)
        K, weight = mp.zeros(4), mp.zeros(4)
        K[:2, 2:], K[2:, 2:] = mp.matrix([[P2[0], P2[1]], [P2[2], P2[3]]]), mp.matrix([[P3[0], P3[1]], [P3[2], P3[3]]])
        K[2:, :2] = K[:2, 2:].T
        weight[:2, :2], weight[:2, 2:], weight[2:, :2], weight[2:, 2:] = Q1, Q12, Q12.T, Q3
        lower = (A.T * K + K * A + weight - K * wide * K)[:2, 2:]  # what P1 is missing from, and must make symmetric
        K[:2, :2] = -lower
        left = A.T * K + K * A + weight - K * wide * K
        assert mp.norm(left, mp.inf) <= mp.mpf(10) ** -30 * mp.norm(K, mp.inf)
        assert mp.norm(K - K.T, mp.inf) <= mp.mpf(10) ** -30 * mp.norm(K, mp.inf)
        return [[float(x) for x in block] for block in (P2, P3)]


def assert_exact(problem, Q, blocks):
    """1e-12 of the largest entry, against 40 digits."""
    true = refined(*problem, Q, blocks)
    assert np.abs(np.subtract(blocks, true)).max() <= 1e-12 * np.abs(true).max()


@pytest.mark.slow
def test_thousands_against_forty_digits(rng):
    """Warm solutions down to sigma_min / sigma_max = 1e-2."""
    for _ in range(2000):
        A21, A22, B2, Q = problem(rng, 10.0 ** rng.uniform(-2, 0))
        *given, axes = along(A21, A22, B2 @ B2.T)
        solver = planar_riccati(Q)
        solver.solve(*given, axes)
        blocks, residual, fallback = solver.solve(*given, axes)
        if not fallback:
            assert residual <= ACCEPTED_RESIDUAL
        assert_exact(given, [turned(flat(block), axes) for block in (Q[:2, :2], Q[:2, 2:], Q[2:, 2:])], blocks)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("scenario", ["baseline", "no-actuation", "free-flying", "slow-impact"])
@pytest.mark.usefixtures("plain")
def test_along_the_papers_runs(scenario, monkeypatch):
    """Residual at rounding at every tick, near-singular poses included; every 100th against 40 digits where sigma allows."""
    seen, solve = [], PlanarRiccati.solve

    def keep(self, A21, A22, S, axes):
        answer = solve(self, A21, A22, S, axes)
        seen.append(((A21, A22, S), self._weight, *answer))
        return answer

    monkeypatch.setattr(PlanarRiccati, "solve", keep)
    run = ffsm_mj.run(scenario)
    assert len(seen) > 7000
    assert max(residual for *_, residual, _ in seen) <= ACCEPTED_RESIDUAL
    assert 1 <= sum(fallback for *_, fallback in seen) <= 5
    reports = [report for phase in run.summary()["controller"]["phases"] if (report := phase["reports"])]
    assert sum(report["riccati_fallbacks"] for report in reports) == sum(fallback for *_, fallback in seen)
    assert max(report["worst_riccati_residual"] for report in reports) == max(residual for *_, residual, _ in seen)
    checked = 0
    for given, Q, blocks, *_ in seen[::100]:
        if given[2][1] >= 1e-4 * given[2][0]:  # S has the squares of sigma
            assert_exact(given, Q, blocks)
            checked += 1
    assert checked > 50


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


@pytest.mark.usefixtures("plain")
def test_fallback_is_counted_and_gives_the_same(rng):
    """After a jump the warm start is useless: the robust method answers, and the report says so."""
    A21, A22, B2, Q = problem(rng, 0.5)
    solver = planar_riccati(Q)
    S = B2 @ B2.T
    P2, P3, _, first = solved(solver, A21, A22, S)
    assert first  # a cold start needs it too
    assert not solved(solver, A21, A22, S)[3]
    solver._first = solver._second = solver._third = (flat(-50.0 * np.eye(2)), flat(-50.0 * np.eye(2)))
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


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_any_number_of_outputs(p, rng):
    """Along a smooth path of problems: residual at rounding, stable, SciPy's solution, and hardly a fallback."""
    ends = [rng.normal(size=(2, p, k)) for k in (p, p, p + 1)]
    Q, solver, fallbacks = np.diag(rng.uniform(0.3, 1.0, 2 * p)), None, 0
    solver = BlockRiccati(Q)
    for tick in range(200):
        angle = 0.002 * tick
        A21, A22, B2 = (np.cos(angle) * first + np.sin(angle) * second for first, second in ends)
        S = B2 @ B2.T
        K_lower, residual, fallback = solver.solve(A21, A22, S)
        fallbacks += fallback
        A = np.zeros((2 * p, 2 * p))
        A[:p, p:], A[p:, :p], A[p:, p:] = np.eye(p), A21, A22
        B = np.vstack((np.zeros_like(B2), B2))
        assert residual <= (1e-9 if fallback else ACCEPTED_RESIDUAL)
        assert np.linalg.eigvals(A - B @ B2.T @ K_lower).real.max() < 0.0
        if tick % 20 == 0:
            expected = solve_continuous_are(A, B, Q, np.eye(p + 1))[p:]
            np.testing.assert_allclose(K_lower, expected, atol=1e-9 * np.abs(expected).max() * np.linalg.cond(B2) ** 2)
    assert fallbacks <= 2


def test_three_outputs_answer_after_a_jump(rng):
    """A warm start from elsewhere is refused or led back: the answer is the stabilising one, and a refusal is counted."""
    Q, refused = np.eye(6), 0
    for _ in range(50):
        solver = BlockRiccati(Q)
        solver.solve(rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), np.eye(3))
        A21, A22, B2 = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
        solver._history = 3 * (-5.0 * np.hstack((np.eye(3), np.eye(3))),)
        K_lower, _, fallback = solver.solve(A21, A22, B2 @ B2.T)
        refused += fallback
        A = np.zeros((6, 6))
        A[:3, 3:], A[3:, :3], A[3:, 3:] = np.eye(3), A21, A22
        A[3:] -= B2 @ B2.T @ K_lower
        assert np.linalg.eigvals(A).real.max() < 0.0
    assert refused > 25


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("duration_s", [12, 30])
@pytest.mark.usefixtures("plain")
def test_baseline_with_scipy_in_the_loop(baseline, monkeypatch, duration_s):
    """The run with the oracle at every tick: the same impact, and the same tip on the way and at the end to 1e-6 m."""

    def by_scipy(_self, A21, A22, S, _axes):
        A, _ = wide(np.reshape(A21, (2, 2)), np.reshape(A22, (2, 2)), np.zeros((2, 3)))
        B = np.vstack((np.zeros((2, 2)), np.diag(np.sqrt(S))))
        K = solve_continuous_are(
            A, B, np.diag([1.0, 1.0, 0.5, 0.5]), np.eye(2)
        )  # the baseline's Q, which no rotation changes
        return (flat(K[:2, 2:]), flat(K[2:, 2:])), 0.0, False

    monkeypatch.setattr(PlanarRiccati, "solve", by_scipy)
    run = ffsm_mj.run("baseline", {"duration_s": float(duration_s)})
    assert run.impacts[0].time_s == pytest.approx(baseline.impacts[0].time_s, abs=1e-9)
    np.testing.assert_allclose(baseline.tip[: len(run.tip)], run.tip, rtol=0, atol=1e-6)
    approach, _, regulate = (phase["reports"] for phase in baseline.summary()["controller"]["phases"])
    for report in (approach, regulate):
        assert report["worst_riccati_residual"] <= 1e-13
        assert report["riccati_fallbacks"] >= 1  # the cold start, near-singular poses may add
