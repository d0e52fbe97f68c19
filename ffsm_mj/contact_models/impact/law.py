"""Impact laws: their interface with the checks of a law on its records, the built-in ones, and laws by name.

See ``docs/impact-laws.md``. The built-in laws are ``blend``, ``poisson`` and ``newton``: one closed form for one contact,
three laws for several contacts; and ``compliant``, of one contact with friction and tangential compliance. The mathematics
is in :mod:`ffsm_mj.contact_models.impact.laws` and, with friction, in
:mod:`ffsm_mj.contact_models.impact.friction`.

A package provides a law through the entry-point group ``ffsm_mj.impact_laws``: the name of the entry point is the name of
the law, and its object a subclass of :class:`~ffsm_mj.contact_models.impact.law.ImpactLaw` with a constructor without
arguments.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.impact.laws import FRICTIONLESS, impulse_of_one
from ffsm_mj.errors import UnsupportedContactError, described
from ffsm_mj.records.events import ImpactRecord

if TYPE_CHECKING:
    from ffsm_mj.contact_models.impact.friction.result import FrictionResult


@dataclass(frozen=True)
class Coverage:
    """Impacts that a law covers; others are refused without calling it.

    Attributes:
        several: More than one contact at one instant.
        friction: Contacts with mu > 0.
        super_elastic: e > 1, for one contact without friction.
        compliance: Tangential compliance: a scenario must state that of each pair with friction.
    """

    several: bool = True
    friction: bool = False
    super_elastic: bool = False
    compliance: bool = False


@dataclass(frozen=True)
class ImpactProblem:
    """Impact problem: k closed contacts at one instant.

    With M = L L^T, w = L^T qvel and A = J L^-T the kinetic energy is |w|^2 / 2, the contact velocities are A w, and impulses
    p along the rows of J give w+ = w + A^T p.

    Attributes:
        M: Mass matrix, (n, n).
        J: Contact Jacobian. Without friction one row per contact, the normal velocity, (k, n); if any contact has friction
            three rows per contact, (normal, t1, t2), (3k, n).
        qvel: Velocities before the impact, (n,).
        restitution: Coefficients e, (k,). 0 requires a plastic impact: the contact stays closed.
        mu: Coefficients of Coulomb friction, (k,).
        compliance_ratio: Tangential over normal compliance, k_n / k_t, (k,); 0: rigid across the normal.
    """

    M: FloatArray
    J: FloatArray
    qvel: FloatArray
    restitution: FloatArray
    mu: FloatArray
    compliance_ratio: FloatArray

    @classmethod
    def mass_weighted(
        cls, A: FloatArray, w: FloatArray, restitution: FloatArray, mu: FloatArray, compliance_ratio: FloatArray
    ) -> ImpactProblem:
        """The problem in coordinates in which the mass matrix is the identity."""
        return cls(np.eye(len(w)), A, w, restitution, mu, compliance_ratio)

    @property
    def with_friction(self) -> bool:
        """Whether J has tangent rows, as it does if any contact of the impact has friction."""
        return len(self.J) > len(self.mu)

    @property
    def normals(self) -> FloatArray:
        """Rows of J along the normals, (k, n)."""
        return self.J[::3] if self.with_friction else self.J

    @property
    def movable(self) -> BoolArray:
        """Contacts whose gap some admissible motion changes, (k,): rows that cancel are zero, see ``without_rounding``."""
        return np.asarray(np.any(self.normals, axis=1), dtype=np.bool_)

    def of(self, which: IntArray) -> ImpactProblem:
        """The problem of some contacts alone."""
        rows = (3 * which[:, None] + np.arange(3)).ravel() if self.with_friction else which
        coefficients = (self.restitution[which], self.mu[which], self.compliance_ratio[which])
        return ImpactProblem(self.M, self.J[rows], self.qvel, *coefficients)

    @cached_property
    def speeds(self) -> FloatArray:
        """Normal velocities before, (k,), m/s; negative for contacts that approach."""
        return np.array([row @ self.qvel for row in self.normals])

    @cached_property
    def responses(self) -> FloatArray:
        """Change of velocity per unit normal impulse at each contact, M^-1 J^T transposed, (k, n)."""
        return np.stack([np.linalg.solve(self.M, row) for row in self.normals])

    @cached_property
    def inverse_masses(self) -> FloatArray:
        """Diagonal of J M^-1 J^T: inverse effective mass of each contact, (k,), 1/kg."""
        return np.array([row @ response for row, response in zip(self.normals, self.responses, strict=True)])

    @cached_property
    def L(self) -> FloatArray:
        """Lower Cholesky factor of M."""
        return np.asarray(np.linalg.cholesky(self.M), dtype=np.float64)

    @cached_property
    def A(self) -> FloatArray:
        """J L^-T."""
        return np.asarray(np.linalg.solve(self.L, self.J.T).T)

    @cached_property
    def w(self) -> FloatArray:
        """L^T qvel."""
        return np.asarray(self.L.T @ self.qvel)


@dataclass(frozen=True)
class ImpactSolution:
    """Solution of a law; the post-impact velocities follow from the impulses.

    Attributes:
        impulses: Normal impulses, (k,), N s, >= 0.
        status: ``ok``, or ``jammed`` if energy was lost because bodies are squeezed without clearance; more with friction.
        rule: Name for the record if the law has several rules; empty: the name of the law.
        friction: For a problem with friction: impulses along the rows of J, and their works.
    """

    impulses: FloatArray
    status: str = "ok"
    rule: str = ""
    friction: FrictionResult | None = None


class ImpactLaw(Protocol):
    """An impact law. A subclass needs a name, a coverage and :meth:`solve`.

    Attributes:
        name: Name in ``impact.law`` of a scenario and in the records.
        covers: Impacts that it covers.
        rules: Names that its solutions may have in records, besides its own.
    """

    name: ClassVar[str]
    covers: ClassVar[Coverage]
    rules: ClassVar[tuple[str, ...]] = ()

    def solve(self, problem: ImpactProblem) -> ImpactSolution:
        """Solve an impact that the law covers; a single contact approaches, and each can move along its normal.

        Raises:
            UnsupportedContactError: It has no solution; the run ends with this message.
        """
        ...

    def restitution_residual(self, event: Sequence[ImpactRecord]) -> float | None:
        """Residual of the check ``impact restitution``: recorded speeds without friction against this law, m/s.

        By default a single contact separates at e times its approach speed, with the recorded e. Several contacts have no
        such rule; the energy balance of their impact is checked under any law.

        Returns:
            The residual, or None if the law makes no statement about these contacts.
        """
        if len(event) > 1:
            return None
        (contact,) = event
        return abs(contact.separation_speed_m_s - contact.restitution_used * contact.approach_speed_m_s)

    def friction_residuals(
        self, event: Sequence[ImpactRecord], problem: ImpactProblem, impulses: FloatArray
    ) -> Iterator[float]:
        """Residuals of the check ``impact energy`` with friction: records against the law at the logged state, J.

        By default a single contact is solved again. Under any law it is also checked that the impulses explain the change
        of velocity, lie in their friction cones and create no energy.

        Args:
            event: Records of the impact.
            problem: The impact at the logged state before it, with the restitution that was used.
            impulses: Recorded impulses along the rows of ``problem.J``, (3k,).
        """
        if len(event) > 1:
            return
        (contact,) = event
        solution = solve_impact(self, problem)
        again = friction_of(self, solution)
        # Impulse times the largest speed is a bound of its work: the residual of an impulse in the unit of the check, J.
        yield float(np.abs(impulses - again.impulses[0]).max() * np.abs(problem.J @ problem.qvel).max())
        for logged, work in (
            (contact.normal_work_J, again.normal_work),
            (contact.friction_work_J, again.friction_work),
            (contact.compression_work_J, again.compression_work),
        ):
            yield abs(logged - float(work[0]))
        # Another sequence of slip and stick is another solution, however close its numbers are.
        if (contact.status, contact.path, contact.law, contact.theta) != (
            solution.status,
            again.paths[0],
            solution.rule or self.name,
            again.theta,
        ):
            yield math.inf


def solve_impact(law: ImpactLaw, problem: ImpactProblem) -> ImpactSolution:
    """Solve an impact by a law, and validate the solution.

    Contacts whose gap no admissible motion changes, such as those of bodies that latches hold together, take no part: they
    get no impulse, and are not passed to the law.

    Raises:
        UnsupportedContactError: The law does not cover the problem, or its solution is invalid.
    """
    movable = np.flatnonzero(problem.movable)
    # A single contact is passed to a law only when it approaches: the closed form -(1 + e) u / G would pull on a separating
    # one.
    if len(movable) == 0 or (len(movable) == 1 and problem.speeds[movable[0]] >= 0.0):
        return _no_impulses(problem)  # nothing collides: no law is needed
    # A row of zeros has J M^-1 J^T = 0. Laws divide by it, so such a contact is removed first, and put back with no impulse.
    if len(movable) < len(problem.mu):
        return _expanded(solve_impact(law, problem.of(movable)), problem, movable)
    if reason := uncovered(law, problem):
        raise UnsupportedContactError(reason)
    solution = law.solve(problem)
    # A negative or missing impulse would enter the balance as if it were physics.
    if solution.impulses.shape != problem.mu.shape or np.any(solution.impulses < 0.0):
        raise UnsupportedContactError(f"impact law {law.name!r} does not return one impulse >= 0 per contact")
    return solution


def _no_impulses(problem: ImpactProblem) -> ImpactSolution:
    """The solution where nothing collides."""
    nothing = np.zeros(len(problem.mu))
    if not problem.with_friction:
        return ImpactSolution(nothing)
    from ffsm_mj.contact_models.impact.friction.result import FrictionResult

    nowhere, paths = np.zeros((len(nothing), 3)), ("",) * len(nothing)
    none = FrictionResult(nowhere, problem.w, "", "ok", 1.0, 0.0, paths, nothing, nothing, nothing)
    return ImpactSolution(nothing, friction=none)


def _expanded(solution: ImpactSolution, problem: ImpactProblem, which: IntArray) -> ImpactSolution:
    """The solution of some contacts with those that take no part: they have no impulse and no work."""
    whole, friction = _no_impulses(problem), solution.friction
    whole.impulses[which] = solution.impulses
    if friction is not None and whole.friction is not None:
        fields = ("impulses", "normal_work", "friction_work", "compression_work")
        values = {name: np.zeros_like(getattr(whole.friction, name)) for name in fields}
        for name, value in values.items():
            value[which] = getattr(friction, name)
        paths = dict(zip(which.tolist(), friction.paths, strict=True))
        friction = replace(friction, paths=tuple(paths.get(i, "") for i in range(len(problem.mu))), **values)
    return replace(solution, impulses=whole.impulses, friction=friction)


def uncovered(law: ImpactLaw, problem: ImpactProblem) -> str:
    """Why a law does not cover a problem; empty if it does."""
    several, super_elastic = len(problem.mu) > 1, problem.restitution.max() > 1.0
    if problem.with_friction and not law.covers.friction:
        return f"impact law {law.name!r} does not cover friction; with mu > 0 use 'blend' or 'poisson'"
    # With e^2 > 1 the end of the impact is more work than the compression stored: the path of Routh then adds energy, and no
    # bound keeps it.
    if problem.with_friction and super_elastic:
        return "super-elastic impacts (e > 1) are without friction: mu > 0 needs e <= 1"
    # That energy never grows and no contact ends approaching is proved for e <= 1 only: the result is a convex mixture of
    # two states of no greater energy (docs/derivations.md).
    if several and super_elastic:
        return "super-elastic impacts (e > 1) are for one contact at a time"
    if several and not law.covers.several:
        return f"impact law {law.name!r} does not cover several contacts at one instant; use 'blend' or 'poisson'"
    if super_elastic and not law.covers.super_elastic:
        return f"impact law {law.name!r} does not cover super-elastic impacts (e > 1)"
    return ""


def friction_of(law: ImpactLaw, solution: ImpactSolution) -> FrictionResult:
    """Friction impulses and works of a solution.

    Raises:
        UnsupportedContactError: The solution has none, although its problem has friction.
    """
    if solution.friction is None:
        raise UnsupportedContactError(f"impact law {law.name!r} returns no friction impulses")
    return solution.friction


class _BuiltIn(ImpactLaw):
    """Base of the built-in laws: the closed form for one contact, and Stronge's law for one contact with friction."""

    def solve(self, problem: ImpactProblem) -> ImpactSolution:
        """Normal impulses, and friction impulses if any contact has friction."""
        if problem.with_friction:
            return self._with_friction(problem)
        e = problem.restitution
        if len(e) == 1:  # all restitution laws agree: -(1 + e) u / (J M^-1 J^T)
            speed, inverse_mass = float(problem.speeds[0]), float(problem.inverse_masses[0])
            return ImpactSolution(np.array([impulse_of_one(speed, inverse_mass, float(e[0]))]))
        result = FRICTIONLESS[self.name](problem.A, problem.w, e)
        return ImpactSolution(result.impulses, "jammed" if result.jammed else "ok")

    def friction_residuals(
        self, event: Sequence[ImpactRecord], problem: ImpactProblem, impulses: FloatArray
    ) -> Iterator[float]:
        """For one contact by its path, the works also satisfy the energetic definition of restitution."""
        yield from super().friction_residuals(event, problem, impulses)
        contact = event[0]
        if len(event) == 1 and contact.law in ("stronge", "compliant"):
            # Friction opposes slip all along the path, and no spring across it keeps or gains energy: its work is never
            # positive.
            yield max(contact.friction_work_J, 0.0)
            if contact.status != "wedged":  # e^2 = -W_restitution / W_compression; wedged: no restitution
                yield abs(contact.normal_work_J - (1.0 - contact.restitution_used**2) * contact.compression_work_J)

    def _with_friction(self, problem: ImpactProblem) -> ImpactSolution:
        # Imported only for contacts with friction: its solvers take time to load.
        from ffsm_mj.contact_models.impact.friction.laws import impact_with_friction

        solution = impact_with_friction(problem.A, problem.w, problem.mu, problem.restitution, self.name)
        return ImpactSolution(solution.impulses[:, 0], solution.status, solution.law, solution)


