"""Joints, whose coordinates and rates are taken as they are measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ffsm_controllers.estimators.mekf.belief import Belief
from ffsm_controllers.estimators.readings import Reading
from ffsm_mj.controller_protocol import Measurement


def joint_entry(reading: Reading, sample: Measurement, scratch: Any) -> Callable[[Belief], None]:
    """Writing of a sample of a joint into an estimate of its time; rates from differences are taken now, once.

    Args:
        reading: What the sensor measures.
        sample: Its sample.
        scratch: MuJoCo data to write into.
    """
    scratch.qvel[reading.dofs] = np.nan
    reading.write(sample, scratch)
    coordinates, rates = scratch.qpos[reading.qpos].copy(), scratch.qvel[reading.dofs].copy()
    rated = bool(np.isfinite(rates).all())

    def write(belief: Belief) -> None:
        belief.data.qpos[reading.qpos] = coordinates
        if rated:
            belief.data.qvel[reading.dofs] = rates

    return write
