"""Impulse and velocities after an impact: momentum and energy resolved at once (paper (15)-(18)).

One contact with normal n and common point p, J_n = n^T (J_b(p) - J_a(p)), u = J_n qdot < 0: the impulse is
-(1 + e) u / (J_n M^-1 J_n^T) and qdot+ = qdot- + M^-1 J_n^T impulse. For e = 1 this is the solution of the paper's
momentum equations (17) and energy equation (18). This is what the built-in laws answer for one contact; the impulses of any
impact come from an impact law, see :mod:`ffsm_mj.contact_models.impact.law`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.contact import Contact, contact_jacobian
from ffsm_mj.contact_models.impact.installed_laws import impact_law, impact_laws
from ffsm_mj.contact_models.impact.law import ImpactLaw, ImpactProblem, solve_impact
from ffsm_mj.contact_models.impact.laws import IMMOVABLE
from ffsm_mj.contact_models.impact.with_friction import Answer, Friction, resolve_with_friction
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix, momentum_matrix
from ffsm_mj.errors import UnsupportedContactError


@dataclass(frozen=True)
class ImpactState:
    """One side of an impact: generalised velocities (nv,), kinetic energy in J and (P, L about the origin), (6,)."""

    qvel: FloatArray
    kinetic_energy_J: float
    momentum: FloatArray


@dataclass(frozen=True)
class Impact:
    """A resolved impact.

    Attributes:
        contacts: What touched.
        impulses: Normal impulse at each contact in N s, >= 0, along the normal on b.
        approach_speeds: -u before at each contact in m/s, positive when approaching.
        separation_speeds: u after at each contact in m/s.
        before: Velocities, energy and momentum before the impact.
        after: The same after the impact.
        law: Law that made the result.
        status: How it went: ``ok``; ``jammed``: bodies squeezed without clearance, so that energy was lost;
            with friction also ``energy_guard``, ``wedged`` and ``unconverged``, see
            :mod:`ffsm_mj.contact_models.impact.friction`.
        friction: What friction did; None where no contact has any.
    """

    contacts: tuple[Contact, ...]
    impulses: FloatArray
    approach_speeds: FloatArray
    separation_speeds: FloatArray
    before: ImpactState
    after: ImpactState
    law: str
    status: str
    friction: Friction | None = None

    @property
    def vectors(self) -> FloatArray:
        """Impulse on b at each contact in world axes, friction included, N s, (k, 3)."""
        along = np.array([impulse * contact.normal for impulse, contact in zip(self.impulses, self.contacts, strict=True)])
        return along if self.friction is None else along + self.friction.impulses

    @property
    def energy_change_J(self) -> float:
        """Kinetic energy after minus before, <= 0 for e <= 1."""
        return self.after.kinetic_energy_J - self.before.kinetic_energy_J

    @property
    def momentum_change(self) -> FloatArray:
        """(P, L about the origin) of everything, after minus before: rounding, or what a body that cannot move gave."""
        return self.after.momentum - self.before.momentum


def resolve(model: Any, data: Any, contacts: Sequence[Contact], law: str = "blend") -> Impact:
    """Resolve an impact at the configuration and velocity in ``data``; nothing is written to ``data.qvel``.

    Derived quantities in ``data`` are refreshed. Contacts that do not approach get no impulse unless others push them.

    Args:
        model: Any MuJoCo model, composed by this package or not.
        data: Its state at the instant of impact.
        contacts: All touching points.
        law: Name of the impact law: ``blend``, ``poisson``, ``newton`` or an installed one. The built-in laws agree for one
            contact without friction; with friction one is solved by ``stronge``, and several by ``coulomb`` for ``blend``.

    Raises:
        UnsupportedContactError: The law does not cover these contacts.
        ValueError: No contacts, an unknown law, a negative mu, or bodies that cannot move along their normal.
    """
    try:
        named = impact_law(law)
    except LookupError as error:
        raise ValueError(str(error.args[0])) from None
    if not contacts:
        raise ValueError("an impact needs at least one contact")
    if not all(contact.mu >= 0.0 for contact in contacts):
        raise ValueError("mu, the coefficient of friction, is at least 0")
    mujoco.mj_fwdPosition(model, data)
    M = mass_matrix(model, data)
    momentum_map = momentum_matrix(model, data, 0)
    before = np.array(data.qvel)
    J = np.stack([contact_jacobian(model, data, contact) for contact in contacts])
    if any(contact.mu > 0.0 for contact in contacts):
        answer = resolve_with_friction(model, data, M, contacts, before, named)
    else:
        answer = _frictionless(M, J, before, np.array([contact.restitution for contact in contacts]), named)
    return Impact(
        contacts=tuple(contacts),
        impulses=answer.impulses,
        approach_speeds=-(J @ before),
        separation_speeds=J @ answer.qvel,
        before=ImpactState(before, kinetic_energy(M, before), momentum_map @ before),
        after=ImpactState(answer.qvel, kinetic_energy(M, answer.qvel), momentum_map @ answer.qvel),
        law=answer.law,
        status=answer.status,
        friction=answer.friction,
    )


def _frictionless(M: FloatArray, J: FloatArray, qvel: FloatArray, e: FloatArray, law: ImpactLaw) -> Answer:
    """Velocities and impulses by a law, from the rows of the normals, (k, nv)."""
    problem = ImpactProblem(M, J, qvel, e, np.zeros(len(e)))
    if len(J) == 1:
        if problem.speeds[0] >= 0.0:  # nothing collides, so no law is asked
            return Answer(qvel, np.zeros(1), law.name, "ok", None)
        if problem.inverse_masses[0] <= 0.0:
            raise ValueError(IMMOVABLE)
    elif np.any(np.linalg.norm(problem.A, axis=1) == 0.0):
        raise ValueError(IMMOVABLE)
    solution = solve_impact(law, problem)
    # The change, not the state, is brought back from mass-weighted velocities: what nothing pushes stays as it was.
    # One contact needs no factor of M: its response to a unit impulse is known.
    if len(J) == 1:
        change = problem.responses[0] * float(solution.impulses[0])
    else:
        change = np.linalg.solve(problem.L.T, problem.A.T @ solution.impulses)
    return Answer(qvel + change, solution.impulses, solution.rule or law.name, solution.status, None)


def compare_laws(model: Any, data: Any, contacts: Sequence[Contact]) -> dict[str, Impact | str]:
    """The same impact under every law, or why a law does not cover it.

    Where the answers differ the outcome is a modelling choice, which the laws make differently.
    """
    out: dict[str, Impact | str] = {}
    for law in impact_laws():
        try:
            out[law] = resolve(model, data, contacts, law)
        except UnsupportedContactError as error:
            out[law] = str(error)
    return out