class Blend(_BuiltIn):
    """Plastic solution and generalised reflections, mixed by e; with friction ``stronge`` (one contact) or ``coulomb``."""

    name: ClassVar[str] = "blend"
    covers: ClassVar[Coverage] = Coverage(friction=True, super_elastic=True)
    # ``poisson`` replaces ``stronge`` where the path of a single contact cannot be integrated.
    rules: ClassVar[tuple[str, ...]] = ("stronge", "coulomb", "poisson")


class Poisson(_BuiltIn):
    """Compression, then expansion by e times the compression impulses; with friction, ``stronge`` for one contact."""

    name: ClassVar[str] = "poisson"
    covers: ClassVar[Coverage] = Coverage(friction=True, super_elastic=True)
    rules: ClassVar[tuple[str, ...]] = ("stronge",)


class Newton(_BuiltIn):
    """Each contact separates at e times its approach speed or faster, if that is consistent; without friction."""

    name: ClassVar[str] = "newton"
    covers: ClassVar[Coverage] = Coverage(super_elastic=True)


class Compliant(_BuiltIn):
    """One contact with a spring and a slider across the normal; ``stronge`` where it locks or has no such spring."""

    name: ClassVar[str] = "compliant"
    covers: ClassVar[Coverage] = Coverage(several=False, friction=True, super_elastic=True, compliance=True)
    rules: ClassVar[tuple[str, ...]] = ("stronge", "poisson")

    def _with_friction(self, problem: ImpactProblem) -> ImpactSolution:
        from ffsm_mj.contact_models.impact.friction.laws import impact_with_compliance

        of_one = (problem.mu[0], problem.restitution[0], problem.compliance_ratio[0])
        solution = impact_with_compliance(problem.A, problem.w, *map(float, of_one))
        return ImpactSolution(solution.impulses[:, 0], solution.status, solution.law, solution)


