"""Choice of friction modes at one instant, against problems solved by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq, nnls

import ffsm_mj
from ffsm_mj.contact_models.persistent.friction.choice import ModeChoice, NoModesError, PointStates
from ffsm_mj.contact_models.persistent.friction.cones import cone_depth, cone_margin, largest_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_in_cones, least_use, wedged
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK, UNKNOWN
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem, StageEquation
from ffsm_mj.replay import replay_log
from tests.contact_models.impact.friction.problems import problem
from tests.contact_models.impact.friction.test_oracles import pinocchio_impulses
from tests.contact_models.persistent.test_friction_seen import in_a_v, on_floor
from tests.replays import proved


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


ONE, EVERY = np.array([0]), np.arange(4)


def slip_of_one(G, b, mu, p, c, angle):
    """Slip that friction against a direction leads to: the normal force keeps the gap at rest."""
    d = np.array((np.cos(angle), np.sin(angle)))
    N = -b[0] / (G[0, 0] - mu * G[0, 1:] @ d)
    return d, p + c * (b[1:] + N * (G[1:, 0] - mu * G[1:, 1:] @ d))


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1.0])
def test_one_point_with_its_normal_force(seed, scale):
    """The direction is that of the slip it leads to, ``scale`` times c; the estimate is anywhere."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    G, mu, c = root @ root.T + 2.0 * np.eye(3), 0.3, 1e-3
    angle, speed = rng.uniform(0, 2 * np.pi), scale * c
    b = np.array((-rng.uniform(1.0, 9.0), *rng.normal(size=2)))
    d, reached = slip_of_one(G, b, mu, np.zeros(2), c, angle)
    p = speed * d - reached
    problem = FrictionProblem(G, b, np.array([mu]))
    start = rng.normal(size=2)
    equation = StageEquation([problem], np.array([SLIDE]), ONE, p[None, None], np.array([[c]]))
    (forces,), (found,) = equation.solve((start / np.linalg.norm(start))[None, None])

    def turned(turn):
        s, u = slip_of_one(G, b, mu, p, c, angle + turn)
        return s[0] * u[1] - s[1] * u[0]

    # Slips are known to 1e-16 m/s; friction against a turn, c mu N, is 1e-4 m/s at least, however slow the slip.
    exact = angle + brentq(turned, -1e-3, 1e-3, xtol=1e-16)
    assert found[0] == pytest.approx([np.cos(exact), np.sin(exact)], abs=1e-12)
    assert forces[0, 1:] == pytest.approx(-mu * forces[0, 0] * found[0], rel=1e-14)


def on_four_corners(pull):
    """A block of 1 kg under 10 N that a force in the plane of its corners pulls."""
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    rows = np.vstack([np.hstack((np.eye(3)[[2, 0, 1]], np.cross(each, np.eye(3)[[2, 0, 1]]))) for each in corners])
    inverse = np.diag([1.0, 1.0, 1.0, 100.0, 50.0, 40.0])
    return FrictionProblem(rows @ inverse @ rows.T, rows @ np.array((*pull, -10.0, 0.0, 0.0, 0.0)), np.full(4, 0.3))


def begins(problem):
    """The equation of points that begin to slip: for the directions of their accelerations."""
    return StageEquation([problem], np.full(4, SLIDE), EVERY, np.zeros((1, 4, 2)), np.eye(1))


