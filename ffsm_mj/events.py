"""What happens once rather than every tick: impacts, phases, contacts nobody handles, and how the run ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Outcome(StrEnum):
    """How a run ended; each member's ``sentence`` says it to a person."""

    COMPLETED = "completed"
    DIVERGED = "diverged"
    EVENT_LIMIT = "event_limit"
    LASTING_CONTACT = "lasting_contact"
    UNSUPPORTED_CONTACT = "unsupported_contact"
    CONTROLLER_FAILED = "controller_failed"
    WRITE_FAILED = "write_failed"
    INTERRUPTED = "interrupted"

    @property
    def sentence(self) -> str:
        """One sentence for a person."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.COMPLETED: "the run reached its end",
    Outcome.DIVERGED: "the motion diverged",
    Outcome.EVENT_LIMIT: "the scenario's limit on the number of impacts was reached",
    Outcome.LASTING_CONTACT: "a contact became lasting, which the impact law does not model",
    Outcome.UNSUPPORTED_CONTACT: "a contact cannot be resolved exactly",
    Outcome.CONTROLLER_FAILED: "the controller failed",
    Outcome.WRITE_FAILED: "the log could not be written",
    Outcome.INTERRUPTED: "the run was interrupted",
}


@dataclass(frozen=True)
class ImpactRecord:
    """One contact of an impact; contacts at one instant share ``event`` and the states before and after.

    Vectors are in world axes; ``normal`` points from the robot to the object; momenta are (P, L about the origin).
    ``jammed`` is 1 where bodies were squeezed without clearance: no elastic answer exists and energy was lost.
    """

    event: int
    time_s: float
    robot_geom: str
    object_geom: str
    point_m: tuple[float, ...]
    normal: tuple[float, ...]
    manifold: str
    law: str
    jammed: int
    restitution: float
    approach_speed_m_s: float
    separation_speed_m_s: float
    impulse_N_s: float
    angular_impulse_N_m_s: tuple[float, ...]
    gap_m: float
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    energy_before_J: Mapping[str, tuple[float, ...]]
    energy_after_J: Mapping[str, tuple[float, ...]]
    momentum_before: Mapping[str, tuple[float, ...]]
    momentum_after: Mapping[str, tuple[float, ...]]
    energy_change_J: float
    linear_momentum_change_N_s: float
    angular_momentum_change_N_m_s: float


@dataclass(frozen=True)
class PhaseRecord:
    """A phase begins: its position, its name, the kind of its controller, when, and why."""

    index: int
    name: str
    controller: str
    start_s: float
    reason: str


@dataclass(frozen=True)
class UnhandledContactRecord:
    """Two geoms overlapped that are neither an impact pair nor ignored; nothing pushed them apart."""

    geoms: tuple[str, ...]
    start_s: float
    end_s: float
    max_depth_m: float


@dataclass(frozen=True)
class OutcomeRecord:
    """How the run ended, and what it cost."""

    outcome: str
    message: str
    end_s: float
    steps: int
    wall_s: float
    controller_ticks: int
    riccati_fallbacks: int
    worst_riccati_residual: float
    versions: Mapping[str, str] = field(default_factory=dict)


Event = ImpactRecord | PhaseRecord | UnhandledContactRecord
