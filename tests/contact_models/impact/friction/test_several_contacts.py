"""Several contacts with Coulomb friction: published cases, thousands of random problems, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact_models.impact.friction import laws, result, routh
from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.contact_models.impact.friction.laws import impact_with_friction
from ffsm_mj.contact_models.impact.friction.routh import stronge
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.tolerances import SOLVED
from tests.contact_models.impact.friction.problems import SPHERE, energy, problem, rod, rows

LAWS = ["blend", "poisson"]


def gaining():
    """Two planar contacts at which expansion without a guard gains 3 % of the energy: A, w, mu, e."""
    A = np.zeros((6, 5))
    A[[0, 1]] = (-2.81, -0.96, 0.3, -2.32, 0.68), (0.7, 1.06, 1.97, -0.99, 0.34)
    A[[3, 4]] = (-0.26, 0.67, -0.07, -0.88, -1.93), (-2.74, 1.02, -1.61, 0.54, -1.1)
    return A, np.array([0.91, 1.65, -1.35, -0.15, 0.66]), np.array([1.88, 1.69]), np.array([1.0, 0.0])


def spheres(speed, spin):
    """Three equal spheres in a row, R = 0.5, m = 1, the first moving and spinning; v_x, v_y and spin of each."""
    inertia, A = 0.1, np.zeros((6, 9))
    for i in (0, 1):
        A[3 * i, [3 * i, 3 * i + 3]] = -1.0, 1.0
        A[3 * i + 1, 3 * i + 1 : 3 * i + 6] = -1.0, -0.5, 0.0, 1.0, -0.5
    root = np.sqrt(np.tile([1.0, 1.0, inertia], 3))
    return A / root, root, root * np.array([speed, 0, spin, 0, 0, 0, 0, 0, 0])


def box_on_edges(velocity):
    """A planar box, 1 m by 0.4 m, 2 kg, on two edges; v_x, v_z and spin."""
    J = np.array([row for x in (0.5, -0.5) for row in ([0, 1, x], [1, 0, 0.2], [0, 0, 0])], dtype=float)
    root = np.sqrt([2.0, 2.0, 2 / 3 * (0.25 + 0.04)])
    return J / root, root, root * np.array(velocity)


def cube_between_plates(order, rounding):
    """A cube that drifts and turns between plates of 1 kg which close on it, four corners each: rows, masses, velocities.

    Args:
        order: Order of the corners.
        rounding: Relative error of each number of the rows.
    """
    J = np.zeros((24, 8))
    places = [(side, x, z) for side in (-1.0, 1.0) for x in (-0.04, 0.04) for z in (-0.04, 0.04)]
    for at, (side, x, z) in enumerate(places[i] for i in order):
        for row, along in enumerate(([0.0, -side, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])):
            J[3 * at + row, :6] = (*along, *np.cross((x, 0.1 * side, z), along))
        J[3 * at, 6 if side < 0.0 else 7] = side
    velocities = np.array([-0.02, 0.0, 0.013, 0.0, 0.15, 0.0, 0.185, -0.185])
    return J * (1.0 + rounding), np.array([5.0, 5.0, 5.0, 0.03, 0.03, 0.03, 1.0, 1.0]), velocities


def test_neither_order_nor_rounding_chooses_among_the_solutions_of_redundant_contacts(rng):
    """Friction at the corners of a face that turns may stop it by a tenth or by a half: any share of the load solves it."""
    after = []
    for _ in range(10):
        J, masses, v = cube_between_plates(rng.permutation(8), 1e-15 * rng.standard_normal((24, 8)))
        problem_of_cube = CoulombProblem((J / masses) @ J.T, J @ v, np.full(8, 0.3), np.zeros(8), 0.2)
        impulses, residual = coulomb(problem_of_cube)
        assert residual <= SOLVED
        after.append(v + J.T @ impulses.ravel() / masses)
    # A rounding of 1e-15 over the last compliance, 1e-6, is 1e-9 of the speeds at most.
    np.testing.assert_allclose(after, np.broadcast_to(after[0], (10, 8)), rtol=0.0, atol=2e-10)


def test_the_guard_lowers_restitution_where_energy_would_grow():
    """Theta and the energy after to 1e-6: theta is found by twenty bisections."""
    A, w, mu, e = gaining()
    result = impact_with_friction(A, w, mu, e, "poisson")
    assert result.status == "energy_guard"
    assert result.theta == pytest.approx(0.948914, abs=1e-6)
    assert energy(result.w) / energy(w) == pytest.approx(0.9999997, abs=1e-6)


@pytest.mark.parametrize(
    ("e", "v_x", "change"), [(1.0, (0, 0, 1), -0.0748663102), (0.5, (1 / 6, 1 / 6, 2 / 3), -0.3248663102)]
)
def test_a_spinning_sphere_hits_a_row(e, v_x, change):
    A, root, w = spheres(1.0, 2.0)
    result = impact_with_friction(A, w, np.full(2, 0.2), np.full(2, e), "blend")
    after = (result.w / root).reshape(3, 3).T
    np.testing.assert_allclose(after[0], v_x, atol=1e-9)
    np.testing.assert_allclose(after[1], (-0.1497326203, 0.1818181818, -0.0320855615), atol=1e-9)
    np.testing.assert_allclose(after[2], (1.2513368984, -0.5882352941, 0.1604278075), atol=1e-9)
    assert energy(result.w) - energy(w) == pytest.approx(change, abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("before", "after", "change"),
    [
        ((0.5, -1, 0), (0.02, 0.6, 0), -0.8896),
        ((0, -1, 0), (0, 0.6, 0), -0.64),
        ((0.2, -1, 0), (-0.0351219512, 0.6, 0.1756097561), -0.6757853659),
    ],
)
def test_a_box_lands_on_two_edges(law, before, after, change):
    A, root, w = box_on_edges(before)
    result = impact_with_friction(A, w, np.full(2, 0.3), np.full(2, 0.6), law)
    np.testing.assert_allclose(result.w / root, after, atol=1e-9)
    assert energy(result.w) - energy(w) == pytest.approx(change, abs=1e-9)
    if before == (0.5, -1, 0):
        np.testing.assert_allclose(result.impulses[:, 0], (1.792, 1.408), atol=1e-9)


@pytest.mark.parametrize(
    ("law", "after"),
    [("poisson", (0.1059292035, 0.3530973451, -0.7061946903)), ("blend", (0.0492202118, 0.4248703082, -0.2461010591))],
)
def test_a_tumbling_box_depends_on_the_law(law, after):
    A, root, w = box_on_edges((0, -0.5, 2))
    result = impact_with_friction(A, w, np.full(2, 0.3), np.full(2, 0.6), law)
    np.testing.assert_allclose(result.w / root, after, atol=1e-9)


def checked(A, w, mu, e, law):
    """A result after all conditions that every impact must satisfy, with tolerances relative to speeds and energy."""
    result = impact_with_friction(A, w, mu, e, law)
    T, speed = energy(w), np.abs(A @ w).max()
    change = energy(result.w) - T
    assert result.status in {"ok", "jammed", "energy_guard"}
    assert result.residual <= 1e-9
    assert change <= 1e-12 * T
    assert (A[::3] @ result.w).min() >= -1e-9 * speed
    assert result.impulses[:, 0].min() >= 0.0
    assert np.all(np.hypot(result.impulses[:, 1], result.impulses[:, 2]) <= mu * result.impulses[:, 0])
    np.testing.assert_allclose(result.w, w + A.T @ result.impulses.ravel(), rtol=0, atol=1e-14 * np.abs(w).max())
    assert result.normal_work.sum() + result.friction_work.sum() == pytest.approx(change, abs=1e-12 * T)
    return result


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("law", LAWS)
def test_random_problems(law, seed):
    """3000 problems per law, of three families: solved, no energy gained, nothing approaches, impulses in their cones."""
    for i in range(100):
        rng = np.random.default_rng([seed, i])
        checked(*problem(rng, i % 3), law)


@pytest.mark.parametrize("law", LAWS)
def test_contacts_that_nothing_pushes_get_no_impulse(law):
    """A separate contact that separates, and one that does not move at all: exactly zero."""
    G = np.zeros((9, 9))
    for i in range(3):
        G[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = rod(45)
    A, w = rows(G, (-1, 0.3, 0, 0.5, 0.2, 0, 0, 0, 0))
    result = impact_with_friction(A, w, np.full(3, 0.5), np.full(3, 0.5), law)
    assert result.impulses[0, 0] > 0.0
    np.testing.assert_array_equal(result.impulses[1:], 0.0)
    assert result.paths[1:] == ("", "")


@pytest.mark.parametrize("law", LAWS)
def test_a_contact_without_friction_gets_no_tangential_impulse(law, rng):
    """Among others with friction: no tangential impulse, and no path."""
    for i in range(20):
        A, w, mu, e = problem(rng, i % 3)
        mu[0] = 0.0
        mu[1] = max(mu[1], 0.1)
        result = checked(A, w, mu, e, law)
        np.testing.assert_array_equal(result.impulses[0, 1:], 0.0)
        assert result.paths[0] == ""


def test_a_path_that_cannot_be_integrated_is_replaced_by_poisson(monkeypatch):
    """Poisson's solution for the rod at 45 degrees, with its digits."""
    monkeypatch.setattr("ffsm_mj.contact_models.impact.friction.routh._SEGMENTS", 1)
    A, w = rows(rod(45), (-1, 1, 0))
    result = impact_with_friction(A, w, np.array([0.3]), np.array([0.5]), "blend")
    assert (result.law, result.status) == ("poisson", "ok")
    np.testing.assert_allclose(A @ result.w, (0.4135593220, 0, 0), atol=1e-9)
    assert energy(result.w) - energy(w) == pytest.approx(-0.1965527147, abs=1e-9)


