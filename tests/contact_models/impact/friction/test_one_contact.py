"""One contact by Stronge and Routh: published cases, thousands of random contacts, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact_models.impact.friction.routh import stronge
from ffsm_mj.dynamics.rigid_body import tangents
from tests.contact_models.impact.friction.problems import (
    GENERAL,
    PENDULUM,
    SPHERE,
    energy,
    rod,
    rod_of,
    rows,
)

# The cases of the laws of friction with ten digits or exact: 1e-9.
CASES = {
    "sphere slips": (SPHERE, (-1, 0.72, 0.96), 0.2, 0.5, (0.5, 0.09, 0.12), -0.5775, "slip"),
    "sphere sticks": (SPHERE, (-1, 0.6, 0.8), 0.5, 0.7, (0.7, 0, 0), None, "slip, stick"),
    "rod 45": (rod(45), (-1, 1, 0), 0.3, 0.5, (0.4508414397, -0.0511208519, 0), -0.1943079790, "slip, reverse slip"),
    "rod 45 elastic": (rod(45), (-1, -0.3, 0), 0.7, 1.0, (1.0231324450, 0, 0), -0.126, "slip, stick"),
    "rod 45 sticks": (rod(45), (-1, -0.2, 0), 1.0, 0.5, (0.5513619501, 0, 0), -0.305, "slip, stick"),
    "rod 55": (rod(55), (-1, 0.7, 0), 0.3, 1.0, (0.8214594951, -0.3531069466, 0), -0.0687596295, "slip, reverse slip"),
    "pendulum": (
        PENDULUM,
        (-0.1342020143, -0.2671743428, 0),
        0.5,
        0.5,
        (0.0435295266, 0.0063068765, 0),
        -0.0103577329,
        "slip, reverse slip",
    ),
    "general": (GENERAL, (-1, 0.5, 0.4), 0.4, 0.8, (0.7586359746, 0.8491678017, -0.3589078695), -0.3998697368, "slip"),
    "without collision": (rod_of(0.2**0.5, 0.8**0.5), (-1e-12, -0.5, 0), 1.5, 0.0, (0, 0, 0), -0.05, "slip, stick"),
}


@pytest.mark.parametrize("name", CASES)
def test_cases_with_their_digits(name):
    """Among them u_n+ above e |u_n| (rod 45 elastic), and Painleve's impact without collision."""
    G, before, mu, e, after, change, path = CASES[name]
    A, w = rows(G, before)
    result = stronge(A, w, mu, e)
    np.testing.assert_allclose(A @ result.w, after, rtol=0, atol=1e-9)
    assert result.paths == (path,)
    assert result.status == "ok"
    if change is not None:
        assert energy(result.w) - energy(w) == pytest.approx(change, abs=1e-9)


def random_contact(rng):
    """Every third has rank 1 or 2, every seventh is planar; e is often 0 or 1."""
    n, kind = int(rng.integers(3, 8)), int(rng.integers(21))
    A = rng.normal(size=(3, n))
    if kind % 3 == 0:
        rank = int(rng.integers(1, 3))
        A = rng.normal(size=(3, rank)) @ rng.normal(size=(rank, n))
    if kind % 7 == 0:
        A[2] = 0.0
    w = rng.normal(size=n) * 10.0 ** rng.integers(-3, 4)
    return A, -w if A[0] @ w > 0 else w, float(rng.uniform(0, 1.5)), float(rng.choice([0.0, 1.0, rng.uniform()]))


def checked(A, w, mu, e):
    """A result after all conditions that it must satisfy, with tolerances relative to speeds and energy."""
    result = stronge(A, w, mu, e)
    T, speed = energy(w), np.abs(A @ w).max()
    change = energy(result.w) - T
    assert result.status in {"ok", "wedged"}
    assert change <= 1e-12 * T
    assert result.normal_work[0] <= 1e-12 * T
    assert result.friction_work[0] <= 0.0
    assert result.normal_work[0] + result.friction_work[0] == pytest.approx(change, abs=1e-9 * T)
    assert A[0] @ result.w >= -1e-9 * speed
    assert np.hypot(*result.impulses[0, 1:]) <= mu * result.impulses[0, 0]
    np.testing.assert_allclose(result.w, w + A.T @ result.impulses[0], rtol=0, atol=1e-14 * np.abs(w).max())
    if result.status == "wedged":
        assert np.abs(A @ result.w).max() <= 1e-9 * speed
    else:
        kept = (1.0 - e * e) * result.compression_work[0]
        assert result.normal_work[0] == pytest.approx(kept, abs=1e-12 * T)
    return result


@pytest.mark.long
@pytest.mark.parametrize("seed", range(30))
def test_random_contacts(seed):
    """3000 contacts: each ends, gains no energy, is in its cone, and returns e^2 of the work of compression."""
    rng = np.random.default_rng([19, seed])
    for _ in range(100):
        checked(*random_contact(rng))


def test_turned_tangents_give_the_same_velocity(rng):
    """Two other tangents with the same normal: the path is integrated to 1e-13 and compared to 1e-10."""
    for _ in range(30):
        A, w, mu, e = random_contact(rng)
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
        np.testing.assert_allclose(
            stronge(turn @ A, w, mu, e).w, stronge(A, w, mu, e).w, rtol=0, atol=1e-10 * np.abs(w).max()
        )


