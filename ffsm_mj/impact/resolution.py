"""Impulse and velocities after a frictionless impact: momentum and energy resolved at once (paper (15)-(18)).

One contact with normal n and common point p, J_n = n^T (J_b(p) - J_a(p)), u = J_n qdot < 0: the impulse is
-(1 + e) u / (J_n M^-1 J_n^T) and qdot+ = qdot- + M^-1 J_n^T impulse. For e = 1 this is the solution of the paper's
momentum equations (17) and energy equation (18). Several contacts at one instant go by a law of :mod:`ffsm_mj.impact.laws`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact.laws import IMMOVABLE, LAWS, reflect
from ffsm_mj.model.dynamics import kinetic_energy, mass_matrix, momentum_matrix

_CANCELLED = 1e-12
"""A contact row below this share of those of its bodies is the rounding of their difference, some 1e-16."""


@dataclass(frozen=True)
class Contact:
    """Two bodies touching at a point.

    Attributes:
        body_a: Body id of the first body; the impulse on it points along ``-normal``.
        body_b: Body id of the second body; the impulse on it points along ``normal``.
        point: Common contact point in world axes, (3,), m.
        normal: Unit normal from the first body to the second in world axes, (3,).
        restitution: Coefficient e: 1 elastic, 0 plastic, above 1 super-elastic (the paper's case c).
    """

    body_a: int
    body_b: int
    point: FloatArray
    normal: FloatArray
    restitution: float = 1.0


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
        jammed: Bodies squeezed without clearance: no elastic answer exists, energy was lost.
    """

    contacts: tuple[Contact, ...]
    impulses: FloatArray
    approach_speeds: FloatArray
    separation_speeds: FloatArray
    before: ImpactState
    after: ImpactState
    law: str
    jammed: bool

    @property
    def energy_change_J(self) -> float:
        """Kinetic energy after minus before, <= 0 for e <= 1."""
        return self.after.kinetic_energy_J - self.before.kinetic_energy_J

    @property
    def momentum_change(self) -> FloatArray:
        """(P, L about the origin) of everything, after minus before: rounding, or what a body that cannot move gave."""
        return self.after.momentum - self.before.momentum


def contact_jacobian(model: Any, data: Any, contact: Contact) -> FloatArray:
    """J_n = n^T (J_b(p) - J_a(p)), shape (nv,): the normal velocity of b relative to a.

    Both bodies are evaluated at the one common point, so that the impulse pair has no moment and L is exact. A row in which
    the two cancel to rounding, as those of links about a hinge that the normal goes through, is zero.
    """
    jac_a, jac_b = np.empty((3, model.nv)), np.empty((3, model.nv))
    point = np.asarray(contact.point, dtype=np.float64)
    mujoco.mj_jac(model, data, jac_a, None, point, contact.body_a)
    mujoco.mj_jac(model, data, jac_b, None, point, contact.body_b)
    normal = np.asarray(contact.normal, dtype=np.float64)
    row: FloatArray = normal @ (jac_b - jac_a)
    size = np.linalg.norm(normal @ jac_a) + np.linalg.norm(normal @ jac_b)
    return row if np.linalg.norm(row) > _CANCELLED * size else np.zeros_like(row)


def resolve(model: Any, data: Any, contacts: Sequence[Contact], law: str = "blend") -> Impact:
    """Resolve an impact at the configuration and velocity in ``data``; nothing is written to ``data.qvel``.

    Derived quantities in ``data`` are refreshed. Contacts that do not approach get no impulse unless others push them.

    Args:
        model: Any MuJoCo model, composed by this package or not.
        data: Its state at the instant of impact.
        contacts: All touching points.
        law: What rules where several contacts meet: ``blend``, ``poisson`` or ``newton``; see :mod:`ffsm_mj.impact.laws`.

    Raises:
        UnsupportedContactError: The law does not cover these contacts.
        ValueError: No contacts, an unknown law, or a contact between bodies that cannot move along its normal.
    """
    if law not in LAWS:
        raise ValueError(f"unknown impact law {law!r}; allowed: {', '.join(LAWS)}")
    if not contacts:
        raise ValueError("an impact needs at least one contact")
    mujoco.mj_fwdPosition(model, data)
    M = mass_matrix(model, data)
    momentum_map = momentum_matrix(model, data, 0)
    before = np.array(data.qvel)
    J = np.stack([contact_jacobian(model, data, contact) for contact in contacts])
    e = np.array([contact.restitution for contact in contacts])
    after, impulses, jammed = _velocities(M, J, before, e, law)
    return Impact(
        contacts=tuple(contacts),
        impulses=impulses,
        approach_speeds=-(J @ before),
        separation_speeds=J @ after,
        before=ImpactState(before, kinetic_energy(M, before), momentum_map @ before),
        after=ImpactState(after, kinetic_energy(M, after), momentum_map @ after),
        law=law,
        jammed=jammed,
    )


def _velocities(
    M: FloatArray, J: FloatArray, qvel: FloatArray, e: FloatArray, law: str
) -> tuple[FloatArray, FloatArray, bool]:
    """Velocities after, impulses, and whether the bodies are jammed."""
    if len(J) == 1:
        if J[0] @ qvel >= 0.0:
            return qvel, np.zeros(1), False
        after, impulse = reflect(M, J[0], qvel, float(e[0]))
        return after, np.array([impulse]), False
    if e.max() > 1.0:
        raise UnsupportedContactError("super-elastic impacts (e > 1) are for one contact at a time")
    L = np.linalg.cholesky(M)
    A = np.linalg.solve(L, J.T).T
    if np.any(np.linalg.norm(A, axis=1) == 0.0):
        raise ValueError(IMMOVABLE)
    result = LAWS[law](A, L.T @ qvel, e)
    # The change, not the state, is brought back from mass-weighted velocities: what nothing pushes stays as it was.
    change = np.linalg.solve(L.T, A.T @ result.impulses)
    return qvel + change, result.impulses, result.jammed


def compare_laws(model: Any, data: Any, contacts: Sequence[Contact]) -> dict[str, Impact | str]:
    """The same impact under every law, or why a law does not cover it.

    Where the answers differ the outcome is a modelling choice, which the laws make differently.
    """
    out: dict[str, Impact | str] = {}
    for law in LAWS:
        try:
            out[law] = resolve(model, data, contacts, law)
        except UnsupportedContactError as error:
            out[law] = str(error)
    return out