def test_an_impulse_of_rounding_has_no_path():
    """A contact that only touches: whether it has an impulse of 1e-17 depends on the order of sums, its path does not."""
    for speed in (-1e-17, 0.0, 1e-17):
        result = impact_with_friction(np.eye(6), np.array((-1, 2, 0, speed, 0, 0)), np.full(2, 0.5), np.zeros(2), "blend")
        assert result.paths == ("slip", "")


@pytest.mark.parametrize("count", [1, 2])
def test_refusals(count, rng):
    A, w, one = rng.normal(size=(3 * count, 7)), rng.normal(size=7), np.ones(count)
    with pytest.raises(UnsupportedContactError, match="'newton' with friction can create energy"):
        impact_with_friction(A, w, one, one, "newton")
    with pytest.raises(UnsupportedContactError, match="mu > 0 needs e <= 1"):
        impact_with_friction(A, w, one, 1.5 * one, "blend")
    A[0] = 0.0
    with pytest.raises(ValueError, match="neither body can move"):
        impact_with_friction(A, w, one, one, "blend")


def test_no_solution_is_reported(monkeypatch):
    """Without steps and pyramids the residual stays large, and the result must not be used."""
    for name, value in (("_STEPS", 0), ("_DAMPED_STEPS", 0), ("_FACETS", ())):
        monkeypatch.setattr(f"ffsm_mj.contact_models.impact.friction.coulomb.{name}", value)
    A, _, w = spheres(1.0, 2.0)
    result = impact_with_friction(A, w, np.full(2, 0.2), np.ones(2), "poisson")
    assert result.status == "unconverged"
    assert result.residual > 1e-3


