"""Several contacts at one instant: published cases, thousands of random problems, physical scenes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.optimize import linprog

from ffsm_mj.contact_models.impact.laws import FRICTIONLESS, least_norm, newton, project
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact import Contact, compare_laws, resolve


def chain(count, *, wall=False):
    """Contact rows of unit masses in a row, each in contact with the next; a wall behind the last."""
    A = np.zeros((count - 1 + wall, count))
    for i in range(count - 1):
        A[i, i], A[i, i + 1] = -1.0, 1.0
    if wall:
        A[-1, -1] = -1.0
    return A


def velocities(law, A, v, e):
    """Velocities after, with unit masses."""
    return FRICTIONLESS[law](A, np.array(v, dtype=float), np.full(len(A), float(e))).w


@pytest.mark.parametrize(
    ("law", "A", "v", "e", "expected"),
    [
        ("blend", chain(3), (1, 0, 0), 1.0, (0, 0, 1)),
        ("poisson", chain(3), (1, 0, 0), 1.0, (-1 / 3, 2 / 3, 2 / 3)),
        ("newton", chain(3), (1, 0, 0), 1.0, (-1 / 3, 2 / 3, 2 / 3)),
        ("blend", chain(3), (1, 0, 0), 0.5, (1 / 6, 1 / 6, 2 / 3)),
        ("poisson", chain(3), (1, 0, 0), 0.5, (0, 0.5, 0.5)),
        ("blend", chain(4), (1, 1, 0, 0), 1.0, (0, 0, 1, 1)),
        ("blend", chain(2, wall=True), (1, 0), 1.0, (-1, 0)),
        ("blend", chain(2, wall=True), (1, 0), 0.5, (-0.5, 0)),
        ("blend", chain(3), (1, 0, -1), 0.5, (-0.5, 0, 0.5)),
    ],
)
def test_balls_in_a_row(law, A, v, e, expected):
    """Newton's cradle, ball-ball-wall, squeeze: textbook numbers of each law."""
    np.testing.assert_allclose(velocities(law, A, v, e), expected, atol=1e-12)


@pytest.mark.parametrize("law", ["blend", "poisson"])
@pytest.mark.parametrize(("turn", "least"), [(0.1, 0.0), (0.05, 0.2)], ids=["one edge rests", "both land"])
def test_a_box_on_two_edges_of_different_restitution_turns_to_no_side(law, turn, least, rng):
    """Four corners share an impulse in many ways, but only one motion is symmetric: order and rounding decide nothing.

    Unit mass and moments of inertia; a corner of the lower face at (x, y) opens at v + wx y - wy x. So far from its centre
    of mass, a box that lands on one edge is pressed on the other one, which rests at wy = 0.1 rad/s.
    """
    A = np.array([[1.0, y, -x] for x in (-2.0, 2.0) for y in (-3.0, 3.0)])
    e = np.array([least, least, 0.5, 0.5])
    for _ in range(50):
        order = rng.permutation(4)
        after = FRICTIONLESS[law](A[order], np.array([-0.2, 0.0, turn]) + 1e-15 * rng.normal(size=3), e[order]).w
        assert after[1] == pytest.approx(0.0, abs=1e-13)
        assert (A @ after).min() >= -1e-13


def test_break_shot_is_symmetric():
    """One ball hits two in contact: (-1/5; 3/5, +-0.346), symmetric to rounding."""
    n = np.array([[np.cos(0.5 * np.pi / 3), s * np.sin(0.5 * np.pi / 3)] for s in (1, -1)])
    A = np.zeros((3, 6))
    A[0, :2], A[0, 2:4] = -n[0], n[0]
    A[1, :2], A[1, 4:6] = -n[1], n[1]
    A[2, 2:4], A[2, 4:6] = (0, 1), (0, -1)  # the two, touching each other
    after = velocities("blend", A, (1, 0, 0, 0, 0, 0), 1.0)
    np.testing.assert_allclose(after, (-0.2, 0, 0.6, 0.34641016, 0.6, -0.34641016), atol=1e-8)
    assert after[3] == pytest.approx(-after[5], abs=1e-14)


