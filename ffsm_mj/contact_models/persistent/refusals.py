"""Cases that persistent contact does not support, with the messages that refuse them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.search import persistence_fault
from ffsm_mj.contact.joint_limit import JointLimit


def refusal(model: Any, pair: UnilateralConstraint) -> str:
    """Why a pair cannot stay in contact; empty if it can."""
    shapes = "" if isinstance(pair, JointLimit) else persistence_fault(model, *pair.ids)
    if shapes:
        return shapes
    forces = ", ".join(_soft_forces(model))
    return f"persistent contact does not support {forces}, which MuJoCo models as soft constraints" if forces else ""


def _soft_forces(model: Any) -> Iterator[str]:
    """Soft constraints of MuJoCo in a model: their forces depend on the accelerations, which the contact problem needs."""
    if model.neq:
        yield "equality constraints"
    if np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss):
        yield "friction loss"
