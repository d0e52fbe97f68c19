"""Impulses and post-impact velocities of an impact, from an impact law (paper (15)-(18)).

For one contact with normal n, common point p, J_n = n^T (J_b(p) - J_a(p)) and u = J_n qdot < 0, the built-in laws give the
impulse -(1 + e) u / (J_n M^-1 J_n^T), and qdot+ = qdot- + M^-1 J_n^T impulse. For e = 1 this solves the paper's momentum
equations (17) and energy equation (18). For the interface of impact laws see :mod:`ffsm_mj.contact_models.impact.law`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.closed_loops import Constrained, with_loops
from ffsm_mj.contact_models.impact.contact import Contact, LimitContact, contact_jacobian
from ffsm_mj.contact_models.impact.installed_laws import impact_law, impact_laws
from ffsm_mj.contact_models.impact.law import ImpactLaw, ImpactProblem, solve_impact
from ffsm_mj.contact_models.impact.with_friction import Friction, ImpactOutcome, resolve_with_friction
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
        contacts: Contact points, and joints at their limits.
        impulses: Normal impulse at each contact in N s, >= 0, along the normal on b; of a hinge at its limit in N m s.
        approach_speeds: -u before at each contact in m/s, positive when approaching.
        separation_speeds: u after at each contact in m/s.
        before: Velocities, energy and momentum before the impact.
        after: The same after the impact.
        law: Law or rule that gave the result.
        status: ``ok``, or ``jammed`` if energy was lost because bodies are squeezed without clearance; with friction also
            ``energy_guard``, ``wedged`` and ``unconverged``, see :mod:`ffsm_mj.contact_models.impact.friction`.
        friction: Friction impulses, slip and works; None if no contact has friction.
    """

    contacts: tuple[Contact | LimitContact, ...]
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
        """Impulse on b at each contact in world axes, friction included, N s, (k, 3); zero for a joint at its limit."""
        normals = [np.zeros(3) if isinstance(contact, LimitContact) else contact.normal for contact in self.contacts]
        along = np.array([impulse * normal for impulse, normal in zip(self.impulses, normals, strict=True)])
        return along if self.friction is None else along + self.friction.impulses

    @property
    def energy_change_J(self) -> float:
        """Kinetic energy after minus before, <= 0 for e <= 1."""
        return self.after.kinetic_energy_J - self.before.kinetic_energy_J

    @property
    def momentum_change(self) -> FloatArray:
        """Change of (P, L about the origin) of the whole system: rounding, or the impulse of fixed bodies."""
        return self.after.momentum - self.before.momentum


def resolve(
    model: Any,
    data: Any,
    contacts: Sequence[Contact | LimitContact],
    law: str = "blend",
    constrained: Constrained | None = None,
) -> Impact:
    """Resolve an impact at the configuration and velocity in ``data``, which keeps its velocity.

    Derived quantities in ``data`` are updated. Contacts that do not approach get an impulse only if others push them; those
    whose gap no motion changes get none.

    Args:
        model: Any MuJoCo model.
        data: Its state at the time of impact.
        contacts: All contact points, and joints at their limits.
        law: Name of the impact law: ``blend``, ``poisson``, ``newton`` or an installed one. The built-in laws agree for one
            contact without friction. With friction, one contact is solved by ``stronge``; several contacts, for ``blend``,
            by ``coulomb``.
        constrained: Rows of velocities less what closed loops hold, (m, nv), as a function of the rows; see
            :meth:`~ffsm_mj.dynamics.motion.Motion.constrained`. None: there are no closed loops.

    Raises:
        UnsupportedContactError: The law does not cover these contacts.
        ValueError: No contacts, an unknown law, or a negative mu.
    """
    try:
        named = impact_law(law)
    except LookupError as error:
        raise ValueError(str(error.args[0])) from None
    if not contacts:
        raise ValueError("an impact needs at least one contact")
    if not all(contact.mu >= 0.0 for contact in contacts):
        raise ValueError("mu, the coefficient of friction, must be at least 0")
    mujoco.mj_fwdPosition(model, data)
    M = mass_matrix(model, data)
    momentum_map = momentum_matrix(model, data, 0)
    before = np.array(data.qvel)
    J = np.stack([contact_jacobian(model, data, contact) for contact in contacts])
    if any(contact.mu > 0.0 for contact in contacts):
        outcome = resolve_with_friction(model, data, M, contacts, before, named, constrained)
    else:
        e = np.array([contact.restitution for contact in contacts])
        outcome = _frictionless(M, *with_loops(J, before, constrained), before, e, named)
    return Impact(
        contacts=tuple(contacts),
        impulses=outcome.impulses,
        approach_speeds=-(J @ before),
        separation_speeds=J @ outcome.qvel,
        before=ImpactState(before, kinetic_energy(M, before), momentum_map @ before),
        after=ImpactState(outcome.qvel, kinetic_energy(M, outcome.qvel), momentum_map @ outcome.qvel),
        law=outcome.law,
        status=outcome.status,
        friction=outcome.friction,
    )


def _frictionless(
    M: FloatArray, J: FloatArray, seen: FloatArray, qvel: FloatArray, e: FloatArray, law: ImpactLaw
) -> ImpactOutcome:
    """Velocities and impulses of an impact without friction, from the rows of the normals, (k, nv).

    Args:
        M: Mass matrix, (nv, nv).
        J: The rows.
        seen: Velocities before with the speeds of the contacts along these rows, (nv,).
        qvel: Velocities before, (nv,).
        e: Coefficients of restitution, (k,).
        law: The impact law.
    """
    problem = ImpactProblem(M, J, seen, e, np.zeros(len(e)))
    solution = solve_impact(law, problem)
    # Only the change is transformed back from mass-weighted velocities: bodies without impulse keep theirs bit for bit.
    # One contact needs no factor of M: its response to a unit impulse is known.
    if len(J) == 1:
        change = problem.responses[0] * float(solution.impulses[0])
    else:
        change = np.linalg.solve(problem.L.T, problem.A.T @ solution.impulses)
    return ImpactOutcome(qvel + change, solution.impulses, solution.rule or law.name, solution.status, None)


def compare_laws(model: Any, data: Any, contacts: Sequence[Contact | LimitContact]) -> dict[str, Impact | str]:
    """Resolve one impact by every known law; the value is a message if the law does not cover it.

    Where the results differ, the outcome is a modelling choice.
    """
    out: dict[str, Impact | str] = {}
    for law in impact_laws():
        try:
            out[law] = resolve(model, data, contacts, law)
        except UnsupportedContactError as error:
            out[law] = str(error)
    return out