def flat_box(velocity, e=1.0, *, law="blend"):
    """A box of 1 kg, 1 m x 1 m x 0.4 m, on the four corners of its base."""
    M = np.diag([1.0, 1.0, 1.0, 1.16 / 12, 1.16 / 12, 2.0 / 12])
    corners = [np.array([x, y, -0.2]) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    J = np.array([np.concatenate(([0, 0, 1.0], np.cross(c, [0, 0, 1.0]))) for c in corners])
    root = np.sqrt(np.diag(M))
    result = FRICTIONLESS[law](J / root, root * np.array(velocity, dtype=float), np.full(4, e))
    return result.w / root, result


def test_flat_box_rebounds_without_spin():
    """Four redundant contacts (rank 3): vz = +1, no spin, the load shared evenly."""
    after, result = flat_box((0, 0, -1, 0, 0, 0))
    np.testing.assert_allclose(after, (0, 0, 1, 0, 0, 0), atol=1e-13)
    np.testing.assert_allclose(result.impulses, 0.5, atol=1e-9)


def test_rocking_box_keeps_its_energy_and_leaves():
    """With vz = -0.5, wy = 3 on four points every corner leaves and T is conserved; equal springs agree to four digits."""
    after, _ = flat_box((0, 0, -0.5, 0, 3, 0))
    assert after[2] == pytest.approx(1.0444, abs=5e-5)
    assert after[4] == pytest.approx(-0.5503, abs=5e-5)


def random_problem(rng):
    """2 to 5 contacts in 2 to 6 dofs; every third has dependent rows, every fifth squeezes without clearance."""
    n, m = int(rng.integers(2, 7)), int(rng.integers(2, 6))
    A = rng.normal(size=(m, n))
    if rng.integers(3) == 0:
        A[-1] = rng.uniform(0.2, 2.0) * A[0]
    if rng.integers(5) == 0:
        A[-1] = -rng.uniform(0.2, 2.0) * A[0]
    return A, rng.normal(size=n)


def checked(law, A, w, e):
    """Result of a law after the inequalities that all laws must satisfy; tolerances relative to the velocities."""
    result = FRICTIONLESS[law](A, w, e)
    T, after = 0.5 * w @ w, 0.5 * result.w @ result.w
    # Energy never grows. Where NNLS gives up, Hildreth's sweeps stop at 1e-9 of the approach speed.
    assert after <= T * (1 + 1e-12)
    assert (A @ result.w).min() >= -1e-8 * np.abs(A @ w).max()
    assert result.impulses.min() >= 0.0
    np.testing.assert_allclose(w + A.T @ result.impulses, result.w, atol=1e-12 * (1 + np.abs(w).max()))
    return result, T, after


@pytest.mark.parametrize("law", ["blend", "poisson"])
@pytest.mark.long
@pytest.mark.parametrize("hundred", range(20))
def test_random_problems_with_a_restitution_per_contact(law, hundred):
    rng = np.random.default_rng([20240601, hundred])
    for _ in range(100):
        A, w = random_problem(rng)
        checked(law, A, w, rng.uniform(0, 1, len(A)))


@pytest.mark.long
@pytest.mark.parametrize("hundred", range(20))
def test_random_elastic_problems_conserve_energy(hundred):
    """With e = 1: |dT| < 1e-10 T unless jammed; jammed only if a direction is squeezed from both sides."""
    rng = np.random.default_rng([20240601, hundred])
    jams = 0
    for _ in range(100):
        A, w = random_problem(rng)
        result, T, after = checked("blend", A, w, np.ones(len(A)))
        if result.jammed:
            jams += 1
        else:
            assert abs(after - T) < 1e-10 * T
    assert 0 < jams < 45  # 27 in a hundred on average: four standard deviations more


def test_newton_is_refused_where_it_is_inconsistent():
    A = chain(3)
    with pytest.raises(UnsupportedContactError, match="use 'poisson'"):
        newton(A, np.array([1.0, 0.0, 0.0]), np.array([0.5, 1.0]))
    with pytest.raises(UnsupportedContactError, match="use 'poisson'"):
        newton(A, np.array([1.0, 0.0, 1.0]), np.ones(2))


def test_sweeps_take_over_when_nnls_fails(monkeypatch, rng):
    """Once in thousands of problems NNLS misses its own optimality conditions: the verification must detect it."""
    import scipy.optimize

    problems = [random_problem(rng) for _ in range(30)]
    expected = [w + A.T @ project(A, w) for A, w in problems]
    monkeypatch.setattr(scipy.optimize, "nnls", lambda B, _: (np.ones(B.shape[1]), 0.0))
    for (A, w), good in zip(problems, expected, strict=True):
        np.testing.assert_allclose(w + A.T @ project(A, w), good, atol=1e-6)
    monkeypatch.setattr(scipy.optimize, "nnls", fail)
    A, w = problems[0]
    np.testing.assert_allclose(w + A.T @ project(A, w), expected[0], atol=1e-6)


@pytest.mark.parametrize("law", ["blend", "poisson", "newton"])
def test_without_nnls_redundant_contacts_get_the_same_velocities(monkeypatch, law):
    """Only the distribution over four corners is open then: impulses are >= 0, and their sum, 2 N s or less, is given.

    The sweeps end at a normal velocity of 1e-9 of the approach, 1 m/s.
    """
    expected, _ = flat_box((0, 0, -1, 0, 0, 0), law=law)
    import scipy.optimize

    monkeypatch.setattr(scipy.optimize, "nnls", fail)
    after, result = flat_box((0, 0, -1, 0, 0, 0), law=law)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-8)
    assert result.impulses.min() >= 0.0
    assert result.impulses.sum() == pytest.approx(2.0, abs=1e-8)


