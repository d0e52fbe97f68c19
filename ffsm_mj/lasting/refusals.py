"""What contact that lasts does not cover, by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.contact.feature import lasting_fault
from ffsm_mj.contact.pairs import ContactPair


def refusal(model: Any, pair: ContactPair) -> str:
    """Why a pair cannot stay in contact; empty where it can."""
    shapes = lasting_fault(model, *pair.ids)
    if shapes:
        return shapes
    forces = ", ".join(_soft_forces(model))
    return f"contact that lasts does not answer {forces}, which MuJoCo makes soft forces of" if forces else ""


def _soft_forces(model: Any) -> Iterator[str]:
    """Constraints of MuJoCo's own in a model: their forces depend on what they would have to answer."""
    disabled = int(model.opt.disableflags)
    if not disabled & int(mujoco.mjtDisableBit.mjDSBL_LIMIT) and (np.any(model.jnt_limited) or np.any(model.tendon_limited)):
        yield "joint limits"
    if model.neq:
        yield "equality constraints"
    if np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss):
        yield "friction loss"
