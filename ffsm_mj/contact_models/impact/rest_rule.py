"""Rule (10): an impact brings a contact to rest if its next flight would be shorter than a time that the scenario states.

A contact that separates at speed u and is pressed at b is in flight for 2 u / b.

Accelerations that press the contacts of an impact together, by which the rest rule decides.

The gap accelerations at an impact follow from the velocities after a plastic impact of all closed contacts and from all
forces other than those of contacts: the current efforts, gravity, springs. Contact forces lambda >= 0 keep every gap
acceleration non-negative; with friction they satisfy Coulomb's conditions, where contacts that slip after the plastic impact
slide that way. The acceleration that presses contact i is -gap'' without its own force and with those of the others:
b_i = n . (G_ii lambda_i), without friction G_ii lambda_i.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.contact.proximity import Proximity, SecondRate
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.impact.resolution import (
    DEFAULT_LAW,
    ClosedPairs,
    Contact,
    Impact,
    LimitContact,
    contact_jacobian,
    contact_points,
    contact_rows,
    resolve,
)
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix, tangents
from ffsm_mj.tolerances import SOLVED


def pressing_accelerations(
    model: Any,
    data: Any,
    points: Sequence[tuple[UnilateralConstraint, Proximity, FloatArray]],
    impact: Impact,
    motion: Motion,
) -> FloatArray:
    """Acceleration b that presses each contact, m/s^2, (k,); zero for contacts that are not pressed.

    Args:
        model: MuJoCo model of the logged system.
        data: Its data before the impact, with the current efforts.
        points: All contact points, with their pairs.
        impact: The impact; only its contacts count.
        motion: The current motion.
    """
    contacts, plastic = impact.contacts, impact
    # Coriolis forces that press depend on velocities: those that remain once the contacts are at rest decide.
    if impact.law != DEFAULT_LAW or any(contact.restitution > 0.0 for contact in contacts):
        stopped = [replace(contact, restitution=0.0) for contact in contacts]
        plastic = resolve(motion.model, motion.data, stopped, constrained=motion.constrained)
    with _without_contacts(motion, plastic.after.qvel):
        rates = [pair.second_rate(model, data, near, point) for pair, near, point in points]
        rounding = np.array([rate.rounding for rate in rates])
        pressing = _with_friction(motion, contacts, rates) if any(contact.mu > 0.0 for contact in contacts) else None
        # Coulomb's conditions may have no solution (Painleve). Normal forces alone always have one, and only decide on rest.
        if pressing is None:
            pressing = _frictionless(motion, contacts, rates)
    # An acceleration of rounding would bring a contact in free motion to rest, although nothing presses it.
    return np.where(pressing > rounding, pressing, 0.0)


def _frictionless(motion: Motion, contacts: Sequence[Contact | LimitContact], rates: Sequence[SecondRate]) -> FloatArray:
    """G_ii lambda_i of normal forces alone, m/s^2, (k,)."""
    J = motion.constrained(np.stack([contact_jacobian(motion.model, motion.data, contact) for contact in contacts]))
    A = np.linalg.solve(np.linalg.cholesky(mass_matrix(motion.model, motion.data)), J.T).T
    # A plastic impact solves the same complementarity problem in velocities: any w with A w = gap'' gives its forces.
    w = np.linalg.lstsq(A, np.array([rate.value for rate in rates]), rcond=None)[0]
    return np.asarray(np.sum(A * A, axis=1) * least_norm(A, project(A, w)))


def _with_friction(
    motion: Motion, contacts: Sequence[Contact | LimitContact], rates: Sequence[SecondRate]
) -> FloatArray | None:
    """N . (G_ii lambda_i) of forces with friction, m/s^2, (k,); None if Coulomb's conditions have no solution."""
    from ffsm_mj.contact_models.impact.friction.coulomb import coulomb_forces

    across = [np.zeros((2, 3)) if isinstance(one, LimitContact) else tangents(np.asarray(one.normal)) for one in contacts]
    rows = [contact_rows(motion.model, motion.data, one, axes) for one, axes in zip(contacts, across, strict=True)]
    J = motion.constrained(np.concatenate(rows))
    A = np.linalg.solve(np.linalg.cholesky(mass_matrix(motion.model, motion.data)), J.T).T
    G, qvel = A @ A.T, motion.data.qvel
    b = np.concatenate([(rate.value, *(axes @ rate.acceleration)) for rate, axes in zip(rates, across, strict=True)])
    u = (J @ qvel).reshape(-1, 3)[:, 1:]
    # An impact leaves sticking contacts a slip of rounding.
    slips = np.hypot(u[:, 0], u[:, 1]) > SOLVED * (1.0 + np.abs(J * qvel).max(axis=1).reshape(-1, 3).max(axis=1))
    mu = np.array([contact.mu for contact in contacts])
    # No force presses a contact whose gap no motion changes.
    movable, forces = np.flatnonzero(J[::3].any(axis=1)), np.zeros((len(mu), 3))
    which = (3 * movable[:, None] + np.arange(3)).ravel()
    # Friction of a sliding contact opposes its slip, not its acceleration: the direction is known before the forces are.
    directions = np.where(slips[:, None], u, 0.0)[movable]
    forces[movable], residual = coulomb_forces(G[np.ix_(which, which)], b[which], mu[movable], directions)
    if residual > SOLVED:
        return None
    diagonal = G.reshape(len(mu), 3, len(mu), 3)[np.arange(len(mu)), 0, np.arange(len(mu))]
    return np.asarray(np.sum(diagonal * forces, axis=1))


