"""Cases that persistent contact does not support, with the messages that refuse them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion

_OTHER_MODEL = "the motion uses another model than the scenario's, and no grasp of the scenario is closed in it"


def refusal_in(motion: Motion, scene: Scene) -> str:
    """Why no pair of a scene can stay in contact in a motion; empty if all can."""
    if motion.data is not scene.data and not motion.grasp:
        return _OTHER_MODEL
    return refusal(scene.system.mj)


def refusal(model: Any) -> str:
    """Why no pair of a model can stay in contact; empty if all can."""
    forces = ", ".join(_soft_forces(model))
    return f"persistent contact does not support {forces}, which MuJoCo models as soft constraints" if forces else ""


def _soft_forces(model: Any) -> Iterator[str]:
    """Soft constraints of MuJoCo in a model: their forces depend on the accelerations, which the contact problem needs."""
    if model.neq:
        yield "equality constraints"
    if np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss):
        yield "friction loss"
