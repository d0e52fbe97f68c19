"""One contact with tangential compliance: a sphere in closed form, another integrator, energy, limits."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ffsm_mj.contact_models.impact.friction.compliant import compliant
from ffsm_mj.contact_models.impact.friction.laws import impact_with_compliance
from ffsm_mj.contact_models.impact.friction.routh import stronge
from tests.contact_models.impact.friction.problems import GENERAL, SPHERE, energy, rod, rows
from tests.contact_models.impact.friction.test_one_contact import random_contact

ALUMINA_ON_GLASS = 1 / 0.859
"""k_n / k_t."""
SPRING = {1.84: 0.877, 3.70: 0.837, 9.50: 0.663, 20.0: 0.593, 30.1: 0.683, 39.4: 0.776, 49.7: 0.844, 60.0: 0.894}
"""Tangential speed of the centre after over that before by angle of incidence in degrees; mu 0.092, e = 1."""


@pytest.mark.parametrize("degrees", SPRING)
def test_a_sphere_at_eight_angles(degrees):
    """Three digits; it sticks from the start below 5 degrees, and slips throughout above 30."""
    slip = tan(radians(degrees))
    A, w = rows(SPHERE, (-1, 0.6 * slip, 0.8 * slip))
    result = compliant(A, w, 0.092, 1.0, ALUMINA_ON_GLASS)
    after = (A @ result.w)[1:] @ (0.6, 0.8) / slip
    assert 1 - (1 - after) / 3.5 == pytest.approx(SPRING[degrees], abs=5e-4)
    assert result.paths[0] == (
        "stick, reverse slip" if degrees < 5 else "slip, stick, reverse slip" if degrees < 25 else "slip"
    )


@pytest.mark.parametrize("e", [0.3, 0.98, 1.0])
def test_a_sphere_that_slips_throughout(e):
    """Closed form to rounding: u_t' = u_t - 3.5 mu (1 + e) |u_n|, whatever the spring."""
    A, w = rows(SPHERE, (-1, 3.0, 4.0))
    result = compliant(A, w, 0.2, e, 1.2)
    np.testing.assert_allclose(A @ result.w, (e, *(np.array((0.6, 0.8)) * (5 - 0.7 * (1 + e)))), rtol=0, atol=1e-12)
    assert result.paths == ("slip",)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_sphere_whose_slider_holds(e):
    """With much friction it holds until it slips back at the end: u_t' = u_t cos(w t) up to there, then 3.5 mu p_n.

    With w^2 = 3.5 k_t / k_n the stretch is u_t sin(w t) / w. The force is sin t up to t = pi / 2, and then that of a
    time that runs 1 / e as fast.
    """
    rho, mu, slip = 1.3, 5.0, 0.4
    w = sqrt(3.5 / rho)
    A, before = rows(SPHERE, (-1, slip, 0))
    result = compliant(A, before, mu, e, rho)
    if e == 0.0:
        expected = slip * cos(w * pi / 2)
    else:
        force = lambda t: sin(pi / 2 + (t - pi / 2) / e)  # noqa: E731
        ends = pi / 2 * (1 + e)
        low, high = pi / 2, ends
        for _ in range(100):
            middle = 0.5 * (low + high)
            holds = abs(slip * sin(w * middle) / w) <= rho * mu * force(middle)
            low, high = (middle, high) if holds else (low, middle)
        left = e * (1 - cos((ends - low) / e))  # impulse from then on, the integral of the force
        expected = slip * cos(w * low) - 3.5 * np.sign(sin(w * low)) * mu * left
    np.testing.assert_allclose(A @ result.w, (e, expected, 0), rtol=0, atol=1e-11)


