"""Delays of actuators in a model file, read as numbers: MuJoCo would keep delayed controls in its state."""

from __future__ import annotations

from typing import Any

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.source import authored


def actuator_delays_s(spec: Any, model: str, files: ModelFiles, vfs: Any) -> dict[str, float]:
    """Delay of each actuator that has one, by full name, s.

    Args:
        spec: Specification of the model, which may lack some of the actuators of its file.
        model: Its name in the scene.
        files: Its files.
        vfs: MuJoCo's virtual files.
    """
    left = {actuator.name for actuator in spec.actuators}
    if not any(b"delay" in content for content in files.files.values()):  # parsing again takes as long as the first time
        return {}
    every = authored(files, vfs).actuators
    return {f"{model}/{each.name}": float(each.delay) for each in every if each.name in left and each.delay > 0.0}