GROUP = "ffsm_mj.impact_laws"
_BUILT_IN: dict[str, ImpactLaw] = {law.name: law for law in (Blend(), Poisson(), Newton(), Compliant())}
_REGISTERED = dict(_BUILT_IN)


def register(law: ImpactLaw) -> None:
    """Register a law in this process, for scripts and tests that are not installed packages.

    Raises:
        ValueError: Another law has that name.
    """
    if _REGISTERED.setdefault(law.name, law) is not law:
        raise ValueError(f"another impact law has the name {law.name!r}")


def impact_laws() -> dict[str, ImpactLaw]:
    """All laws by name, built-in laws first."""
    plugins, _ = _plugins()
    return _REGISTERED | {name: law for name, law in plugins.items() if name not in _REGISTERED}


def impact_law(name: str) -> ImpactLaw:
    """Look up a law by name.

    Raises:
        LookupError: The law is unknown, or an installed package provides it and cannot be used; the message says which.
    """
    if law := _REGISTERED.get(name) or _plugins()[0].get(name):
        return law
    if fault := plugin_fault(name):
        raise LookupError(fault)
    raise LookupError(f"unknown impact law {name!r}; allowed: {', '.join(impact_laws())}")


def plugin_fault(name: str) -> str:
    """Why the law of this name of an installed package cannot be used; empty if it can, or if there is none."""
    broken = _plugins()[1].get(name)
    return f"the impact law {name!r} of an installed package cannot be used ({broken})" if broken else ""


