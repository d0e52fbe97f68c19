"""Impacts with friction: normal and tangent rows of every contact are passed to an impact law that covers friction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.closed_loops import Constrained, with_loops
from ffsm_mj.contact_models.impact.contact import Contact, LimitContact, contact_rows
from ffsm_mj.contact_models.impact.law import ImpactLaw, ImpactProblem, friction_of, solve_impact


@dataclass(frozen=True)
class Friction:
    """Friction in an impact of k contacts.

    Attributes:
        impulses: Tangential impulse on b at each contact, world axes, N s, (k, 3).
        slip_before: Tangential velocity of b relative to a at each contact before, world axes, m/s, (k, 3).
        slip_after: The same after.
        paths: Sequence of ``slip``, ``stick`` and ``reverse slip`` of each contact.
        theta: Factor by which the energy guard reduced the restitution; 1 if it was not needed.
        residual: Residual of the law, relative to the contact speeds before.
        normal_work: Work of the normal impulses, J, (k,): for one contact the integral of u_n dp along its path.
        friction_work: Work of the tangential impulses, J, (k,); the sum of both is the change of kinetic energy.
        compression_work: Work of the normal impulses until the end of compression, J, (k,).
    """

    impulses: FloatArray
    slip_before: FloatArray
    slip_after: FloatArray
    paths: tuple[str, ...]
    theta: float
    residual: float
    normal_work: FloatArray
    friction_work: FloatArray
    compression_work: FloatArray


class ImpactOutcome(NamedTuple):
    """Outcome of a law: velocities (nv,), normal impulses (k,), name of the law, status, and friction, if any."""

    qvel: FloatArray
    impulses: FloatArray
    law: str
    status: str
    friction: Friction | None


def resolve_with_friction(
    model: Any,
    data: Any,
    M: FloatArray,
    contacts: Sequence[Contact | LimitContact],
    qvel: FloatArray,
    law: ImpactLaw,
    constrained: Constrained | None = None,
) -> ImpactOutcome:
    """Velocities and impulses of an impact in which at least one contact has mu > 0.

    The contacts are sorted by bodies and points first, so the result does not depend on the order in which they are given
    and a run repeats bit for bit.

    Args:
        model: MuJoCo model.
        data: Its data, kinematics current.
        M: Mass matrix, (nv, nv).
        contacts: All contact points.
        qvel: Velocities before, (nv,).
        law: The impact law.
        constrained: Rows less what closed loops hold, as a function of the rows; None without loops.

    Raises:
        UnsupportedContactError: The law does not cover friction, or a restitution is above 1.
        ValueError: A contact between bodies that cannot move along its normal.
    """
    order = sorted(range(len(contacts)), key=lambda i: _sort_key(contacts[i]))
    placed = [contacts[i] for i in order]
    e, mu = (np.array([getattr(contact, name) for contact in placed]) for name in ("restitution", "mu"))
    axes = np.array([_tangents(contact) for contact in placed])
    J = np.concatenate([contact_rows(model, data, each, across) for each, across in zip(placed, axes, strict=True)])
    problem = ImpactProblem(M, *with_loops(J, qvel, constrained), e, mu)
    solution = solve_impact(law, problem)
    found = friction_of(law, solution)
    # Only the change is transformed back from mass-weighted velocities: bodies without impulse keep theirs bit for bit.
    after = qvel + np.linalg.solve(problem.L.T, problem.A.T @ found.impulses.ravel())
    back = np.argsort(order)

    def in_world(across: FloatArray) -> FloatArray:
        """Vectors along the tangents, (k, 2), in world axes and in the given order of contacts, (k, 3)."""
        return np.asarray(np.einsum("ki,kij->kj", across, axes)[back])

    friction = Friction(
        impulses=in_world(found.impulses[:, 1:]),
        slip_before=in_world((J @ qvel).reshape(-1, 3)[:, 1:]),
        slip_after=in_world((J @ after).reshape(-1, 3)[:, 1:]),
        paths=tuple(found.paths[i] for i in back),
        theta=found.theta,
        residual=found.residual,
        normal_work=found.normal_work[back],
        friction_work=found.friction_work[back],
        compression_work=found.compression_work[back],
    )
    return ImpactOutcome(after, found.impulses[back, 0], solution.rule or law.name, solution.status, friction)


def _tangents(contact: Contact | LimitContact) -> FloatArray:
    """Two unit vectors across the normal, (2, 3); zero for a joint limit, which has none."""
    from ffsm_mj.contact_models.impact.friction import tangents  # its solvers take time to load

    return np.zeros((2, 3)) if isinstance(contact, LimitContact) else tangents(np.asarray(contact.normal))


def _sort_key(contact: Contact | LimitContact) -> tuple[float, ...]:
    """Sort key of a contact: joint limits come last."""
    if isinstance(contact, LimitContact):
        return math.inf, contact.dof, contact.sign, contact.restitution
    where = np.concatenate((contact.point, contact.normal)).tolist()
    return contact.body_a, contact.body_b, *where, contact.mu, contact.restitution
