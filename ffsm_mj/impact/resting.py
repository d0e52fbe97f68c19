"""Which contacts would last: rule (10), the next flight is shorter than a time that the scenario states.

At an impact the accelerations of the gaps follow from the velocities that a plastic impact of all touching contacts would
leave and from the efforts held. Where they press, contact forces lambda >= 0 answer so that no gap accelerates inwards;
b = G_ii lambda_i is the acceleration that contact i takes off its pair, -gap'' without it and with the forces of the others.
A contact that separates at u flies for 2 u / b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair, Proximity
from ffsm_mj.impact.laws import least_norm, project
from ffsm_mj.impact.resolution import Impact, contact_jacobian, resolve
from ffsm_mj.impact.touching import Touching, touching_points
from ffsm_mj.model.dynamics import mass_matrix
from ffsm_mj.motion.flight import WHOLE_STATE


@dataclass(frozen=True)
class RestRule:
    """When a contact counts as lasting.

    Attributes:
        interval_s: Flights shorter than this are none, s.
        speed_m_s: Nor is what separates slower than this, m/s.
    """

    interval_s: float
    speed_m_s: float

    def flight_is_none(self, speed: float, pressing: float) -> bool:
        """Whether a contact that separates at a speed and is pressed at an acceleration does not fly."""
        return speed < max(self.speed_m_s, 0.5 * pressing * self.interval_s)


@dataclass(frozen=True)
class Lasting:
    """A contact that would last: its pair, the speed at which it would separate in m/s, how it is pressed in m/s^2."""

    pair: ContactPair
    speed: float
    pressing: float


def lasting_contact(model: Any, data: Any, touching: Touching, impact: Impact, rule: RestRule) -> Lasting | None:
    """The contact of an impact that lasts, the one that is pressed most where there are several; None where all fly on.

    An elastic contact never comes to rest, except where it does not even approach.

    Args:
        model: MuJoCo model.
        data: Its data at the impact, before it, with the efforts held.
        touching: Pairs in contact.
        impact: The impact of all their points, resolved.
        rule: What counts as lasting.
    """
    points = touching_points(touching)
    speeds = impact.separation_speeds.tolist()
    if not any(pair.restitution < 1.0 or speed <= near.still for (pair, near, _), speed in zip(points, speeds, strict=True)):
        return None
    pressing = _pressing(model, data, points, impact)
    found = None
    for (pair, near, _), b, speed in zip(points, pressing.tolist(), speeds, strict=True):
        still = speed <= near.still
        if b > 0.0 and (still or (pair.restitution < 1.0 and rule.flight_is_none(speed, b))):
            found = Lasting(pair, 0.0 if still else speed, b) if found is None or b > found.pressing else found
    return found


def _pressing(
    model: Any, data: Any, points: Sequence[tuple[ContactPair, Proximity, FloatArray]], impact: Impact
) -> FloatArray:
    """The b of each contact in m/s^2, (k,); zero where it is not pressed."""
    plastic = resolve(model, data, [replace(contact, restitution=0.0) for contact in impact.contacts])
    scratch = mujoco.MjData(model)
    state = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE))
    mujoco.mj_getState(model, data, state, WHOLE_STATE)
    mujoco.mj_setState(model, scratch, state, WHOLE_STATE)
    scratch.qvel[:] = plastic.after.qvel
    mujoco.mj_forward(model, scratch)
    rates = [pair.second_rate(model, scratch, near, point) for pair, near, point in points]
    free, rounding = np.array([[rate.value, rate.rounding] for rate in rates]).T
    J = np.stack([contact_jacobian(model, scratch, contact) for contact in impact.contacts])
    A = np.linalg.solve(np.linalg.cholesky(mass_matrix(model, scratch)), J.T).T
    # The laws of impact solve the same problem in velocities: any w with A w = gap'' will do.
    w = np.linalg.lstsq(A, free, rcond=None)[0]
    pressing = np.sum(A * A, axis=1) * least_norm(A, project(A, w))
    return np.where(pressing > rounding, pressing, 0.0)
