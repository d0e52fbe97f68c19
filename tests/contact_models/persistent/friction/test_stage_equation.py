"""Slips and friction that depend on each other, against the root of one angle, and at the limit of friction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem, StageEquation

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
