"""Impulses over a step in which redundant contacts redistribute their load.

The stages of a step constrain the active set chosen at its start. If contacts are redundant, their forces are of least norm,
and one of them may become negative without changing the motion. The logged force of a pair is of least norm among the
non-negative ones; as a function of time it has a kink where a contact enters or leaves that distribution. Quadrature over a
kink is only second order, so the step is split there, and each piece is integrated by Simpson's rule along its path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.decision import Decision
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.dynamics.motion import Motion

_SHARE_CHANGE = 1e-9
"""Relative change of a force at the end of a step below which its kink came so late that the impulse error is rounding."""
_OTHER_MOTION = 1e-8
"""Generalised force of a redistribution over that of its parts: they cancel to rounding, which a redundant set amplifies."""
_ALONG_JOINT = np.array((1.0, 0.0, 0.0))
"""Direction that stands for the joint of a limit, whose force has none in space."""
_SHARP = 1e-6
"""Accuracy of a kink as a fraction of the step; the error of the impulse is of the order of its square."""


class Pieces(NamedTuple):
    """Quadrature nodes and weights for impulses along a step.

    Attributes:
        contact_points: The contact points.
        stages: Their forces at each node.
        weights_s: Weight of each node, s.
    """

    contact_points: tuple[ContactPoint, ...]
    stages: list[Stage]
    weights_s: list[float]


def pieces(closed: ActiveContactSet, motion: Motion, duration_s: float) -> Pieces | None:
    """Quadrature of the last step, split at the kinks of the forces; None if there are none.

    Args:
        closed: The closed contacts, at the end of the step.
        motion: The current motion; its state is restored.
        duration_s: Length of the step.
    """
    if closed.has_friction or sum(map(bool, closed.by_pair.values())) < 2 or not _shares_change(closed):
        return None
    path, data = motion.path, motion.data
    kept = path.at_s, data.qpos.copy(), data.qvel.copy(), list(closed.stages)
    path.at_s = math.nan
    ends = [0.0, *_kinks(closed, motion, duration_s), duration_s]
    stages, weights = [], []
    for start, end in pairwise(ends):
        for at, part in ((start, 1.0), (0.5 * (start + end), 4.0), (end, 1.0)):
            path.move_to(at)
            stages.append(_stage(closed, data.qvel))
            weights.append((end - start) * part / 6.0)
    path.at_s, qpos, qvel, closed.stages[:] = kept
    if not (np.array_equal(qpos, data.qpos) and np.array_equal(qvel, data.qvel)):
        motion.go_to(qpos, qvel)  # a log replay continues from the logged state, which the path reproduces only to rounding
    return Pieces(closed.contact_points, stages, weights)


def _shares_change(closed: ActiveContactSet) -> bool:
    """Whether redundant contacts redistribute their load: active set and non-negative forces, of equal effect, differ."""
    decision = closed.decide()
    assert isinstance(decision, Decision)
    held = decision.problem.bilateral_forces([decision.contact_points.index(contact) for contact in closed.pressing])
    if decision.forces is held:
        return False
    apart = np.abs(decision.forces - held)
    allowed = _SHARE_CHANGE * (1.0 + float(np.abs(decision.forces).max(initial=0.0)))
    if apart.max(initial=0.0) <= allowed:
        return False
    # Redistribution leaves the motion as it is. A contact that opens within a trial step does not: the step as it was made
    # has a tensile force there, which is what moved the bodies, and the step will end at the opening.
    effect, J = decision.forces - held, decision.rows.J
    if np.abs(effect.dot(J)).max() > _OTHER_MOTION * np.abs(effect).dot(np.abs(J)).max():
        return False
    # Redistribution among the points of one pair does not change its resultant, which alone is logged.
    changes: dict[object, FloatArray] = {}
    for contact, here, change in zip(
        decision.contact_points, decision.rows.states, (decision.forces - held).tolist(), strict=True
    ):
        along = _ALONG_JOINT if isinstance(contact.pair, JointLimit) else here.normal
        changes[contact.pair] = changes.get(contact.pair, np.zeros(3)) + change * along
    return any(math.hypot(*change.tolist()) > allowed for change in changes.values())


def _kinks(closed: ActiveContactSet, motion: Motion, duration_s: float) -> list[float]:
    """Times at which the set of contacts with force changes, s since the start of the step."""
    last, found = _pressing(closed, motion, duration_s), list[float]()
    here = _pressing(closed, motion, 0.0)
    while here != last and len(found) <= len(closed.contact_points):
        low, high = (found or [0.0])[-1], duration_s
        while high - low > _SHARP * duration_s:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _pressing(closed, motion, middle) == here else (low, middle)
        found.append(high)
        here = _pressing(closed, motion, high)
    return found


def _pressing(closed: ActiveContactSet, motion: Motion, time_s: float) -> Sequence[int]:
    motion.path.move_to(time_s)
    return closed.decide().pressing


def _stage(closed: ActiveContactSet, rates: FloatArray) -> Stage:
    """Non-negative contact forces at the current state of the motion."""
    decision = closed.decide()
    return Stage(decision.rows, decision.forces, decision.forces.dot(decision.rows.J) * rates)