def stepped(G, u, mu, e, rho, steps):
    """Velocity after of m contacts at once, (m, 3), by steps in time that end with the stretch cut to its limit."""
    scale, n = G[:, 0, 0].copy(), len(u)
    G = G / scale[:, None, None]
    roots = np.stack([1 / e, rho**-0.5, rho**-0.5], axis=1)
    dt = 1 / (np.sqrt(np.linalg.eigvalsh(G * roots[:, :, None] * roots[:, None])[:, -1]) * steps)
    force, stretch, peak = np.zeros(n), np.zeros((n, 2)), np.zeros(n)
    ended, after = np.zeros(n, bool), u.copy()

    def pushed():
        forces = np.column_stack((np.maximum(force, 0.0), -stretch / rho[:, None]))
        return u + np.einsum("mij,mj->mi", G, forces) * (0.5 * dt)[:, None]

    for _ in range(400 * steps):
        u = pushed()
        grows = -u[:, 0] * dt
        elastic = force + grows / e**2
        # Beyond the peak it loads along the softer line.
        force = np.where(elastic > peak, peak + (grows - (peak - force) * e**2), elastic)
        peak = np.maximum(peak, force)
        stretch = stretch + u[:, 1:] * dt[:, None]
        length = np.maximum(np.hypot(*stretch.T), 1e-300)
        stretch *= np.minimum(1.0, rho * mu * np.maximum(force, 0.0) / length)[:, None]
        u = pushed()
        ends = (force <= 0.0) & ~ended
        after[ends] = u[ends]
        ended |= ends
        if ended.all():
            return after
    raise AssertionError("a contact did not end")


def test_another_integrator():
    """30 contacts in three dimensions by small steps in time: an error of first order, which two numbers of steps take out.

    The error at 50 steps per radian of the fastest mode is up to 2e-3; twice the result of 100 less that leaves 3e-5.
    """
    rng, found = np.random.default_rng(5), []
    while len(found) < 30:
        A, w, mu, e = random_contact(rng)
        if np.linalg.cond(A) < 10.0:
            found.append((A, w / np.abs(A @ w).max(), max(mu, 0.05), max(e, 0.3), 10.0 ** rng.uniform(-1, 1)))
    G, u = np.array([A @ A.T for A, *_ in found]), np.array([A @ w for A, w, *_ in found])
    numbers = [np.array([one[k] for one in found]) for k in (2, 3, 4)]
    ours = np.array([A @ compliant(A, w, *rest).w for A, w, *rest in found])
    coarse, fine = (stepped(G, u, *numbers, steps) for steps in (50, 100))
    np.testing.assert_allclose(coarse, ours, rtol=0, atol=4e-3)
    np.testing.assert_allclose(2 * fine - coarse, ours, rtol=0, atol=6e-5)


def checked(A, w, mu, e, rho):
    """A result after all conditions that it must satisfy, with tolerances relative to speeds and energy."""
    result = impact_with_compliance(A, w, mu, e, rho)
    T, speed = energy(w), np.abs(A @ w).max()
    change = energy(result.w) - T
    assert result.status in {"ok", "wedged"}
    assert change <= 1e-12 * T
    assert result.friction_work[0] <= 1e-12 * T
    assert result.normal_work[0] + result.friction_work[0] == pytest.approx(change, abs=1e-9 * T)
    assert A[0] @ result.w >= -1e-9 * speed
    assert np.hypot(*result.impulses[0, 1:]) <= mu * result.impulses[0, 0]
    if result.status == "ok":
        kept = (1.0 - e * e) * result.compression_work[0]
        assert result.normal_work[0] == pytest.approx(kept, abs=1e-11 * T)
    return result


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), ratio=st.floats(-4.0, 3.0))
def test_no_contact_gains_energy(seed, ratio):
    """Any rank of A, planar or not, any e, mu and stiffness: works, cone, and e as a ratio of works."""
    A, w, mu, e = random_contact(np.random.default_rng(seed))
    checked(A, w, max(mu, 1e-3), e, 10.0**ratio)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_random_contacts(seed):
    """1000 contacts; those that are not self-locking are solved with their springs."""
    rng, rigid = np.random.default_rng([56, seed]), 0
    for _ in range(100):
        A, w, mu, e = random_contact(rng)
        result = checked(A, w, max(mu, 1e-3), e, float(rng.uniform(1.0, 1.5)))
        rigid += result.law != "compliant" and result.status != "wedged"
    assert rigid <= 1


