"""Friction and restitution, (mu, e), of a law from measured impacts: least squares, held-out errors, bootstrap intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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
_FLAT = 1e-8
"""Mean square of derivatives below which a parameter has no effect: errors of the differences are 1e-12, effects near 1."""
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
    solve = _solver(law, np.array([impacts.compliance_ratio]))
    impulses = np.zeros((len(impacts), 3))
    one_mu, one_e = np.array([mu]), np.array([e])
    weighted = impacts.weighted(impacts.before)
    rows = np.zeros((len(impacts), 3, impacts.before.shape[1]))  # in the plane the second tangent is zero: nothing moves
    rows[:, : impacts.A.shape[1]] = impacts.A
    for i, (A, w) in enumerate(zip(rows, weighted, strict=True)):
        impulses[i] = solve(A, w, one_mu, one_e).impulses[0]
    return impacts.velocities_after(impulses[:, : impacts.A.shape[1]])


def _solver(law: str, ratio: FloatArray) -> Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FrictionResult]:
    """The law of a name, with a compliance ratio, (1,), as a function of (A, w, mu, e)."""
    if law in RULES:
        from ffsm_mj.contact_models.impact.friction.laws import impact_by_rule

        return lambda A, w, mu, e: impact_by_rule(A, w, mu, e, law)
    named = impact_law(law)
    return lambda A, w, mu, e: friction_of(named, solve_impact(named, ImpactProblem.mass_weighted(A, w, e, mu, ratio)))


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
    resampled = _bootstrap(solved, len(impacts), resamples)
    return LawFit(law, Interval.of(mu, resampled[:, 0]), Interval.of(e, resampled[:, 1]))


def _bootstrap(solved: Any, k: int, resamples: int) -> FloatArray:
    """Parameters from resamples of k impacts: Gauss-Newton steps from the solution of the whole, (resamples, 2).

    A parameter that a resample does not depend on, as mu where all contacts stick, may be anything within its bounds.
    """
    residuals, jacobian = solved.fun.reshape(k, -1), solved.jac.reshape(k, -1, 2)
    squares = np.einsum("kia,kib->kab", jacobian, jacobian)
    leverage = np.einsum("kia,ab,kjb->kij", jacobian, np.linalg.pinv(squares.sum(axis=0)), jacobian)
    # A fit pulls its residuals towards zero by their leverage (HC3 of MacKinnon and White 1985); with few impacts the
    # intervals would be too short.
    free = np.linalg.solve(np.eye(residuals.shape[1]) - _SHARE * leverage, residuals[..., None])[..., 0]
    counts = np.random.default_rng(0).multinomial(k, np.full(k, 1.0 / k), size=resamples)
    totals = np.einsum("sk,kab->sab", counts, squares)
    steps = np.einsum("sab,sb->sa", np.linalg.pinv(totals, rcond=_FLAT), counts @ np.einsum("kia,ki->ka", jacobian, free))
    parameters = np.clip(solved.x - steps, *_BOUNDS)
    for i, bounds in enumerate(zip(*_BOUNDS, strict=True)):
        undetermined = totals[:, i, i] <= _FLAT * k
        parameters[undetermined, i] = np.linspace(*bounds, int(undetermined.sum()))
    return np.asarray(parameters)


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
