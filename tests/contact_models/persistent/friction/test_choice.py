"""Choice of friction modes at one instant, against problems solved by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from ffsm_mj.contact_models.persistent.friction.choice import ModeChoice, NoModesError, PointStates
from ffsm_mj.contact_models.persistent.friction.cones import cone_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_use, wedged
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, UNKNOWN
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem


def choice(G, b, mu, slip=(0.0, 0.0), *, present=UNKNOWN, direction=(0.0, 0.0), released=False):
    """The choice for one point."""
    states = PointStates(
        slips=np.array([slip]),
        slipping=np.array([slip != (0.0, 0.0)]),
        kinds=np.array([present]),
        directions=np.array([direction]),
        rounding=np.array([1e-12]),
        released=released,
    )
    return ModeChoice(FrictionProblem(np.array(G, dtype=float), np.array(b, dtype=float), np.array([mu])), states)


ROD = [[1.6, 1.2, 0.0], [1.2, 3.4, 0.0], [0.0, 0.0, 1.0]]
"""Delassus matrix of the tip of Painleve's rod, inclined at arctan 2, with m = 1 and l^2 / I = 3."""


def test_painleve_rod_slides_with_the_force_of_its_equation():
    """D = G_nn - mu G_tn = 1.6 - 1.44 = 0.16, and lambda_n = 1 / D."""
    found = choice(ROD, (-1.0, 0.0, 0.0), 1.2, slip=(1.0, 0.0)).choose()
    assert found.kinds[0] == SLIDE
    assert found.forces[0] == pytest.approx([6.25, -7.5, 0.0], rel=1e-12)


def test_painleve_rod_without_a_solution_is_named():
    """D = 1.6 - 1.8 < 0: sliding would need a tensile force, and opening an overlap."""
    with pytest.raises(NoModesError):
        choice(ROD, (-1.0, 0.0, 0.0), 1.5, slip=(1.0, 0.0)).choose()


@pytest.mark.parametrize("mu", [1.2, 1.5])
def test_painleve_rod_that_lifts_off_opens(mu):
    """For D < 0 a pressed solution exists too; open is taken."""
    assert choice(ROD, (1.0, 0.0, 0.0), mu, slip=(1.0, 0.0)).choose().kinds[0] == CLOSED


BLOCK = np.eye(3)


@pytest.mark.parametrize(("pull", "kind"), [(0.4999999, STICK), (0.5000001, SLIDE)])
def test_a_block_sticks_up_to_its_limit(pull, kind):
    found = choice(BLOCK, (-1.0, 0.6 * pull, 0.8 * pull), 0.5).choose()
    assert found.kinds[0] == kind
    if kind == SLIDE:
        assert found.directions[0] == pytest.approx([0.6, 0.8], abs=1e-6)


def test_at_the_event_a_point_at_its_limit_slides():
    """Both answers solve the problem there: without the rule, events of zero length would repeat for ever."""
    assert choice(BLOCK, (-1.0, 0.5, 0.0), 0.5).choose().kinds[0] == STICK
    found = choice(BLOCK, (-1.0, 0.5, 0.0), 0.5, present=STICK, released=True).choose()
    assert found.kinds[0] == SLIDE
    assert found.directions[0] == pytest.approx([1.0, 0.0], abs=1e-12)
    assert choice(BLOCK, (-1.0, 0.5, 0.0), 0.5, present=SLIDE, direction=(1.0, 0.0)).choose().kinds[0] == SLIDE


def test_the_margin_of_a_single_point_is_its_own():
    """It is m = mu lambda_n - |lambda_t|, of either sign."""
    mu = np.array([0.5])
    for force, margin in (((2.0, 0.3, 0.4), 0.5), ((2.0, 1.3, 0.4), 1.0 - np.hypot(1.3, 0.4))):
        assert cone_margin(np.array([force]), np.zeros((3, 0)), mu) == pytest.approx(margin, abs=1e-12)


