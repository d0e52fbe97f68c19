"""Rule (10): an impact brings a contact to rest if its next flight would be shorter than a time that the scenario states.

The gap accelerations at an impact follow from the velocities after a plastic impact of all closed contacts and from all
forces other than those of contacts: the current efforts, gravity, springs. Contact forces lambda >= 0 keep every gap
acceleration non-negative. b_i = G_ii lambda_i is the acceleration that presses contact i: -gap'' without its force and with
those of the other contacts. A contact that separates at speed u is in flight for 2 u / b.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.closed_pairs import ClosedPairs, contact_points
from ffsm_mj.contact_models.impact.contact import contact_jacobian
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.impact.resolution import Impact, resolve
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix


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
    if np.all((stated >= 1.0) & (impact.separation_speeds > tolerance)):
        return RestingResult(impact, used, pressing, speeds)
    pressing = _pressing(model, data, points, impact, motion)
    # A contact that comes to rest takes velocity from others, which may then come to rest too. At most all of them do.
    for _ in points:
        after = impact.separation_speeds
        rests = (after <= tolerance) | ((stated < 1.0) & (after < rule.least_speeds(pressing)))
        rests &= (pressing > 0.0) & (used > 0.0)
        if not rests.any():
            break
        speeds = np.where(rests, np.maximum(after, 0.0), speeds)
        used = np.where(rests, 0.0, used)
        impact = resolve_with(used)
    return RestingResult(impact, used, pressing, speeds)


def _pressing(
    model: Any,
    data: Any,
    points: Sequence[tuple[UnilateralConstraint, Proximity, FloatArray]],
    impact: Impact,
    motion: Motion,
) -> FloatArray:
    """Acceleration b that presses each contact, m/s^2, (k,); zero for contacts that are not pressed."""
    plastic_contacts = [replace(contact, restitution=0.0) for contact in impact.contacts]
    plastic = resolve(motion.model, motion.data, plastic_contacts)
    with _without_contacts(motion, plastic.after.qvel):
        rates = [pair.second_rate(model, data, near, point) for pair, near, point in points]
        free, rounding = np.array([[rate.value, rate.rounding] for rate in rates]).T
        J = np.stack([contact_jacobian(motion.model, motion.data, contact) for contact in impact.contacts])
        A = np.linalg.solve(np.linalg.cholesky(mass_matrix(motion.model, motion.data)), J.T).T
    # A plastic impact solves the same complementarity problem in velocities: any w with A w = gap'' gives its forces.
    w = np.linalg.lstsq(A, free, rcond=None)[0]
    pressing = np.sum(A * A, axis=1) * least_norm(A, project(A, w))
    return np.where(pressing > rounding, pressing, 0.0)


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
        if motion.pushes:
            for push in motion.pushes:
                push(data)
            _put(motion, qvel)
        yield
    finally:
        data.qfrc_applied[:] = pushed
        _put(motion, before)


def _put(motion: Motion, qvel: FloatArray) -> None:
    motion.data.qvel[:] = qvel
    mujoco.mj_forward(motion.model, motion.data)
    motion.path.on_event_located()
