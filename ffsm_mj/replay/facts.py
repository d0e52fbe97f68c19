"""Facts of a run derived from the models and scenario in its log, not from the facts it states."""

from __future__ import annotations

from ffsm_mj.records.facts import conservative_facts, free_facts, gravity_facts
from ffsm_mj.replay.scene import LogScene


def state_facts(scene: LogScene) -> dict[str, str]:
    """Facts of a run derived from its models."""
    system = scene.plant.system
    facts = free_facts(scene.plant.balance.free) | conservative_facts(system.faults)
    facts |= gravity_facts(system.mj.opt.gravity)
    return facts | {"time_step_s": repr(scene.scenario.time_step_s)}