@pytest.mark.parametrize("law", LAWS)
def test_a_contact_with_one_relative_motion_gets_the_impulse_of_least_norm(law):
    """All three rows of one contact are multiples d of one row a: any p with p . d = -s / |a|^2, s = a . w, stops it.

    Of these the shortest is along d, inside the cone as |d_t| < mu d_n. Known to 1e-9, as the conditions are to 1e-10.
    """
    d, a = np.array([1.0, -0.1, 0.05]), np.array([0.3, -0.4, 1.2])
    A = np.zeros((6, 6))
    A[:3, :3], A[3:, 3:] = np.outer(d, a), np.diag([1.0, 0.8, 0.9])
    w = np.array([-0.5, 0.2, -0.7, -1.0, 2.0, 0.5])
    result = impact_with_friction(A, w, np.array([0.3, 0.2]), np.zeros(2), law)
    np.testing.assert_allclose(result.impulses[0], -(a @ w[:3]) / (a @ a) * d / (d @ d), atol=1e-9)
    np.testing.assert_allclose(A[:3] @ result.w, 0.0, atol=1e-12)


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


def wrong_sign(impulse, mu):
    return result.clip_to_cone(impulse, mu) * (1, -1, -1)


def test_friction_of_one_contact_with_the_wrong_sign(monkeypatch):
    """The works along the path are not those of the impulse, so they miss the change of energy."""
    A, w = rows(SPHERE, (-1, 0.72, 0.96))
    assert stronge(A, w, 0.2, 0.5).status == "ok"
    monkeypatch.setattr(routh, "clip_to_cone", wrong_sign)
    assert stronge(A, w, 0.2, 0.5).status == "unconverged"
    monkeypatch.undo()

    def forward(self, problem):
        return np.append(1.0, problem.mu * self.direction)

    monkeypatch.setattr(routh.Path, "force", forward)
    assert stronge(A, w, 0.2, 0.5).status == "unconverged"


