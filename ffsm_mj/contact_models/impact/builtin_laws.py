"""The impact laws ``blend``, ``poisson`` and ``newton``: one closed form for one contact, three laws for several contacts.

The mathematics is in :mod:`ffsm_mj.contact_models.impact.laws` and, with friction, in
:mod:`ffsm_mj.contact_models.impact.friction`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.law import Coverage, ImpactLaw, ImpactProblem, ImpactSolution
from ffsm_mj.contact_models.impact.laws import FRICTIONLESS, impulse_of_one
from ffsm_mj.records.events import ImpactRecord


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
        """For one contact under Stronge's law, the works also satisfy the energetic definition of restitution."""
        yield from super().friction_residuals(event, problem, impulses)
        contact = event[0]
        if len(event) == 1 and contact.law == "stronge":
            yield max(contact.friction_work_J, 0.0)
            if contact.status != "wedged":  # e^2 = -W_restitution / W_compression; wedged: no restitution
                yield abs(contact.normal_work_J - (1.0 - contact.restitution_used**2) * contact.compression_work_J)

    def _with_friction(self, problem: ImpactProblem) -> ImpactSolution:
        # Imported only for contacts with friction: its solvers take time to load.
        from ffsm_mj.contact_models.impact.friction import impact_with_friction

        found = impact_with_friction(problem.A, problem.w, problem.mu, problem.restitution, self.name)
        return ImpactSolution(found.impulses[:, 0], found.status, found.law, found)


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