@pytest.mark.parametrize("excess", [3e-9, 1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("off", [1e-8, 1e-3, 1.0])
def test_points_that_share_a_load_break_away_along_the_pull(excess, off):
    """By f = pull - mu N: from an estimate of the direction that is off by more than the excess over the limit."""
    problem = on_four_corners(((3.0 + excess) * 0.6, (3.0 + excess) * 0.8))
    estimate = np.tile((0.6 * np.cos(off) - 0.8 * np.sin(off), 0.6 * np.sin(off) + 0.8 * np.cos(off)), (4, 1))
    (forces,), _ = begins(problem).solve(estimate[None])
    accelerations = (problem.b + problem.G @ forces.ravel()).reshape(4, 3)
    # Sums of twelve forces of up to 3 N, whose accelerations cancel by 200 times as much.
    np.testing.assert_allclose(accelerations[:, 1:], excess * np.tile((0.6, 0.8), (4, 1)), atol=3e-13)
    np.testing.assert_allclose(forces.sum(axis=0)[1:], (-1.8, -2.4), atol=1e-13)


def test_there_is_no_slip_inside_the_limit():
    problem = on_four_corners((2.9, 0.0))
    estimate = np.tile((1.0, 0.0), (4, 1))
    assert begins(problem).solve(estimate[None]) is None


@pytest.mark.parametrize(
    ("kinds", "pinned"),
    [
        ((STICK, STICK, SLIDE, SLIDE), (False, False, True, True)),
        ((STICK, CLOSED, SLIDE, CLOSED), (False,) * 4),  # it turns about the one that sticks
        ((SLIDE, SLIDE, SLIDE, SLIDE), (False,) * 4),
    ],
)
def test_a_point_of_a_body_that_sticks_at_two_others_cannot_slip(kinds, pinned):
    assert on_four_corners((1.0, 0.0)).pinned(np.array(kinds)).tolist() == list(pinned)


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


def problems(count):
    """Forces outside their cones, forces without effect, and coefficients, where others are inside."""
    rng = np.random.default_rng(1)
    while count:
        k = int(rng.integers(2, 9))
        mu = rng.uniform(0.1, 1.2, k)
        freedom = np.linalg.qr(rng.normal(size=(3 * k, int(rng.integers(1, 3 * k - 4)))))[0]
        given = np.column_stack((rng.uniform(0.1, 1.0, k), 0.3 * rng.normal(size=(k, 2)))).ravel()
        given = (given - freedom @ (freedom.T @ given)).reshape(-1, 3)
        if cone_depth(given, mu) < 0.0 <= largest_margin(given, freedom, mu)[0]:
            count -= 1
            yield given, freedom, mu


def test_shares_have_the_effect_are_inside_the_cones_and_of_least_norm():
    rng = np.random.default_rng(2)
    for given, freedom, mu in problems(30):
        unit = np.abs(given).max()
        found = least_in_cones(given, freedom, mu)
        change = (found - given).ravel()
        assert np.abs(change - freedom @ (freedom.T @ change)).max() < 1e-10 * unit
        assert cone_depth(found, mu) > -2e-9 * unit  # the cones are larger by 1e-9 of the largest force
        inside = largest_margin(given, freedom, mu)[1]
        # No step to others inside the cones reduces the norm: to those of the largest margin, and from there to random ones.
        directions = [
            np.zeros((len(mu), 3)),
            *((freedom @ rng.normal(size=freedom.shape[1])).reshape(-1, 3) for _ in range(5)),
        ]
        for other in (inside + direction for direction in directions):
            share = 1.0
            while cone_depth(inside + share * (other - inside), mu) < 0.0:
                share *= 0.5
            feasible = inside + share * (other - inside)
            assert np.sum(found * (feasible - found)) > -1e-8 * unit**2


def test_a_ball_pressed_into_a_v_is_logged_with_forces_on_its_cones(tmp_path):
    """Half-angle 30 degrees, mu = 0.5, 1 N: equal springs give t / n = 1.73; inside the cones the least norm has t = n / 2.

    Along the load n sin 30 + t cos 30 = 1/2 at each side. Both sides are one body: friction is the sum of both, along the
    load.
    """
    run = proved(ffsm_mj.run(in_a_v(tmp_path, 0.5, math.radians(30.0), (0.0, -1.0))))
    normal = 0.5 / (0.5 + 0.5 * math.sqrt(0.75))
    np.testing.assert_allclose(run["contact.groove_friction_N"], normal * math.sqrt(0.75), rtol=1e-8)
    np.testing.assert_allclose(run["contact.groove_force_N"], 1.0, rtol=1e-8)


def failures(log):
    """Names of checks that fail by the states of a log."""
    return {check.name for check in replay_log(log).checks() if not check.passes}


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.19, 0.21])
def test_points_that_stick_outside_their_cones_fail_a_check(tmp_path, monkeypatch, mu):
    """A box on a slope of 1 in 5, with code that never lets it slip: of mu = 0.19 it needs more than there is."""
    slope = {"geom": 'type="box" size=".5 .4 .1"', "height": 0.1, "gravity": (-0.2, 0.0, -1.0), "duration_s": 0.02}
    monkeypatch.setattr(ModeChoice, "stick_margin", lambda *_: 1.0)
    run = ffsm_mj.run(on_floor(tmp_path, mu=mu, **slope))
    assert set(run["contact.sole_mode"]) == {3.0}
    assert failures(run.log) == ({"contact complementarity"} if mu < 0.2 else set())


def cap(velocity, spin, mu):
    """The choice for eight points of the rim of a cylinder of 2 kg that stands, slides and spins."""
    angles = 0.25 * np.pi * np.arange(8)
    at = np.column_stack((0.1 * np.cos(angles), 0.1 * np.sin(angles), np.full(8, -0.1)))
    axes = np.eye(3)[[2, 0, 1]]  # normal and tangents
    J = np.vstack([np.hstack((axes, np.cross(x, axes))) for x in at])
    inverse_inertia = 1.0 / np.array([2.0, 2.0, 2.0, 0.008, 0.008, 0.01])
    states = PointStates(
        slips=velocity + spin * np.column_stack((-at[:, 1], at[:, 0])),
        slipping=np.ones(8, dtype=bool),
        kinds=np.full(8, UNKNOWN),
        directions=np.zeros((8, 2)),
        rounding=np.full(8, 1e-12),
        released=False,
    )
    b = np.tile([-9.81, 0.0, 0.0], 8)
    return ModeChoice(FrictionProblem(J * inverse_inertia @ J.T, b, np.full(8, mu)), states)


@pytest.mark.parametrize(("mu", "low"), [(0.9, 0.1), (1.0, 0.8), (1.1, 0.2)])
def test_points_of_a_cap_that_take_up_load_or_lose_it_have_modes(mu, low):
    """A direction of slide at which the points that press change, to the last bit: both sides of it have valid modes.

    Up to mu h = r cos(pi / 8), mu = 0.924, the centre of pressure, mu h forward, is inside the rim; beyond, the body tips
    over an edge, and three points that press would be beyond Painleve's limit together.
    """

    def chosen(angle):
        return cap(0.08 * np.array([math.cos(angle), math.sin(angle)]), 0.8, mu).choose()

    high = low + 0.1
    while chosen(low).kinds.tolist() == chosen(high).kinds.tolist():
        high += 0.1
    for _ in range(56):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chosen(middle).kinds.tolist() == chosen(low).kinds.tolist() else (low, middle)
    for angle in (low, high):
        found = chosen(angle)
        pushes, opens = found.forces[:, 0], found.accelerations[:, 0]
        assert min(pushes.min(), opens.min()) > -1e-10
        assert np.abs(pushes * opens).max() < 1e-9
        if mu < math.cos(math.pi / 8.0):
            assert pushes.sum() == pytest.approx(2.0 * 9.81, rel=1e-12)
