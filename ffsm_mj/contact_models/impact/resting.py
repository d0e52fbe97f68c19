"""Which contacts come to rest: rule (10), the next flight is shorter than a time that the scenario states.

At an impact the accelerations of the gaps follow from the velocities that a plastic impact of all touching contacts would
leave and from what pushes there besides contacts: the efforts held, gravity, springs. Where they press, contact forces
lambda >= 0 answer so that no gap accelerates inwards; b = G_ii lambda_i is the acceleration that contact i takes
off its pair, -gap'' without it and with the forces of the others.
A contact that separates at u flies for 2 u / b.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.contact import contact_jacobian
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.impact.resolution import Impact, resolve
from ffsm_mj.contact_models.impact.touching import Touching, touching_points
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix


@dataclass(frozen=True)
class RestRule:
    """When a contact counts as lasting.

    Attributes:
        interval_s: Flights shorter than this are none, s.
        speed_m_s: Nor is what separates slower than this, m/s.
    """

    interval_s: float
    speed_m_s: float

    def least_speeds(self, pressing: FloatArray) -> FloatArray:
        """Contacts pressed at these accelerations that separate slower do not fly, m/s, (k,)."""
        return np.maximum(self.speed_m_s, 0.5 * self.interval_s * pressing)


@dataclass(frozen=True)
class RestingResult:
    """An impact, and which of its contacts come to rest in it.

    Attributes:
        impact: Resolved.
        used: Coefficient of restitution of each contact that made it so: 0 where one comes to rest, (k,).
        pressing: The b of each, m/s^2, (k,).
        speeds: Speed at which each would have separated had it not come to rest, m/s, (k,); 0 where it flies on.
    """

    impact: Impact
    used: FloatArray
    pressing: FloatArray
    speeds: FloatArray


def resolve_resting(
    model: Any,
    data: Any,
    touching: Touching,
    rule: RestRule,
    resolve_with: Callable[[FloatArray], Impact],
    motion: Motion,
) -> RestingResult:
    """Resolve an impact, plastic where a contact would fly for too short a time.

    A contact with e = 1 never comes to rest, except where it does not even approach; one that rests may let others rest.

    Args:
        model: MuJoCo model of the system.
        data: Its data at the impact, before it, with the efforts held.
        touching: Pairs in contact.
        rule: What counts as lasting.
        resolve_with: Resolves the impact of all their points with a coefficient of restitution for each.
        motion: What moves and stands for it; the bodies of its impacts are those of it.
    """
    points = touching_points(touching)
    used = np.array([pair.restitution for pair, _, _ in points])
    impact = resolve_with(used)
    still = np.array([near.rate_tolerance for _, near, _ in points])
    stated, speeds, pressing = used, np.zeros(len(points)), np.zeros(len(points))
    if np.all((stated >= 1.0) & (impact.separation_speeds > still)):
        return RestingResult(impact, used, pressing, speeds)
    pressing = _pressing(model, data, points, impact, motion)
    for _ in points:
        after = impact.separation_speeds
        rests = (after <= still) | ((stated < 1.0) & (after < rule.least_speeds(pressing)))
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
    points: Sequence[tuple[ContactPair, Proximity, FloatArray]],
    impact: Impact,
    motion: Motion,
) -> FloatArray:
    """The b of each contact in m/s^2, (k,); zero where it is not pressed."""
    plastic_contacts = [replace(contact, restitution=0.0) for contact in impact.contacts]
    plastic = resolve(motion.model, motion.data, plastic_contacts)
    with _without_contacts(motion, plastic.after.qvel):
        rates = [pair.second_rate(model, data, near, point) for pair, near, point in points]
        free, rounding = np.array([[rate.value, rate.rounding] for rate in rates]).T
        J = np.stack([contact_jacobian(motion.model, motion.data, contact) for contact in impact.contacts])
        A = np.linalg.solve(np.linalg.cholesky(mass_matrix(motion.model, motion.data)), J.T).T
    # The laws of impact solve the same problem in velocities: any w with A w = gap'' will do.
    w = np.linalg.lstsq(A, free, rcond=None)[0]
    pressing = np.sum(A * A, axis=1) * least_norm(A, project(A, w))
    return np.where(pressing > rounding, pressing, 0.0)


@contextmanager
def _without_contacts(motion: Motion, qvel: FloatArray) -> Iterator[None]:
    """What moves, and what follows it, at other velocities under all forces but those of contacts.

    What ``qfrc_applied`` holds is of the last stage: forces of contacts that answer what was before the impact, and of
    springs at the velocities before it. Who depends on the state alone is asked anew, who answers is left out.
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
