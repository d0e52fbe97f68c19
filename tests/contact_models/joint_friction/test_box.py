"""Accelerations under bounded forces: one solution, that of an enumeration of all modes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

from ffsm_mj.contact_models.joint_friction.decision import bounded_forces


def problem(rng):
    """A chain with dry friction, some joints of which are coupled: W, accelerations without friction, limits, 1 / masses."""
    n = int(rng.integers(2, 8))
    nv, couplings = n + int(rng.integers(0, 7)), int(rng.integers(0, min(4, n - 1) + 1))
    X = rng.normal(size=(nv, nv))
    L = np.linalg.cholesky(X @ X.T + 0.1 * np.eye(nv))
    A = np.eye(nv)[rng.permutation(nv)[:n]]
    B = np.array([A[i] - rng.uniform(-2, 2) * A[rng.integers(i + 1, n)] for i in range(couplings)]).reshape(-1, nv)
    plain, held = (np.linalg.solve(L, rows.T).T for rows in (A, B))
    V = np.linalg.svd(held, full_matrices=False)[2]
    W = plain - (plain @ V.T) @ V
    w = rng.normal(size=nv) * 3.0
    return W, W @ (w - V.T @ (V @ w)), rng.uniform(0.02, 3.0, size=n), np.sum(plain**2, axis=1)


def enumerated(W, b, limits):
    """Accelerations of the rows in all 3^n modes that satisfy Coulomb's law, each once."""
    n, tolerance, found = len(b), 1e-9 * (1.0 + np.abs(b).max()), []
    G = W @ W.T
    for stuck in itertools.product((False, True), repeat=n):
        still, moving = np.array(stuck), ~np.array(stuck)
        count = int(moving.sum())
        senses = np.zeros((2**count, n))
        senses[:, moving] = np.array(list(itertools.product((-1.0, 1.0), repeat=count))).reshape(2**count, count)
        a = b - (limits * senses) @ G
        x = -a[:, still] @ np.linalg.pinv(G[np.ix_(still, still)], rcond=1e-10, hermitian=True)
        a += x @ G[still]
        fits = np.all(np.abs(a[:, still]) <= tolerance, axis=1) & np.all(senses * a >= -tolerance, axis=1)
        for force, acceleration in zip(x[fits], a[fits], strict=True):
            if any(np.abs(acceleration - each).max() <= tolerance for each in found):
                continue
            if np.any(np.abs(force) > limits[still] + tolerance):
                # Of coupled joints the forces are not unique: some must be within the limits.
                bounds, effect = [(-f - tolerance, f + tolerance) for f in limits[still]], W[still].T
                if linprog(np.zeros(still.sum()), A_eq=effect, b_eq=effect @ force, bounds=bounds).status != 0:
                    continue
            found.append(acceleration)
    return found


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("first", range(0, 1000, 25))
def test_unique_accelerations(first):
    """Of 1000 random problems, most with couplings, some of which leave the forces undetermined.

    A force that the compliance took for one inside its limit may exceed it by as much.
    """
    for trial in range(first, first + 25):
        W, b, limits, masses = problem(np.random.default_rng((20261127, trial)))
        if trial % 3 == 0:
            limits *= 10.0
        found = bounded_forces(W, b, -limits, limits, masses)
        assert np.all(np.abs(found.forces) <= limits * (1.0 + 1e-6))
        others = enumerated(W, b, limits)
        assert others
        for a in others:
            assert np.abs(found.accelerations - a).max() <= 1e-8 * (1.0 + np.abs(b).max())
        # Coulomb's law itself.
        assert np.all(found.accelerations * found.moves >= 0.0)
        assert np.abs(found.accelerations[found.moves == 0.0]).max(initial=0.0) <= 1e-7 * (1.0 + np.abs(b).max())


def test_unilateral_rows(rng):
    """A limit that presses one of two joints: it pushes, or it opens."""
    for _ in range(200):
        W, b, limits, masses = problem(rng)
        low, high = -limits, limits.copy()
        low[0], high[0] = 0.0, np.inf
        found = bounded_forces(W, b, low, high, masses)
        assert found.forces[0] >= -1e-7 * (1.0 + np.abs(b).max())
        assert found.accelerations[0] >= -1e-7 * (1.0 + np.abs(b).max())
        assert found.forces[0] * found.accelerations[0] == pytest.approx(0.0, abs=1e-7 * (1.0 + np.abs(b).max()) ** 2)


def test_a_row_that_vanishes(rng):
    """Beside a row of 1e-9 to 1e-14, that of a cord at its longest, the decision on the others is that without it.

    Its own limit does 3 e along any of them, up to 1e-8.
    """
    for _ in range(200):
        W, b, limits, masses = problem(rng)
        plain = bounded_forces(W, b, -limits, limits, masses)
        tiny = rng.normal(size=W.shape[1]) * 10.0 ** -rng.uniform(9.0, 14.0)
        W, b, limits = np.vstack((W, tiny)), np.append(b, 3.0), np.append(limits, 0.5)
        found = bounded_forces(W, b, -limits, limits, np.append(masses, tiny @ tiny))
        assert np.array_equal(found.moves, np.append(plain.moves, 1.0))
        assert found.accelerations == pytest.approx(np.append(plain.accelerations, 3.0), abs=1e-7)