@contextmanager
def _without_contacts(motion: Motion, qvel: FloatArray) -> Iterator[None]:
    """Context with the motion at other velocities, under all forces except those of contacts.

    ``qfrc_applied`` holds forces of the last stage: contact forces, which answer the state before the impact, and forces of
    contact models such as springs at the velocities before it. The latter are evaluated again, the former are left out.
    """
    data = motion.data
    before, pushed = data.qvel.copy(), data.qfrc_applied.copy()
    try:
        data.qfrc_applied.fill(0.0)
        _put(motion, qvel)
        motion.push_without_contacts(data)
        motion.path.on_event_located()
        yield
    finally:
        data.qfrc_applied[:] = pushed
        _put(motion, before)


def _put(motion: Motion, qvel: FloatArray) -> None:
    motion.data.qvel[:] = qvel
    mujoco.mj_forward(motion.model, motion.data)
    # With a grasped object the logged system follows the motion: second rates of gaps are evaluated on its data.
    motion.path.on_event_located()


@dataclass(frozen=True)
class RestRule:
    """When an impact brings a contact to rest.

    Attributes:
        interval_s: Flights shorter than this are omitted, s.
        speed_m_s: Contacts that separate slower than this come to rest too, m/s.
    """

    interval_s: float
    speed_m_s: float

    def least_speeds(self, pressing: FloatArray) -> FloatArray:
        """Separation speeds below which contacts pressed at these accelerations come to rest, m/s, (k,)."""
        return np.maximum(self.speed_m_s, 0.5 * self.interval_s * pressing)


@dataclass(frozen=True)
class RestingResult:
    """An impact under the rest rule.

    Attributes:
        impact: The resolved impact.
        used: Coefficient of restitution used for each contact: 0 if it comes to rest, (k,).
        pressing: Acceleration b that presses each contact, m/s^2, (k,).
        speeds: Separation speed that each contact at rest would have had without the rule, m/s, (k,); 0 for the others.
    """

    impact: Impact
    used: FloatArray
    pressing: FloatArray
    speeds: FloatArray


def resolve_resting(
    model: Any,
    data: Any,
    touching: ClosedPairs,
    rule: RestRule,
    resolve_with: Callable[[FloatArray], Impact],
    motion: Motion,
) -> RestingResult:
    """Resolve an impact, plastic for contacts whose next flight would be too short.

    A contact with e = 1 comes to rest only if it does not approach.

    Args:
        model: MuJoCo model of the logged system.
        data: Its data before the impact, with the current efforts.
        touching: Pairs in contact.
        rule: When a contact comes to rest.
        resolve_with: Resolves the impact of all contact points with given coefficients of restitution, (k,).
        motion: The current motion; bodies of the impacts are bodies of its model.
    """
    points = contact_points(touching)
    used = np.array([pair.restitution for pair, _, _ in points])
    impact = resolve_with(used)
    tolerance = np.array([near.rate_tolerance for _, near, _ in points])
    stated, speeds, pressing = used, np.zeros(len(points)), np.zeros(len(points))
    # An elastic ball never settles: with e = 1 the flights do not get shorter, and none may be omitted.
    if np.all((stated >= 1.0) & (impact.separation_speeds > tolerance)):
        return RestingResult(impact, used, pressing, speeds)
    pressing = pressing_accelerations(model, data, points, impact, motion)
    # A contact that comes to rest takes velocity from others, which may then come to rest too. At most all of them do.
    for _ in points:
        after = impact.separation_speeds
        # Rest by the rule needs a contact that is pressed, b > 0: without force its next flight, 2 u / b, never ends.
        rests = (after <= tolerance) | ((stated < 1.0) & (after < rule.least_speeds(pressing)))
        rests &= (pressing > 0.0) & (used > 0.0)
        if not rests.any():
            break
        # The speed without the rule goes into the record as the height and time of what was omitted.
        speeds = np.where(rests, np.maximum(after, 0.0), speeds)
        used = np.where(rests, 0.0, used)
        impact = resolve_with(used)
    return RestingResult(impact, used, pressing, speeds)
