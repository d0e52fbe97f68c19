"""Impacts with friction: two laws for one contact, and two with discrete Coulomb friction for several contacts.

``coulomb`` mixes like the frictionless ``blend``: the plastic solution, then an expansion with at least e times the impulses
that the elastic solution adds to it. ``poisson`` expands with at least e times the compression impulses. For different
restitutions neither is proved to dissipate, so an energy guard follows: it multiplies all restitution by the largest factor
theta <= 1 for which no energy is gained. At theta = 0 every solution dissipates.

For one contact, by Stronge's law or with tangential compliance, e^2 is a ratio of works; for several contacts e is a ratio
of impulses of each contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.impact.friction.compliant import compliant
from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.contact_models.impact.friction.least_norm import shared
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, Status, clip_to_cone
from ffsm_mj.contact_models.impact.friction.routh import stronge
from ffsm_mj.contact_models.impact.laws import IMMOVABLE
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.tolerances import APPROACHING, CANCELLED, ENERGY_GAIN, SOLVED

_MAX_PASSES = 100
"""Largest number of elastic passes; more mean that bodies are squeezed without clearance."""
_BISECTIONS = 20
"""Bisections for theta: it is known to one millionth."""
_LAWS: dict[str, str] = {"blend": "coulomb", "poisson": "poisson"}


def impact_with_friction(A: FloatArray, w: FloatArray, mu: FloatArray, e: FloatArray, law: str) -> FrictionResult:
    """Solve an impact of k contacts of which at least one has friction.

    Contacts that do not approach get an impulse only if others push them.

    Args:
        A: Rows J L^-T of (n, t1, t2) of each contact with M = L L^T, (3k, n); a tangent in which nothing moves may be zero.
        w: Mass-weighted velocity before, L^T qdot, (n,).
        mu: Coefficients of friction, (k,), >= 0.
        e: Coefficients of restitution, (k,), 0 to 1.
        law: Law for several contacts: ``blend`` or ``poisson``.

    Raises:
        UnsupportedContactError: The law does not cover friction, or e > 1.
        ValueError: A contact between bodies that cannot move along its normal.
    """
    # Newton's ratio of speeds ignores the work of slip that reverses: Kane's pendulum gains energy (Kane & Levinson 1985).
    if law not in _LAWS:
        raise UnsupportedContactError(
            f"{law!r} with friction can create energy; with mu > 0 use {' or '.join(map(repr, _LAWS))}"
        )
    if e.max() > 1.0:
        raise UnsupportedContactError("super-elastic impacts (e > 1) are without friction: mu > 0 needs e <= 1")
    if np.any(np.linalg.norm(A[::3], axis=1) == 0.0):
        raise ValueError(IMMOVABLE)
    if len(mu) > 1:
        return _several(_SeveralContacts(A, w, mu), e, _LAWS[law])
    one = stronge(A, w, float(mu[0]), float(e[0]))
    # If the impulse path cannot be integrated, ``poisson`` replaces it: compression and expansion need no path.
    return _several(_SeveralContacts(A, w, mu), e, "poisson") if one.status == "unconverged" else one


def impact_by_rule(A: FloatArray, w: FloatArray, mu: FloatArray, e: FloatArray, rule: str) -> FrictionResult:
    """Solve an impact by the rule of a record, also one contact by a rule that simulations use for several contacts.

    Args:
        A: Rows of (n, t1, t2) of each contact, (3k, n); see :func:`impact_with_friction`.
        w: Mass-weighted velocity before, (n,).
        mu: Coefficients of friction, (k,), >= 0.
        e: Coefficients of restitution, (k,), 0 to 1.
        rule: ``stronge`` (one contact), ``poisson`` or ``coulomb``.
    """
    if rule == "stronge":
        return stronge(A, w, float(mu[0]), float(e[0]))
    return _several(_SeveralContacts(A, w, mu), e, rule)


def impact_with_compliance(A: FloatArray, w: FloatArray, mu: float, e: float, compliance_ratio: float) -> FrictionResult:
    """Solve an impact of one contact with friction and tangential compliance.

    Args:
        A: Rows J L^-T of (n, t1, t2) with M = L L^T, (3, n); a tangent in which nothing moves may be zero.
        w: Mass-weighted velocity before, L^T qdot, (n,).
        mu: Coefficient of friction, >= 0.
        e: Energetic coefficient of restitution, 0 to 1.
        compliance_ratio: Tangential over normal compliance, k_n / k_t, >= 0.

    Raises:
        ValueError: Neither body can move along the contact normal.
    """
    # Without friction, or with none but rounding, and with a rigid tangential spring, both laws are one.
    if mu > CANCELLED and compliance_ratio > 0.0:
        one = compliant(A, w, mu, e, compliance_ratio)
        if one.status != "unconverged":
            return one
    # A contact that friction holds closed swings for ever on its springs: the rigid law brings it to rest.
    return impact_with_friction(A, w, np.array([mu]), np.array([e]), "blend")


@dataclass
class _SeveralContacts:
    """An impact of several contacts.

    Attributes:
        A: Rows of (n, t1, t2) of each contact, (3k, n).
        w: Mass-weighted velocity before, (n,).
        mu: Coefficients of friction, (k,).
        residual: Largest residual of all solutions so far.
    """

    A: FloatArray
    w: FloatArray
    mu: FloatArray
    residual: float = 0.0

    def __post_init__(self) -> None:
        self.G: FloatArray = self.A @ self.A.T
        self.u: FloatArray = self.A @ self.w
        # The same in all axes of the tangents, on which no decision may depend.
        self.speed = float(np.linalg.norm(self.u.reshape(-1, 3), axis=1).max())
        self.energy = 0.5 * float(self.w @ self.w)

    def solve(self, which: IntArray, u: FloatArray, least: FloatArray) -> FloatArray:
        """Impulses (k, 3) with Coulomb friction at some contacts; zero at the others.

        Args:
            which: Indices of the contacts, ascending.
            u: Velocities before, (3k,).
            least: Least normal impulses of those contacts.
        """
        rows = (3 * which[:, None] + np.arange(3)).ravel()
        contacts = CoulombProblem(self.G[np.ix_(rows, rows)], u[rows], self.mu[which], least, self.speed)
        impulses = np.zeros((len(self.mu), 3))
        solved, residual = coulomb(contacts)
        impulses[which] = shared(contacts, self.A[rows], solved) if residual <= SOLVED else solved
        self.residual = max(self.residual, residual)
        return impulses

    def gain(self, u: FloatArray, impulses: FloatArray) -> float:
        """Change of kinetic energy by impulses (k, 3) at contact velocities u (3k,), J."""
        p = impulses.ravel()
        return float(p @ (u + 0.5 * (self.G @ p)))

    def expand(self, which: IntArray, u: FloatArray, compression: FloatArray, least: FloatArray) -> tuple[FloatArray, float]:
        """Expansion impulses with normal parts of at least theta ``least``, and theta, the largest without energy gain."""
        begin = u + self.G @ compression.ravel()

        def with_share(theta: float) -> FloatArray | None:
            impulses = self.solve(which, begin, theta * least)
            return impulses if self.gain(u, compression + impulses) <= ENERGY_GAIN * self.energy else None

        # Bisection: the gain is not monotone in theta in general, but at theta = 0 every solution dissipates.
        if (whole := with_share(1.0)) is not None:
            return whole, 1.0
        low, high, best = 0.0, 1.0, None
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            # Only a theta that was solved and found not to gain is kept, so the result dissipates even where the gain is not
            # monotone.
            tried = with_share(middle)
            if tried is None:
                high = middle
            else:
                low, best = middle, tried
        return (best if best is not None else self.solve(which, begin, 0.0 * least)), low

    def elastic(self) -> tuple[FloatArray, bool]:
        """Impulses, (k, 3), of elastic passes over the approaching contacts until none approaches; and whether they jam."""
        impulses, u = np.zeros((len(self.mu), 3)), self.u.copy()
        for _ in range(_MAX_PASSES):
            which = np.flatnonzero(u[::3] < -APPROACHING * self.speed)
            if not len(which):
                return impulses, False
            compression = self.solve(which, u, np.zeros(len(which)))
            expansion, _ = self.expand(which, u, compression, compression[which, 0])
            impulses += compression + expansion
            u = self.u + self.G @ impulses.ravel()
        # As in the frictionless law, passes between bodies without clearance never end; a plastic step stops them.
        return impulses + self.solve(np.arange(len(self.mu)), u, np.zeros(len(self.mu))), True


def _several(impact: _SeveralContacts, e: FloatArray, law: str) -> FrictionResult:
    every = np.arange(len(e))
    if impact.u[::3].min() >= 0.0:  # no contact approaches; the speed may be zero, so nothing may be divided by it
        nothing = np.zeros((len(e), 3))
        return _result(impact, law, nothing, nothing, theta=1.0, jammed=False)
    # Compression: the plastic solution. Expansion: least normal impulses by the law, then Coulomb friction at the velocities
    # that follow, so that no contact ends approaching although others rebound.
    plastic = impact.solve(every, impact.u, np.zeros(len(e)))
    expansion, theta, jammed = np.zeros_like(plastic), 1.0, False
    if e.max() > 0.0:
        if law == "poisson":
            least = e * plastic[:, 0]
        else:
            elastic, jammed = impact.elastic()
            least = np.maximum(e * (elastic - plastic)[:, 0], 0.0)
        expansion, theta = impact.expand(every, impact.u, plastic, least)
    return _result(impact, law, plastic, expansion, theta, jammed)


def _result(
    impact: _SeveralContacts, law: str, plastic: FloatArray, expansion: FloatArray, theta: float, jammed: bool
) -> FrictionResult:
    impulses = np.stack([clip_to_cone(p, mu) for p, mu in zip(plastic + expansion, impact.mu, strict=True)])
    w = impact.w + impact.A.T @ impulses.ravel()
    u = [impact.u.reshape(-1, 3), (impact.A @ (impact.w + impact.A.T @ plastic.ravel())).reshape(-1, 3)]
    u.append((impact.A @ w).reshape(-1, 3))
    compression = 0.5 * plastic * (u[0] + u[1])
    works = compression + 0.5 * (impulses - plastic) * (u[1] + u[2])
    # Whether a contact that only touches gets an impulse of rounding depends on the order of sums.
    pushed = np.diag(impact.G)[::3] * impulses[:, 0] > SOLVED * impact.speed
    return FrictionResult(
        impulses=impulses,
        w=w,
        law=law,
        status=_status(impact, w, theta, jammed),
        theta=theta,
        residual=impact.residual,
        paths=tuple(_path(bool(pushed[i]), impact.mu[i], [v[i, 1:] for v in u], impact.speed) for i in range(len(impulses))),
        normal_work=works[:, 0],
        friction_work=works[:, 1] + works[:, 2],
        compression_work=compression[:, 0],
    )


def _status(impact: _SeveralContacts, w: FloatArray, theta: float, jammed: bool) -> Status:
    """Status of a result; ``unconverged`` if it violates a condition that every exact solution satisfies."""
    gained = 0.5 * float(w @ w) > impact.energy * (1.0 + ENERGY_GAIN)
    # Pairs at rest may approach by rounding, of which SOLVED is less than the rounding of the velocities after.
    normals = impact.A[::3]
    rounding = CANCELLED * np.abs(normals * w).max(axis=1)
    approaches = np.any(normals @ w < -np.maximum(SOLVED * impact.speed, rounding))
    if impact.residual > SOLVED or gained or approaches:
        return "unconverged"
    if theta < 1.0:
        return "energy_guard"
    return "jammed" if jammed else "ok"


def _path(pushed: bool, mu: float, slips: list[FloatArray], speed: float) -> str:
    """Contact modes before, after compression and at the end; empty for a contact without impulse or without friction."""
    if not pushed or mu == 0.0:
        return ""
    before = slips[0]
    modes = [_mode(slip, before, speed) for slip in slips]
    if modes[0] == "stick":  # without slip before, the later modes decide
        modes = [mode.replace("reverse ", "") for mode in modes[1:]]
    return ", ".join(mode for i, mode in enumerate(modes) if i == 0 or mode != modes[i - 1])


def _mode(slip: FloatArray, before: FloatArray, speed: float) -> str:
    if np.hypot(*slip) <= SOLVED * speed:
        return "stick"
    return "reverse slip" if slip @ before < 0.0 else "slip"
