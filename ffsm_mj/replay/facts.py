"""Facts of a run derived from the models and scenario in its log, not from the facts it states."""

from __future__ import annotations

from ffsm_mj.records.facts import conservative_facts, free_facts, gravity_facts
from ffsm_mj.replay.log_replay import LogReplay
from ffsm_mj.replay.scene import LogScene


def state_facts(scene: LogScene, retrace: LogReplay) -> dict[str, str]:
    """Facts of a run derived from its models."""
    facts = free_facts(retrace.free) | conservative_facts(scene.system.faults)
    facts |= gravity_facts(scene.system.mj.opt.gravity)
    return facts | {"time_step_s": repr(scene.scenario.time_step_s)}