def test_little_friction_is_nearly_none(rng):
    """With mu = 1e-6 the velocity is that of reflection to 1e-4: the change is of the order of mu."""
    for _ in range(50):
        A, w, _, e = random_contact(rng)
        plain = w - (1 + e) * (A[0] @ w) / (A[0] @ A[0]) * A[0]
        size = np.linalg.norm(A[1:]) / np.linalg.norm(A[0]) * np.linalg.norm(w)
        np.testing.assert_allclose(stronge(A, w, 1e-6, e).w, plain, rtol=0, atol=1e-4 * size)


@pytest.mark.parametrize("G", [rod(55), GENERAL])
def test_no_friction_is_reflection(G):
    """With mu = 0 exactly, also where slip passes zero and grows again."""
    A, w = rows(G, (-1, 0.1, 0))
    plain = w + 1.8 / G[0, 0] * A[0]
    np.testing.assert_allclose(stronge(A, w, 0.0, 0.8).w, plain, rtol=0, atol=1e-12)


@pytest.mark.parametrize("approach", [1e-15, 1e-10, 1e-5])
def test_a_slow_bounce_with_fast_slip(approach):
    """Grazing: the works are as exact relative to the energy of the bounce as any, and slip loses mu times that."""
    for seed in range(15):
        rng = np.random.default_rng([11, seed])
        A = rng.normal(size=(3, 6))
        w = np.linalg.pinv(A) @ np.array([-approach, *rng.normal(size=2)])
        mu, e = 0.3 * rng.uniform(), rng.uniform(0.1, 1.0)
        result = stronge(A, w, mu, e)
        assert result.status == "ok"
        deepest = result.compression_work[0]
        assert deepest < 0.0
        assert result.normal_work[0] == pytest.approx((1 - e * e) * deepest, abs=1e-9 * abs(deepest))
        assert np.linalg.norm(result.impulses) < 1e3 * approach


def test_a_contact_that_separates_gets_no_impulse():
    A, w = rows(rod(45), (1.0, 0.5, 0.0))
    result = stronge(A, w, 0.5, 0.5)
    np.testing.assert_array_equal(result.impulses, np.zeros((1, 3)))
    np.testing.assert_array_equal(result.w, w)
    assert result.paths == ("",)


def test_a_contact_that_cannot_move_is_refused():
    with pytest.raises(ValueError, match="neither body can move"):
        stronge(np.zeros((3, 2)), np.ones(2), 0.5, 0.5)


def test_self_locking_is_wedged():
    """Sticking friction pulls the bodies together as fast as the normal impulse separates them: both come to rest."""
    A = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    result = stronge(A, np.array([-1.0, 0.3]), 1.0, 1.0)
    assert result.status == "wedged"
    np.testing.assert_allclose(A @ result.w, 0.0, atol=1e-12)
    assert result.w[1] == 0.3


def test_slip_and_normal_velocity_of_one_relative_motion_vanish_together(rng):
    """Closed form for rank one, u = a xi: rounding must not decide which of the two events there is.

    With c = mu |a_t| the speed changes by a_n + c per normal impulse until both velocities vanish, with the work
    -a_n xi^2 / (2 (a_n + c)). If c >= a_n the contact locks there; otherwise it slips back at a_n - c per impulse.
    """
    statuses = set()
    for _ in range(300):
        direction, a = rng.normal(size=7), rng.normal(size=3) * (1.0, *10.0 ** rng.uniform(-2, 1, 2))
        b = direction / np.linalg.norm(direction)
        a[0], xi = abs(a[0]), -(10.0 ** rng.uniform(-3, 0))
        mu, e = 10.0 ** rng.uniform(-2, 1), float(rng.choice((0.0, 0.24, 1.0)))
        w = xi * b
        # Rows less what latches hold have a rounding of some EPSILON of the rows before: here 1e-14.
        noise = 1e-14 * np.abs(a).max() * rng.normal(size=(3, 7))
        result, c = stronge(np.outer(a, b) + noise, w, mu, e), mu * np.hypot(*a[1:])
        stop = -0.5 * a[0] * xi**2 / (a[0] + c)
        locks = c >= a[0]
        end = 0.0 if locks else -e * xi * np.sqrt((a[0] - c) / (a[0] + c))
        # The noise is 1e-14 of the largest element, which may be 1e3 times that of a row: 1e-11, and 1e-9 for squares of
        # what is left of a difference. The solver itself is exact to 1e-9.
        np.testing.assert_allclose(result.w, end * b, rtol=0, atol=1e-8 * abs(xi))
        assert result.compression_work[0] == pytest.approx(stop, rel=1e-8)
        assert result.normal_work[0] == pytest.approx((1.0 - (0.0 if locks else e) ** 2) * stop, rel=1e-8, abs=1e-9 * xi**2)
        after = ", stick" if locks else "" if e == 0.0 else ", reverse slip"
        assert result.paths == (f"slip{after}",)
        assert result.status == ("wedged" if locks else "ok")
        statuses.add((*result.paths, result.status))
    assert len(statuses) == 3


def test_tangents_depend_on_the_normal_alone(rng):
    for _ in range(50):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        frame = np.vstack((n, tangents(n)))
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1.0, abs=1e-14)
    for n in ((0.6, 0.8, 0.0), (1.0, 0.0, 0.0)):  # in a plane the axis left out is one of them
        assert any(abs(abs(t[2]) - 1.0) < 1e-15 for t in tangents(np.array(n)))
