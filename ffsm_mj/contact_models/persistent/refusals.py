"""What contact that lasts does not cover, by name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.feature import lasting_fault
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.persistent.decision import Decision

FRICTION = "friction in contact that lasts is not modelled"
"""Why a pair with mu > 0 cannot stay in contact where it is pressed."""
_STICKS_M_S = 1e-9
"""Slip slower than this is none."""


def refusal(model: Any, pair: ContactPair) -> str:
    """Why a pair cannot stay in contact; empty where it can."""
    shapes = lasting_fault(model, *pair.ids)
    if shapes:
        return shapes
    forces = ", ".join(_soft_forces(model))
    return f"contact that lasts does not answer {forces}, which MuJoCo makes soft forces of" if forces else ""


def pressing_pairs(decision: Decision) -> dict[ContactPair, float]:
    """Pairs to which the inequality problem of closed contacts gives a force, as redundant ones share it; its sum in N."""
    found: dict[ContactPair, float] = {}
    for i in decision.pressing:
        pair = decision.touches[i].pair
        found[pair] = found.get(pair, 0.0) + decision.forces.item(i)
    return found


def rubbing(pair: ContactPair, force: float, slips: Sequence[FloatArray]) -> str:
    """Why a pair with friction that is pressed ends the run, and of what kind its contact is.

    Args:
        pair: The pair.
        force: What presses it, N.
        slips: Slip velocity at each of its points, m/s.
    """
    fastest = max(math.hypot(*slip.tolist()) for slip in slips)
    kind = f"sliding at {fastest:.3g} m/s" if fastest > _STICKS_M_S else "sticking"
    return f"pressed with {force:.3g} N, {kind} with mu = {pair.mu:g}: {FRICTION}"


def _soft_forces(model: Any) -> Iterator[str]:
    """Constraints of MuJoCo's own in a model: their forces depend on what they would have to answer."""
    disabled = int(model.opt.disableflags)
    if not disabled & int(mujoco.mjtDisableBit.mjDSBL_LIMIT) and (np.any(model.jnt_limited) or np.any(model.tendon_limited)):
        yield "joint limits"
    if model.neq:
        yield "equality constraints"
    if np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss):
        yield "friction loss"
