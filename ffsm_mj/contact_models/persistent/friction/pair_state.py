"""Friction of one pair at one state: mode, friction force, slip, and how much of the limit of friction is used."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact_models.persistent.friction.decision import FrictionalDecision
from ffsm_mj.contact_models.persistent.friction.internal_forces import friction_use, wedged
from ffsm_mj.contact_models.persistent.friction.modes import CLOSED, SLIDE, STICK


class PairFriction(NamedTuple):
    """Friction of a pair that carries force.

    Attributes:
        slides: Whether any of its points slides; otherwise those that carry force stick.
        force: Tangential resultant on geom b, world axes, N, (3,).
        slip: Slip velocity of geom b relative to geom a at the point that slides fastest, world axes, m/s, (3,).
        use: Share of the friction limit mu times the normal force that its points use, in [0, 1]: 1 while one slides; while
            they stick, they would do so with mu times this as well.
    """

    slides: bool
    force: FloatArray
    slip: FloatArray
    use: float

    @property
    def slip_speed(self) -> float:
        """Norm of the slip velocity, m/s."""
        return float(np.linalg.norm(self.slip))


def pair_friction(decision: FrictionalDecision, pair: UnilateralConstraint) -> PairFriction | None:
    """Friction of a pair; None if it has mu = 0 or carries no force."""
    mine = np.array([contact.pair is pair for contact in decision.contact_points], dtype=np.bool_)
    mine &= decision.kinds != CLOSED
    if pair.mu == 0.0 or not mine.any():
        return None
    slides = mine & (decision.kinds == SLIDE)
    speeds = np.linalg.norm(decision.slips, axis=1) * slides
    slip = decision.slips[int(np.argmax(speeds))] if slides.any() else np.zeros(3)
    use = 1.0 if slides.any() else _use(decision, np.flatnonzero(mine))
    return PairFriction(bool(slides.any()), decision.friction[mine].sum(axis=0), slip, use)


def _use(decision: FrictionalDecision, mine: IntArray) -> float:
    """Share of the friction limit that the sticking points of a pair use."""
    sticks = np.flatnonzero(decision.kinds == STICK)
    return friction_use(decision.problem, decision.solution.forces, sticks, mine)


def is_wedged(decision: FrictionalDecision, pair: UnilateralConstraint) -> bool:
    """Whether a pair that carries force is wedged: forces inside the friction cones hold it without any load."""
    sticks = np.flatnonzero(decision.kinds == STICK)
    mine = [i for i in sticks.tolist() if decision.contact_points[i].pair is pair]
    slides = any(
        contact.pair is pair and kind == SLIDE
        for contact, kind in zip(decision.contact_points, decision.kinds.tolist(), strict=True)
    )
    return bool(mine) and not slides and wedged(decision.problem, sticks, mine[0])