def law_of_record(name: str) -> ImpactLaw:
    """The law that checks records with a given name: the law of that name, or one with a rule of that name.

    Records of an unknown law are checked by the default law, so a log cannot avoid a check by its name.
    """
    laws = impact_laws()
    by_rule = (law for law in laws.values() if name in law.rules)
    return laws.get(name) or next(by_rule, laws["blend"])


@cache
def _plugins() -> tuple[dict[str, ImpactLaw], dict[str, str]]:
    """Laws of installed packages, and why others cannot be used; evaluated once per process.

    A broken package affects only the scenarios that name its law; so does a law with the name of a built-in one.
    """
    laws, broken = dict[str, ImpactLaw](), dict[str, str]()
    for entry_point in entry_points(group=GROUP):
        if entry_point.name in _BUILT_IN:
            broken[entry_point.name] = f"{entry_point.value} has the name of a built-in impact law; rename it"
            continue
        try:
            laws[entry_point.name] = _loaded(entry_point)
        except Exception as error:  # noqa: BLE001 (a package may fail in any way)
            broken[entry_point.name] = described(error)
    return laws, broken


def _loaded(entry_point: EntryPoint) -> ImpactLaw:
    cls = entry_point.load()
    if not (isinstance(cls, type) and ImpactLaw in cls.__mro__):
        raise TypeError(f"{entry_point.value} is not a subclass of ffsm_mj.impact.ImpactLaw")
    law: ImpactLaw = cls()
    if law.name != entry_point.name:
        raise TypeError(f"{entry_point.value}: the entry point must have the name of the law, {law.name!r}")
    return law
