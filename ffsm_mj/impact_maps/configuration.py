"""One configuration of an impact map, and how a scenario states it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System

Origin = Literal["run", "sample", "optimum"]


@dataclass(frozen=True, eq=False)
class Configuration:
    """A configuration of the scene at the contact, and what the impact does there.

    Attributes:
        origin: ``run``: as the scenario arrives; ``sample``; ``optimum``.
        qpos: Coordinates, (nq,).
        qvel: Velocities before the impact, (nv,); None if no rates of the arm arrive with the velocity of the run.
        jump: Change of the velocities, (nv,).
        effects: Effects by name, see :data:`ffsm_mj.impact_maps.evaluation.EFFECTS`.
        overlap_m: Greatest depth of an overlap, m; 0 without one.
        overlapping: Its geoms.
    """

    origin: Origin
    qpos: FloatArray
    qvel: FloatArray | None
    jump: FloatArray
    effects: dict[str, float]
    overlap_m: float
    overlapping: str

    @property
    def status(self) -> str:
        """``ok``, ``overlap`` or ``no rates``: the last two cannot be reached by a run."""
        if self.overlap_m > 0.0:
            return "overlap"
        return "ok" if self.qvel is not None else "no rates"


def initial_block(system: System, configuration: Configuration, keys: dict[str, str]) -> dict[str, Any]:
    """``initial`` of a scenario that begins at a configuration, just before the impact.

    Args:
        system: Robot and objects.
        configuration: The configuration; it has rates.
        keys: Names that the scenario gives joints, by full name; others are named in full.
    """
    qvel = configuration.qvel
    if qvel is None:
        raise ValueError("no rates of the arm arrive at this configuration with the velocity of the run")
    block: dict[str, Any] = {"joints": {}, "rates": {}}
    for name, joint in system.joints.items():
        for part, values in (("joints", configuration.qpos[joint.qpos]), ("rates", qvel[joint.dofs])):
            numbers = [float(value) + 0.0 for value in values]
            block[part][keys.get(name, name)] = numbers if len(numbers) > 1 else numbers[0]
    return block
