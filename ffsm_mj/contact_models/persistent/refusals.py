"""Cases that persistent contact does not support, with the messages that refuse them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np


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