def fail(*_):
    raise RuntimeError("maximum number of iterations reached")


def balls(count):
    """Free balls of 1 kg in a row, in contact."""
    bodies = "".join(f'<body pos="{0.2 * i} 0 0"><freejoint/><geom size="0.1" mass="1"/></body>' for i in range(count))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><option gravity='0 0 0'/><worldbody>{bodies}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    x = np.array([1.0, 0, 0])
    contacts = [Contact(i + 1, i + 2, np.array([0.2 * i + 0.1, 0, 0]), x) for i in range(count - 1)]
    return model, data, contacts


def test_compare_laws_on_a_cradle():
    model, data, contacts = balls(3)
    data.qvel[0] = 1.0
    results = compare_laws(model, data, contacts)
    np.testing.assert_allclose(results["blend"].after.qvel[::6], (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(results["poisson"].after.qvel[::6], (-1 / 3, 2 / 3, 2 / 3), atol=1e-12)
    data.qvel[12] = 5.0
    assert "use 'poisson'" in compare_laws(model, data, contacts)["newton"]


def test_order_of_contacts_does_not_matter(rng):
    model, data, contacts = balls(4)
    data.qvel[:] = rng.normal(size=model.nv)
    there = resolve(model, data, contacts)
    back = resolve(model, data, contacts[::-1])
    np.testing.assert_allclose(there.after.qvel, back.after.qvel, atol=1e-12)


def test_no_other_impulses_of_the_same_effect_are_shorter(rng):
    """The shortest impulse has an angle of at most 90 degrees with any allowed change of it: verified by linear programs."""
    pulled_out = 0
    for _ in range(100):
        dofs = int(rng.integers(1, 5))
        A = rng.normal(size=(dofs + int(rng.integers(1, 5)), dofs)) * 10.0 ** rng.uniform(-2, 2)
        impulses = project(A, rng.normal(size=dofs))
        shortest, effect = least_norm(A, impulses), A.T @ impulses
        assert shortest.min() >= 0.0
        np.testing.assert_allclose(A.T @ shortest, effect, atol=1e-11 * np.abs(A).max() * max(1e-300, impulses.max()))
        least = linprog(shortest, A_eq=A.T, b_eq=effect)  # over all non-negative ones
        assert least.fun >= shortest @ shortest * (1.0 - 1e-6)  # its feasibility is 1e-7
        pulled_out += bool(impulses.any()) and shortest.min() == 0.0
    assert pulled_out > 10


def test_points_at_one_place_share_an_impulse():
    """Shares of the others are zero to rounding, of either sign: that is no reason to leave the impulse to one of two."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        places = rng.integers(-1, 2, (3, 2))
        A = np.column_stack((np.ones(4), np.vstack((places, places[-1:]))))
        impulses = project(A, -A[-1] * rng.uniform(0.5, 2.0))
        shared = least_norm(A, impulses)
        assert shared[2] == pytest.approx(shared[3], abs=1e-12)
        np.testing.assert_allclose(A.T @ shared, A.T @ impulses, rtol=0, atol=1e-12)
