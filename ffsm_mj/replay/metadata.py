"""Metadata of a run derived from the models and scenario in its log, not from its own metadata."""

from __future__ import annotations

from ffsm_mj.records.metadata import conservative_metadata, free_metadata, gravity_metadata
from ffsm_mj.replay.scene import LogScene


def state_metadata(scene: LogScene) -> dict[str, str]:
    """Metadata of a run derived from its models."""
    system = scene.plant.system
    metadata = free_metadata(scene.plant.balance.free) | conservative_metadata(system.faults)
    metadata |= gravity_metadata(system.mj.opt.gravity)
    return metadata | {"time_step_s": repr(scene.scenario.time_step_s)}