def test_the_margin_of_two_points_of_a_pad_is_shared():
    """Two points share a normal and a tangential force at will: the best is an even share, m = (mu N - T) / 2 each."""
    given = np.array([[3.0, 0.2, 0.0], [1.0, 0.6, 0.0]])
    freedom = np.array([[1, 0, 0, -1, 0, 0], [0, 1, 0, 0, -1, 0], [0, 0, 1, 0, 0, -1]]).T / np.sqrt(2.0)
    assert cone_margin(given, freedom, np.array([0.5, 0.5])) == pytest.approx(0.5 * (0.5 * 4.0 - 0.8), abs=1e-12)


@pytest.mark.long
def test_the_use_of_friction_of_a_guided_point_is_that_of_its_internal_forces(rng):
    """One relative motion is left: forces across it have no effect, and any load is small beside large ones.

    Of a . lambda = c with c a_n > 0 the normal force alone is a solution. Otherwise |lambda_t| > lambda_n a_n / |a_t|, and
    the use falls to a_n / (mu |a_t|) as lambda_n grows, whatever was found before.
    """
    for _ in range(100):
        a, mu, c = rng.normal(size=3), np.array([rng.uniform(0.1, 3.0)]), rng.choice((-1.0, 1.0))
        problem = FrictionProblem(np.outer(a, a), -c * a, mu)
        forces = problem.forces(np.array([STICK]), np.zeros((1, 2)))
        internal = abs(a[0]) / (mu[0] * np.hypot(*a[1:]))
        assert wedged(problem, np.array([0]), 0) == (internal < 1.0)
        use = 0.0 if c * a[0] > 0.0 else internal
        if use > 1.0:  # it does not stick
            continue
        for estimate in (None, forces, forces + 1e3 * np.cross(a, (0.0, a[2], -a[1])), rng.normal(size=(1, 3))):
            # Iterations end at reductions of 1e-12.
            assert least_use(problem, forces, np.array([0]), estimate)[0] == pytest.approx(use, abs=1e-11)


def rows_without_friction(rng, kind):
    """Rows of the normals of 1 to 12 points: in general position, on a face, along few lines, or at equal places."""
    k, nv = rng.integers(1, 13), rng.integers(1, 9)
    if kind == 0:
        return rng.normal(size=(k, nv))
    if kind == 1:
        return np.column_stack((np.ones(k), rng.uniform(-1.0, 1.0, (k, 2))))
    if kind == 2:
        return rng.integers(-2, 3, (k, nv)).astype(float)
    return np.column_stack((np.ones(k), rng.integers(-1, 2, (k, 2))))


@pytest.mark.parametrize("kind", range(4))
def test_points_without_friction_solve_the_convex_problem(rng, kind):
    """Redundant and degenerate ones too: the accelerations of non-negative least squares, forces of no greater norm."""
    for _ in range(100):
        A = rows_without_friction(rng, kind)
        k, nv = A.shape
        f = rng.normal(size=nv) if rng.random() < 0.5 else -A.T @ np.abs(rng.normal(size=k)) * rng.integers(0, 2)
        G, b = np.zeros((3 * k, 3 * k)), np.zeros(3 * k)
        G[::3, ::3], b[::3] = A @ A.T, A @ f
        rounding = np.full(k, 1e-12 * (1.0 + np.abs(A * f).max()))
        states = PointStates(np.zeros((k, 2)), np.zeros(k, bool), np.full(k, UNKNOWN), np.zeros((k, 2)), rounding, False)
        found = ModeChoice(FrictionProblem(G, b, np.zeros(k)), states).choose()
        expected = nnls(A.T, -f)[0]
        scale = 1.0 + np.abs(b).max()
        # Points with a row of rounding size keep up to ten roundings of it.
        np.testing.assert_allclose(found.accelerations[:, 0], b[::3] + A @ (A.T @ expected), rtol=0, atol=2e-10 * scale)
        assert (found.forces[:, 0] * np.diag(A @ A.T) >= -10.0 * rounding).all()
        assert np.linalg.norm(found.forces) <= np.linalg.norm(expected) * (1.0 + 1e-6) + 1e-9
        assert set(found.kinds.tolist()) <= {CLOSED, SLIDE}
        kept = states._replace(kinds=found.kinds)
        assert ModeChoice(FrictionProblem(G, b, np.zeros(k)), kept).choose().kinds.tolist() == found.kinds.tolist()
