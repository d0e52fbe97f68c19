"""Pinocchio's cone solver as an oracle of the modes of contacts that do not slip yet, and of their accelerations."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact_models.persistent.friction.choice import ModeChoice, PointStates
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, UNKNOWN
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from tests.contact_models.impact.friction.problems import problem
from tests.contact_models.impact.friction.test_oracles import pinocchio_impulses

pytest.importorskip("pinocchio")


def chosen(G, b, mu):
    """The solution in the modes chosen for points without slip."""
    k = len(mu)
    still = np.zeros(k, dtype=bool)
    rounding = np.full(k, 1e-12)
    states = PointStates(np.zeros((k, 2)), still, np.full(k, UNKNOWN), np.zeros((k, 2)), rounding, released=False)
    return ModeChoice(FrictionProblem(G, b, mu), states).choose()


def test_accelerations_of_contacts_at_rest_are_pinocchios():
    """Independent rows, where the forces are unique: accelerations to 1e-8; the solver stops at 1e-11 of its own units.

    The problem at the accelerations is that of a plastic impact: stick, slip or lift off of 2 to 6 points.
    """
    compared, modes = 0, set()
    for seed in range(40):
        A, w, mu, _ = problem(np.random.default_rng([11, seed]), 0)
        G, b = A @ A.T, A @ w
        ours, theirs = chosen(G, b, mu), pinocchio_impulses("ADMM", G, b, mu)
        if theirs is None:
            continue
        reached = (b + G @ theirs.ravel()).reshape(-1, 3)
        np.testing.assert_allclose(ours.accelerations, reached, rtol=0, atol=1e-8 * np.abs(b).max())
        np.testing.assert_allclose(ours.forces, theirs, rtol=0, atol=1e-7 * np.abs(theirs).max(initial=1.0))
        modes |= set(ours.kinds.tolist())
        compared += 1
    assert compared >= 25
    assert modes == {CLOSED, SLIDE, STICK}
