"""Friction and restitution, (mu, e), of a law from measured impacts: least squares, held-out errors, bootstrap intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.impact.law import ImpactProblem, friction_of, impact_law, solve_impact
from ffsm_mj.identification.impacts import MeasuredImpacts

if TYPE_CHECKING:
    from ffsm_mj.contact_models.impact.friction.result import FrictionResult

RULES = ("stronge", "poisson", "coulomb")
"""Rules of the built-in laws, each for one contact; in a simulation the last two are for several contacts at one instant."""
_BOUNDS = ((1e-6, 0.0), (2.0, 1.0))
"""Bounds of (mu, e) in a fit. At mu = 0 there is no friction to solve for; beyond 2 contacts of usual shapes stick."""
_STARTS = tuple((mu, e) for mu in (0.1, 0.3, 0.8) for e in (0.2, 0.5, 0.8))
"""Where a fit may begin, at the best of these: the error is smooth between changes of slip and stick only."""
_SHARE = 1.0 - 1e-6
"""Share of the leverage that is taken off, so that an impact which alone decides a parameter divides by no zero."""
_DIFFERENCE = 1e-6
"""Step of the numerical derivatives: laws are exact to 1e-12, so that these are to 1e-6."""


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval.

    Attributes:
        value: Of the whole sample.
        low: 2.5 % quantile of the resampled values.
        high: 97.5 % quantile.
    """

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, resampled: FloatArray) -> Interval:
        """Percentile interval of resampled values."""
        low, high = np.quantile(resampled, (0.025, 0.975)).tolist()
        return cls(value, low, high)


@dataclass(frozen=True)
class LawFit:
    """A law fitted to impacts.

    Attributes:
        law: Name of the law or rule.
        mu: Coefficient of friction.
        e: Coefficient of restitution.
    """

    law: str
    mu: Interval
    e: Interval


def predicted(impacts: MeasuredImpacts, law: str, mu: float, e: float) -> FloatArray:
    """Velocities after the impacts by a law, (k, n); an impact that does not approach has no impulse.

    Args:
        impacts: The impacts; their velocities after are not used.
        law: A rule (see ``RULES``) or the name of an impact law, such as ``blend``.
        mu: Coefficient of friction, > 0.
        e: Coefficient of restitution, 0 to 1.

    Raises:
        LookupError: The law is unknown.
        UnsupportedContactError: The law does not cover friction.
    """
    solve = _solver(law)
    impulses = np.zeros((len(impacts), 3))
    one_mu, one_e = np.array([mu]), np.array([e])
    weighted = impacts.weighted(impacts.before)
    rows = np.zeros((len(impacts), 3, impacts.before.shape[1]))  # in the plane the second tangent is zero: nothing moves
    rows[:, : impacts.A.shape[1]] = impacts.A
    for i, (A, w) in enumerate(zip(rows, weighted, strict=True)):
        impulses[i] = solve(A, w, one_mu, one_e).impulses[0]
    return impacts.velocities_after(impulses[:, : impacts.A.shape[1]])


def _solver(law: str) -> Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FrictionResult]:
    """The law of a name as a function of (A, w, mu, e)."""
    if law in RULES:
        from ffsm_mj.contact_models.impact.friction.laws import impact_by_rule

        return lambda A, w, mu, e: impact_by_rule(A, w, mu, e, law)
    named = impact_law(law)
    return lambda A, w, mu, e: friction_of(named, solve_impact(named, ImpactProblem.mass_weighted(A, w, e, mu)))


def fit(impacts: MeasuredImpacts, law: str, start: tuple[float, float] | None = None, resamples: int = 2000) -> LawFit:
    """Fit (mu, e): least mean square of the errors in the energy norm.

    The intervals are those of a one-step bootstrap: each resample of the impacts moves (mu, e) by the Gauss-Newton step from
    the fit to the whole sample, which to first order is a fit of its own, without solving impacts again.

    Args:
        impacts: The impacts to fit to.
        law: See :func:`predicted`.
        start: Where to begin; None: the best of a coarse grid.
        resamples: Resamples of the bootstrap.
    """
    from scipy.optimize import least_squares

    measured = impacts.weighted(impacts.after)

    def residuals(parameters: FloatArray) -> FloatArray:
        velocities = predicted(impacts, law, float(parameters[0]), float(parameters[1]))
        return np.asarray(((impacts.weighted(velocities) - measured) / impacts.speeds[:, None]).ravel())

    def cost(parameters: tuple[float, float]) -> float:
        return float(np.sum(residuals(np.array(parameters)) ** 2))

    best = min(_STARTS, key=cost) if start is None else start
    solved = least_squares(residuals, best, bounds=_BOUNDS, diff_step=_DIFFERENCE)
    mu, e = solved.x.tolist()
    steps = _bootstrap_steps(solved.fun.reshape(len(impacts), -1), solved.jac.reshape(len(impacts), -1, 2), resamples)
    around = np.clip(solved.x + steps, *_BOUNDS)
    return LawFit(law, Interval.of(mu, around[:, 0]), Interval.of(e, around[:, 1]))


def _bootstrap_steps(residuals: FloatArray, jacobian: FloatArray, resamples: int) -> FloatArray:
    """Gauss-Newton steps of resampled least squares from the solution of the whole, (resamples, p).

    Args:
        residuals: Of each impact at the solution, (k, n).
        jacobian: Their derivatives, (k, n, p).
        resamples: How many.
    """
    k, n, _ = jacobian.shape
    squares = np.einsum("kia,kib->kab", jacobian, jacobian)
    leverage = np.einsum("kia,ab,kjb->kij", jacobian, np.linalg.pinv(squares.sum(axis=0)), jacobian)
    # A fit pulls its residuals towards zero by their leverage (HC3 of MacKinnon and White 1985); with few impacts the
    # intervals would be too short.
    free = np.linalg.solve(np.eye(n) - _SHARE * leverage, residuals[..., None])[..., 0]
    gradients = np.einsum("kia,ki->ka", jacobian, free)
    counts = np.random.default_rng(0).multinomial(k, np.full(k, 1.0 / k), size=resamples)
    inverses = np.linalg.pinv(np.einsum("sk,kab->sab", counts, squares))
    return np.asarray(-np.einsum("sab,sb->sa", inverses, counts @ gradients))


def median_interval(values: FloatArray, resamples: int = 2000, seed: int = 0) -> Interval:
    """Median of values with its bootstrap interval."""
    medians = np.array([np.median(values[which]) for which in _resampled(len(values), resamples, seed)])
    return Interval.of(float(np.median(values)), medians)


def mean_interval(values: FloatArray, resamples: int = 2000, seed: int = 0) -> Interval:
    """Mean of values with its bootstrap interval."""
    means = np.array([values[which].mean() for which in _resampled(len(values), resamples, seed)])
    return Interval.of(float(values.mean()), means)


def _resampled(k: int, resamples: int, seed: int) -> Iterator[IntArray]:
    random = np.random.default_rng(seed)
    return (random.integers(k, size=k) for _ in range(resamples))


def split(k: int, train: int, seed: int = 0) -> tuple[IntArray, IntArray]:
    """Indices to fit to and to judge by, of k impacts at random."""
    order = np.random.default_rng(seed).permutation(k)
    return order[:train], order[train:]