def test_turned_tangents_give_the_same_velocity(rng):
    """Two other tangents with the same normal; paths are integrated to 1e-13 in each of some hundred steps."""
    for _ in range(10):
        A, w, mu, e = random_contact(rng)
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
        one, other = (impact_with_compliance(B, w, mu, e, 1.2) for B in (A, turn @ A))
        np.testing.assert_allclose(other.w, one.w, rtol=0, atol=1e-9 * np.abs(w).max())


@pytest.mark.parametrize(("G", "u", "order"), [(GENERAL, (-1, 0.5, 0.4), 1.0), (rod(45), (-1, -0.3, 0), 0.5)])
def test_a_stiff_spring_is_the_rigid_law(G, u, order):
    """While it slips the spring lags by its compliance rho; where it sticks it swings, at a speed of order rho^1/2."""
    A, w = rows(G, u)
    rigid = A @ stronge(A, w, 0.7, 0.8).w
    missed = [np.abs(A @ compliant(A, w, 0.7, 0.8, rho).w - rigid).max() for rho in (1e-2, 1e-4, 1e-6)]
    for rho, miss in zip((1e-2, 1e-4, 1e-6), missed, strict=True):
        assert miss <= 3.0 * rho**order
    np.testing.assert_array_equal(impact_with_compliance(A, w, 0.7, 0.8, 0.0).w, stronge(A, w, 0.7, 0.8).w)


def test_little_restitution_is_none():
    """The velocity after is continuous in e at 0, where the impact ends with compression."""
    A, w = rows(GENERAL, (-1, 0.5, 0.4))
    plastic = compliant(A, w, 0.4, 0.0, 1.2)
    assert A[0] @ plastic.w == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(compliant(A, w, 0.4, 1e-7, 1.2).w, plastic.w, rtol=0, atol=3e-7)


@pytest.mark.parametrize("approach", [1e-15, 1e-10, 1e-5, 1e-2])
def test_a_slow_bounce_with_fast_slip(approach):
    """The direction of slip is stiff then: it lags behind u_t by the square of the ratio of speeds, and works stay exact."""
    for seed in range(3):
        rng = np.random.default_rng([11, seed])
        A = rng.normal(size=(3, 6))
        w = np.linalg.pinv(A) @ np.array([-approach, *rng.normal(size=2)])
        mu, e = 0.3 * rng.uniform(), rng.uniform(0.1, 1.0)
        result, rigid = compliant(A, w, mu, e, 1.3), stronge(A, w, mu, e)
        assert result.status == "ok"
        miss = np.abs(result.impulses - rigid.impulses).max() / approach
        assert miss <= 1.0 * approach**2 + 1e-9


def test_no_slip_is_no_friction():
    """A sphere that comes down straight bounces as without friction."""
    A, w = rows(SPHERE, (-1, 0, 0))
    result = compliant(A, w, 0.3, 0.6, 1.2)
    np.testing.assert_allclose(A @ result.w, (0.6, 0, 0), rtol=0, atol=1e-14)
    assert result.paths == ("stick",)
    assert result.friction_work[0] == 0.0


def test_events_that_coincide():
    """Bodies with a single relative motion: slip, slider and compression stop at one instant, which rounding divides."""
    direction = np.array([1.0, 0.9, -0.35])
    A = np.outer(direction, (1.0, 0.0, 0.0))
    w = np.array([-1.0, 0.0, 0.0])
    result = compliant(A, w, 0.4, 1.0, 1.2)
    assert result.status == "ok"
    assert result.paths[0].startswith("slip, stick, reverse slip")
    assert result.residual < 1e-12
