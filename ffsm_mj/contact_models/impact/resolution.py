"""Resolution of an impact: rows of its contacts, impulses by an impact law (paper (15)-(18)), velocities after.

For one contact with normal n, common point p, J_n = n^T (J_b(p) - J_a(p)) and u = J_n qdot < 0, the built-in laws give the
impulse -(1 + e) u / (J_n M^-1 J_n^T), and qdot+ = qdot- + M^-1 J_n^T impulse. For e = 1 this solves the paper's momentum
equations (17) and energy equation (18). For the interface of impact laws see :mod:`ffsm_mj.contact_models.impact.law`.

A contact point of two bodies, or a joint at its limit, and its rows of the contact Jacobian.

Closed pairs and joint limits at an impact, and the interface through which persistent contact takes them over.

Impacts of a model with closed loops: rows of the contacts less what the loops hold.

Impacts with friction: normal and tangent rows of every contact are passed to an impact law that covers friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.joint_limit import TendonLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.law import ImpactLaw, ImpactProblem, friction_of, impact_law, impact_laws, solve_impact
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.loops.closed_loops import without_rounding
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix, momentum_matrix, tangents
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.tolerances import CONTACT_GAP_M, RANK

DEFAULT_LAW = "blend"
"""Law of :func:`resolve` unless another is named; at e = 0, without friction, its result is the plastic one."""


@dataclass(frozen=True)
class Contact:
    """Two bodies in contact at one point.

    Attributes:
        body_a: Body id of the first body; the impulse on it points along ``-normal``.
        body_b: Body id of the second body; the impulse on it points along ``normal``.
        point: Common contact point in world axes, (3,), m.
        normal: Unit normal from the first body to the second in world axes, (3,).
        restitution: Coefficient e: 1 elastic, 0 plastic, above 1 super-elastic (the paper's case c).
        mu: Coefficient of Coulomb friction, >= 0.
        compliance_ratio: Tangential over normal compliance, k_n / k_t, 1e-6 to 1e6, for laws that use it; 0: rigid across
            the normal.
    """

    body_a: int
    body_b: int
    point: FloatArray
    normal: FloatArray
    restitution: float = 1.0
    mu: float = 0.0
    compliance_ratio: float = 0.0


@dataclass(frozen=True)
class LimitContact:
    """A joint at one end of its range: the impulse acts on the joint alone, without friction.

    Attributes:
        dof: Degree of freedom of the hinge or slide joint.
        sign: 1 at the lower limit, -1 at the upper one: the row of the Jacobian is this times the unit vector of the dof.
        restitution: Coefficient e, 0 to 1.
        row: Row of the Jacobian of a tendon, whose degree of freedom is one of its tree, (nv,); empty for a joint.
    """

    dof: int
    sign: float
    restitution: float = 0.0
    row: tuple[float, ...] = ()
    mu: ClassVar[float] = 0.0
    compliance_ratio: ClassVar[float] = 0.0


def contact_jacobian(model: Any, data: Any, contact: Contact | LimitContact) -> FloatArray:
    """J_n = n^T (J_b(p) - J_a(p)), shape (nv,): the normal velocity of b relative to a; for a limit, the rate of its gap.

    Both bodies are evaluated at the one common point, so that the pair of impulses has no moment and L is conserved exactly.
    A row in which the two parts cancel to rounding is zero, as for two links whose hinge axis meets the normal.
    """
    if isinstance(contact, LimitContact):
        unit = np.eye(1, model.nv, contact.dof)[0]
        at_limit: FloatArray = np.array(contact.row) if contact.row else contact.sign * unit
        return at_limit
    jac_a, jac_b = _jacobians(model, data, contact)
    return _rows(np.asarray(contact.normal, dtype=np.float64)[None], jac_a, jac_b).reshape(-1)


def contact_rows(model: Any, data: Any, contact: Contact | LimitContact, tangents: FloatArray) -> FloatArray:
    """Velocity of b relative to a along the normal and two tangents, as rows of a Jacobian, (3, nv).

    The tangent rows of a joint limit are zero.

    Args:
        model: MuJoCo model.
        data: Its data, kinematics current.
        contact: The contact; its normal is the first direction.
        tangents: Two unit vectors across the normal in world axes, (2, 3).
    """
    if isinstance(contact, LimitContact):
        # A stop of a joint has no surface to slip on. Rows of zeros keep three rows for each contact, as the laws expect.
        return np.stack([contact_jacobian(model, data, contact), *np.zeros((2, model.nv))])
    jac_a, jac_b = _jacobians(model, data, contact)
    return _rows(np.vstack((np.asarray(contact.normal, dtype=np.float64), tangents)), jac_a, jac_b)


def _jacobians(model: Any, data: Any, contact: Contact) -> tuple[FloatArray, FloatArray]:
    """Jacobians of both bodies at the common point, (3, nv) each."""
    jac_a, jac_b = np.empty((3, model.nv)), np.empty((3, model.nv))
    point = np.asarray(contact.point, dtype=np.float64)
    mujoco.mj_jac(model, data, jac_a, None, point, contact.body_a)
    mujoco.mj_jac(model, data, jac_b, None, point, contact.body_b)
    return jac_a, jac_b


def _rows(directions: FloatArray, jac_a: FloatArray, jac_b: FloatArray) -> FloatArray:
    of_a, of_b = directions @ jac_a, directions @ jac_b
    terms = np.sqrt((of_a * of_a).sum(axis=1)) + np.sqrt((of_b * of_b).sum(axis=1))
    # What is left of two parts that cancel is rounding in a random direction, and the impulse along it 1e10 times too large.
    return without_rounding(directions @ (jac_b - jac_a), terms)


ClosedPairs = Sequence[tuple[UnilateralConstraint, Proximity]]
"""Pairs in contact and joints at a limit at one instant, each with its proximity; unions may have several patches."""


def contact_points(closed: ClosedPairs) -> list[tuple[UnilateralConstraint, Proximity, FloatArray]]:
    """All contact points with their pairs, world axes, m: the order of resolution, rest rule and records."""
    return [(pair, near, point) for pair, near in closed for point in near.points]


def closed_pairs(
    broad_phase: BroadPhase,
    scene: Scene,
    motion: Motion,
    known: Mapping[tuple[UnilateralConstraint, float], Proximity],
) -> ClosedPairs:
    """The pairs in contact at the state in ``data``, without those on one rigid body of a motion.

    Args:
        broad_phase: The pairs.
        scene: The logged system and its data.
        motion: The current motion.
        known: Proximities at this state, by the pair and 0.
    """
    model, data, pairs = scene.system.mj, scene.data, broad_phase.pairs
    # Geoms that a rigid grasp joins stay where they are to each other: their row would be zero, and no impulse acts.
    close = [pairs[i] for i in broad_phase.near(data) if pairs[i].geom_ids not in motion.disabled]
    near = [(pair, patch) for pair in close for patch in _patches(pair, model, data, known.get((pair, 0.0)))]
    # Roots of pairs that meet at one time differ by rounding. Taken one after the other, the result would depend on their
    # order, and a symmetric scene would break its symmetry.
    return [(pair, proximity) for pair, proximity in near if proximity.gap <= CONTACT_GAP_M]


def _patches(pair: UnilateralConstraint, model: Any, data: Any, known: Proximity | None) -> Sequence[Proximity]:
    """Patches of contact of a pair at the state in ``data``, which a known proximity may be."""
    return (known,) if known is not None and (pair.is_limit or pair.has_one_patch) else pair.proximities(model, data)


def as_contact(
    pair: UnilateralConstraint, near: Proximity, point: FloatArray, motion: Motion, restitution: float
) -> Contact | LimitContact:
    """A closed pair or joint limit as a contact in the coordinates of a motion."""
    if pair.is_limit:
        # The length of a tendon depends on several joints, so its row changes with the state; that of a joint is a unit
        # vector.
        row = pair.row(motion.model, motion.data, motion.dofs).tolist() if isinstance(pair, TendonLimit) else ()
        return LimitContact(motion.dofs[pair.dof], pair.sign, restitution, tuple(row))
    bodies = motion.bodies[pair.body_a], motion.bodies[pair.body_b]
    return Contact(*bodies, point, near.normal, restitution, pair.mu, pair.compliance_ratio)


def recall_points(pairs: Mapping[str, ContactPair], records: Sequence[Any], data: Any) -> None:
    """Let pairs take the contact points of logged records as theirs, at the state in ``data``; pairs by name."""
    for record in records:
        if (pair := pairs.get(getattr(record, "pair", ""))) is not None:
            pair.recall(data, np.array(record.point_m))


class PersistentContacts(Protocol):
    """Keeps pairs closed after an impact; impact detection skips the pairs that it holds."""

    def holds(self, pair: UnilateralConstraint) -> bool:
        """Whether it keeps this pair closed now."""

    def refusal(self, pair: UnilateralConstraint) -> str:
        """Why it cannot keep a pair closed; empty if it can."""

    def close(self, touching: ClosedPairs, *, struck: bool) -> None:
        """Take over the pairs that neither approach nor separate at the velocities in ``data``.

        Args:
            touching: The pairs in contact.
            struck: Whether an impact has just changed the velocities.
        """


Constrained = Callable[[FloatArray], FloatArray]
"""Rows of velocities less what closed loops hold, (m, nv); see ``Motion.constrained`` in :mod:`ffsm_mj.dynamics.motion`."""


def with_loops(J: FloatArray, qvel: FloatArray, constrained: Constrained | None) -> tuple[FloatArray, FloatArray]:
    """Rows and velocities of an impact problem in which loops stay closed.

    Rates of the loops drift by up to 1e-10 m/s before they are projected. The velocities returned have the speeds at the
    contacts that were seen there, so that a contact that approaches is one for the impact law too.

    Args:
        J: Rows of the contacts, (m, nv).
        qvel: Velocities before, (nv,).
        constrained: Rows less what the loops hold, the same object without loops; None without loops.
    """
    constrained_J = J if constrained is None else constrained(J)
    if constrained_J is J:
        return J, qvel
    # Speed at the contacts that the rows of the loops would have stopped: truncation since the last projection.
    drift = (J - constrained_J) @ qvel
    return constrained_J, qvel + np.linalg.lstsq(constrained_J, drift, rcond=RANK)[0]


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
    e, mu, ratios = (
        np.array([getattr(contact, name) for contact in placed]) for name in ("restitution", "mu", "compliance_ratio")
    )
    # Tangents depend on the normal alone, so that no choice depends on the order of contacts, or on the step before.
    axes = np.array([_tangents(contact) for contact in placed])
    J = np.concatenate([contact_rows(model, data, one, across) for one, across in zip(placed, axes, strict=True)])
    problem = ImpactProblem(M, *with_loops(J, qvel, constrained), e, mu, ratios)
    solution = solve_impact(law, problem)
    solved = friction_of(law, solution)
    # Only the change is transformed back from mass-weighted velocities: bodies without impulse keep theirs bit for bit.
    # L^-T A^T = M^-1 J^T, without an inverse of M.
    after = qvel + np.linalg.solve(problem.L.T, problem.A.T @ solved.impulses.ravel())
    back = np.argsort(order)

    def in_world(across: FloatArray) -> FloatArray:
        """Vectors along the tangents, (k, 2), in world axes and in the given order of contacts, (k, 3)."""
        return np.asarray(np.einsum("ki,kij->kj", across, axes)[back])

    friction = Friction(
        impulses=in_world(solved.impulses[:, 1:]),
        slip_before=in_world((J @ qvel).reshape(-1, 3)[:, 1:]),
        slip_after=in_world((J @ after).reshape(-1, 3)[:, 1:]),
        paths=tuple(solved.paths[i] for i in back),
        theta=solved.theta,
        residual=solved.residual,
        normal_work=solved.normal_work[back],
        friction_work=solved.friction_work[back],
        compression_work=solved.compression_work[back],
    )
    return ImpactOutcome(after, solved.impulses[back, 0], solution.rule or law.name, solution.status, friction)


def _tangents(contact: Contact | LimitContact) -> FloatArray:
    """Two unit vectors across the normal, (2, 3); zero for a joint limit, which has none."""
    return np.zeros((2, 3)) if isinstance(contact, LimitContact) else tangents(np.asarray(contact.normal))


def _sort_key(contact: Contact | LimitContact) -> tuple[float, ...]:
    """Sort key of a contact: joint limits come last."""
    if isinstance(contact, LimitContact):
        return math.inf, contact.dof, contact.sign, contact.restitution
    where = np.concatenate((contact.point, contact.normal)).tolist()
    return contact.body_a, contact.body_b, *where, contact.mu, contact.restitution


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
    law: str = DEFAULT_LAW,
    constrained: Constrained | None = None,
) -> Impact:
    """Resolve an impact at the configuration and velocity in ``data``, which keeps its velocity.

    Derived quantities in ``data`` are updated. Contacts that do not approach get an impulse only if others push them; those
    whose gap no motion changes get none.

    Args:
        model: Any MuJoCo model.
        data: Its state at the time of impact.
        contacts: All contact points, and joints at their limits.
        law: Name of the impact law: ``blend``, ``poisson``, ``newton``, ``compliant`` or an installed one. The built-in laws
            agree for one contact without friction. With friction, one contact is solved by ``stronge``, unless the law is
            ``compliant``; several contacts, for ``blend``, by ``coulomb``.
        constrained: Rows of velocities less what closed loops hold, (m, nv), as a function of the rows; see
            :meth:`~ffsm_mj.dynamics.motion.Motion.constrained`. None: there are no closed loops.

    Raises:
        UnsupportedContactError: The law does not cover these contacts.
        ValueError: No contacts, an unknown law, a negative mu, or a compliance ratio out of range.
    """
    try:
        named = impact_law(law)
    except LookupError as error:
        raise ValueError(str(error.args[0])) from None
    if not contacts:
        raise ValueError("an impact needs at least one contact")
    # So that NaN is refused too, for which every comparison is false.
    if not all(contact.mu >= 0.0 for contact in contacts):
        raise ValueError("mu, the coefficient of friction, must be at least 0")
    # Of elastic surfaces it is from 1 to 1.5. Far beyond, one spring swings too fast beside the other for double precision.
    if not all(ratio == 0.0 or 1e-6 <= ratio <= 1e6 for ratio in (contact.compliance_ratio for contact in contacts)):
        raise ValueError("compliance_ratio, k_n / k_t, must be 0 or from 1e-6 to 1e6")
    # Inertia and Jacobians must be those at the touch: those in ``data`` may belong to the end of the step.
    mujoco.mj_fwdPosition(model, data)
    M = mass_matrix(model, data)
    momentum_map = momentum_matrix(model, data, 0)
    before = np.array(data.qvel)
    J = np.stack([contact_jacobian(model, data, contact) for contact in contacts])
    # One contact with friction makes three rows of all: the tangential impulse changes the normal velocities of the others.
    if any(contact.mu > 0.0 for contact in contacts):
        outcome = resolve_with_friction(model, data, M, contacts, before, named, constrained)
    else:
        e = np.array([contact.restitution for contact in contacts])
        outcome = _frictionless(M, *with_loops(J, before, constrained), before, e, named)
    return Impact(
        contacts=tuple(contacts),
        impulses=outcome.impulses,
        # Speeds that bodies have, by their own rows; rows less those of the loops serve to find the impulses.
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
    problem = ImpactProblem(M, J, seen, e, *np.zeros((2, len(e))))
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