def test_friction_of_several_contacts_with_the_wrong_sign(monkeypatch):
    A, _, w = spheres(1.0, 2.0)
    mu, e = np.full(2, 0.2), np.ones(2)
    assert impact_with_friction(A, w, mu, e, "blend").status == "ok"
    monkeypatch.setattr(laws, "clip_to_cone", wrong_sign)
    gains = impact_with_friction(A, w, mu, e, "blend")
    assert energy(gains.w) > energy(w)
    assert gains.status == "unconverged"
    with pytest.raises(AssertionError):
        checked(A, w, mu, e, "blend")


def test_a_forgotten_guard(monkeypatch):
    """Without the guard this case gains 2.86 % of its energy, and the last check of every result finds it."""
    A, w, mu, e = gaining()
    monkeypatch.setattr(laws._SeveralContacts, "gain", lambda *_: -1.0)
    bare = impact_with_friction(A, w, mu, e, "poisson")
    assert energy(bare.w) / energy(w) == pytest.approx(1.028609, abs=1e-6)
    np.testing.assert_allclose((A @ bare.w)[[0, 1, 3, 4]], (4.971355, 0, 0.263994, 1.461663), atol=1e-6)
    assert bare.theta == 1.0
    assert bare.status == "unconverged"


def test_plastic_contacts_get_no_restitution():
    """Contacts with e = 0 end at rest along the normal although others bounce: a box on two edges, one of them smooth."""
    A, _, w = box_on_edges((0.5, -1, 0))
    for law in ("blend", "poisson"):
        plastic = impact_with_friction(A, w, np.array([0.3, 0.0]), np.zeros(2), law)
        np.testing.assert_allclose((A @ plastic.w)[::3], 0.0, atol=1e-12)
    for seed in range(10):
        A, w, mu, e = problem(np.random.default_rng([10, seed]), 0)
        whole = impact_with_friction(A, w, mu, np.zeros(len(e)), "poisson")
        assert whole.theta == 1.0
        assert np.all((whole.impulses[:, 0] == 0.0) | (np.abs(A[::3] @ whole.w) <= 1e-9 * np.abs(A @ w).max()))
