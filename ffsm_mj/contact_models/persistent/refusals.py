"""Cases that persistent contact does not support, with the messages that refuse them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.search import persistence_fault
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.contact_models.persistent.decision import Decision
from ffsm_mj.records.events import Outcome, RunEnded

FRICTION = "friction in persistent contact is not modelled"
"""Why a pair with mu > 0 cannot carry a force in persistent contact."""
_STICKS_M_S = 1e-9
"""Slip below this speed counts as sticking."""


def refusal(model: Any, pair: UnilateralConstraint) -> str:
    """Why a pair cannot stay in contact; empty if it can."""
    shapes = "" if isinstance(pair, JointLimit) else persistence_fault(model, *pair.ids)
    if shapes:
        return shapes
    forces = ", ".join(_soft_forces(model))
    return f"persistent contact does not support {forces}, which MuJoCo models as soft constraints" if forces else ""


def pressing_pairs(decision: Decision) -> dict[UnilateralConstraint, float]:
    """Pairs that carry a force in the complementarity problem, and the sum of its normal forces in N."""
    found: dict[UnilateralConstraint, float] = {}
    for i in decision.pressing:
        pair = decision.contact_points[i].pair
        found[pair] = found.get(pair, 0.0) + decision.forces.item(i)
    return found


def friction_fault(pair: ContactPair, force: float, slips: Sequence[FloatArray]) -> str:
    """Why a pair with friction that carries a force ends the run, with its contact mode.

    Args:
        pair: The pair.
        force: Normal force, N.
        slips: Slip velocity at each contact point, m/s.
    """
    fastest = max(math.hypot(*slip.tolist()) for slip in slips)
    kind = f"sliding at {fastest:.3g} m/s" if fastest > _STICKS_M_S else "sticking"
    return f"normal force {force:.3g} N, {kind} with mu = {pair.mu:g}: {FRICTION}"


def _soft_forces(model: Any) -> Iterator[str]:
    """Soft constraints of MuJoCo in a model: their forces depend on the accelerations, which the contact problem needs."""
    if model.neq:
        yield "equality constraints"
    if np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss):
        yield "friction loss"


def refuse_friction(active_set: ActiveContactSet) -> None:
    """End the run if a pair with friction carries a force.

    This is checked at the start of a step, not when the pair closes: a grasp may take over the pair at the same instant.

    Raises:
        RunEnded: There is such a pair.
    """
    if not any(pair.mu > 0.0 for pair in active_set.by_pair) or not active_set.contact_points:
        return
    decision, data = active_set.decide(), active_set.data
    for pair, force in pressing_pairs(decision).items():
        if isinstance(pair, ContactPair) and pair.mu > 0.0:
            held = [
                at for contact, at in zip(decision.contact_points, decision.rows.states, strict=True) if contact.pair is pair
            ]
            why = friction_fault(pair, force, [pair.slip(data, at.normal, at.point) for at in held])
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{pair} would stay in contact from t = {data.time:.6g} s, {why}")
