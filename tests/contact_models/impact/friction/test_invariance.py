"""Invariance of an impact under rotation, the choice of tangents, the order of contacts and the units."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact_models.impact.friction import impact_with_friction
from tests.contact_models.impact.friction.contacts import energy
from tests.contact_models.impact.friction.problems import problem

LAWS = ["blend", "poisson"]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("family", [0, 2])
def test_a_turned_scene_with_its_tangents_has_turned_velocities(law, family):
    """A rotation leaves A A^T and A w unchanged: the difference is rounding, 1e-10 of the velocities."""
    for seed in range(15):
        rng = np.random.default_rng([5, seed])
        A, w, mu, e = problem(rng, family)
        turn = np.linalg.qr(rng.normal(size=(len(w), len(w))))[0]
        there, turned = impact_with_friction(A, w, mu, e, law), impact_with_friction(A @ turn.T, turn @ w, mu, e, law)
        np.testing.assert_allclose(turned.w, turn @ there.w, rtol=0, atol=1e-10 * np.abs(w).max())


@pytest.mark.parametrize("law", LAWS)
def test_order_and_tangents_do_not_matter_at_full_rank(law):
    """Redundant contacts may have several solutions; at full rank there is one, found to 1e-9 of the speeds."""
    for seed in range(25):
        rng = np.random.default_rng([6, seed])
        A, w, mu, e = problem(rng, 0)
        order = rng.permutation(len(mu))
        other = []
        for i in order:
            c, s = np.cos(angle := rng.uniform(0, 2 * np.pi)), np.sin(angle)
            other.append(np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) @ A[3 * i : 3 * i + 3])
        here = impact_with_friction(A, w, mu, e, law)
        there = impact_with_friction(np.concatenate(other), w, mu[order], e[order], law)
        np.testing.assert_allclose(there.w, here.w, rtol=0, atol=1e-7 * np.abs(w).max())


@pytest.mark.parametrize("law", LAWS)
def test_the_same_arguments_give_the_same_bits(law):
    for seed in range(6):
        A, w, mu, e = problem(np.random.default_rng([8, seed]), seed % 3)
        here, again = impact_with_friction(A, w, mu, e, law), impact_with_friction(A.copy(), w.copy(), mu, e, law)
        np.testing.assert_array_equal(here.w, again.w)
        np.testing.assert_array_equal(here.impulses, again.impulses)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_units_do_not_matter(law, factor):
    """Ten times the speed gives ten times the impulse: nothing in the solver has units."""
    for seed in range(10):
        A, w, mu, e = problem(np.random.default_rng([9, seed]), 0)
        here, there = impact_with_friction(A, w, mu, e, law), impact_with_friction(A * 30.0, w * factor, mu, e, law)
        np.testing.assert_allclose(there.w / factor, here.w, rtol=0, atol=1e-7 * np.abs(w).max())
        assert energy(there.w) <= energy(w) * factor**2 * (1 + 1e-12)


@pytest.mark.parametrize("seed", [4, 7])
def test_an_approach_near_rounding_is_judged_alike_in_all_tangents(seed):
    """A contact that drifts at 0.9e-10 of its slip takes part in the first elastic pass in all axes or in none."""
    A = np.random.default_rng(seed).normal(size=(6, 6))
    w = np.linalg.solve(A, [-0.9e-10, 1.0, 0.0, -0.1, 0.0, 0.2])
    c = np.sqrt(0.5)
    turned = np.kron(np.eye(2), [[1, 0, 0], [0, c, c], [0, -c, c]]) @ A
    here, there = (
        impact_with_friction(rows, w, np.array([0.3, 0.5]), np.array([0.0, 0.7]), "blend") for rows in (A, turned)
    )
    np.testing.assert_allclose(there.w, here.w, rtol=0, atol=1e-10 * np.abs(w).max())


def test_contacts_that_rest_on_fast_bodies_converge():
    """They approach at 3e-11 m/s; velocities of 1 m/s are known to 1e-16, more than 1e-9 of that."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        A = rng.normal(size=(6, 12))
        free = rng.normal(size=12)
        w = free - np.linalg.pinv(A) @ (A @ free - [-3e-11, 2e-12, 7e-12, -6e-12, 7e-12, -5e-12])
        assert impact_with_friction(A, w, np.array([0.8, 0.2]), np.zeros(2), "blend").status == "ok"
