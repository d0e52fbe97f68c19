"""Impulses over a step in which pairs that bear together share their load anew.

In the stages of a step the contacts that pressed as it began are held, and where they are redundant their shares are of
least norm, even where one of them would pull by then: the motion is the same. The share of a pair is of least norm among
those that only push, which has a kink where a contact ceases to have one, or gets one. A quadrature over a kink is good to
the second order only, so the step is cut there: each piece is integrated by Simpson's rule, along the path of the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.dynamics.motion import Motion

_SHARED_ANEW = 1e-9
"""Of the forces: a share that differs by less at the end of a step has had its kink so late that its impulse is rounding."""
_SHARP = 1e-6
"""Of a step: a kink is known this well, and the impulse is good to the square of it."""


class Pieces(NamedTuple):
    """Forces along a step, and how they add up to impulses.

    Attributes:
        touches: Whose forces they are.
        stages: What they are at some instants.
        weights_s: Time that each of them counts for.
    """

    touches: tuple[ContactPoint, ...]
    stages: list[Stage]
    weights_s: list[float]


def pieces(closed: ActiveContactSet, motion: Motion, duration_s: float) -> Pieces | None:
    """The forces in a step that has just been made, cut where shares have kinks; None where they have none.

    Args:
        closed: The contacts, at the end of the step.
        motion: What has moved; it is left where it is.
        duration_s: Length of the step.
    """
    if sum(map(bool, closed.by_pair.values())) < 2 or not _shared_anew(closed):
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
        motion.go_to(qpos, qvel)  # ``analyze`` goes on from the state of the log
    return Pieces(closed.touches, stages, weights)


def _shared_anew(closed: ActiveContactSet) -> bool:
    """Whether some pair has another share at the end of a step than what was held in it would give it."""
    decision = closed.decide()
    held = decision.problem.held([decision.touches.index(touch) for touch in closed.pressing])
    apart = np.abs(decision.forces - held)
    allowed = _SHARED_ANEW * (1.0 + float(np.abs(decision.forces).max(initial=0.0)))
    if apart.max(initial=0.0) <= allowed:
        return False
    # Points of one pair may share anew among themselves: that is no matter of the pair's.
    changes: dict[object, FloatArray] = {}
    for touch, here, change in zip(decision.touches, decision.rows.held, (decision.forces - held).tolist(), strict=True):
        changes[touch.pair] = changes.get(touch.pair, np.zeros(3)) + change * here.normal
    return any(math.hypot(*change.tolist()) > allowed for change in changes.values())


def _kinks(closed: ActiveContactSet, motion: Motion, duration_s: float) -> list[float]:
    """When other contacts begin to press, s since the start of the step."""
    last, found = _pressing(closed, motion, duration_s), list[float]()
    here = _pressing(closed, motion, 0.0)
    while here != last and len(found) <= len(closed.touches):
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
    """Forces that only push, at the state of what moves."""
    decision = closed.decide()
    return Stage(decision.rows, decision.forces, decision.forces.dot(decision.rows.J) * rates)
