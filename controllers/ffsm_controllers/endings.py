"""What ends a phase of a task, and which phase follows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ffsm_mj.controller_protocol import Controller, Finishes, Observation

TIME_TOLERANCE_S = 1e-9
"""Ticks are exact multiples of the period up to rounding of the product."""


class Trigger:
    """What may end a phase."""

    def begin(self, observation: Observation) -> None:
        """The phase begins here; one that depends on the present alone remembers nothing."""

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:
        """Whether it ends the phase now, as seen at a control tick, an impact or another event.

        Args:
            observation: State of the free system, whatever is held.
            start_s: Time at which the phase began.
            law: The phase's control law.
        """
        raise NotImplementedError

    def rests_until_s(self, start_s: float, law: Controller) -> float:  # noqa: ARG002
        """Time up to which it does not end the phase without an event, and need not be asked; -inf: it must be."""
        return -math.inf


@dataclass(frozen=True)
class Ending:
    """A trigger of a phase.

    Attributes:
        reason: What the record of the next phase says: ``impact``, ``time``, the name of a sensor.
        trigger: When it is due.
        to: Position of the phase that follows; None: the next one, if there is one.
    """

    reason: str
    trigger: Trigger
    to: int | None = None


@dataclass(frozen=True)
class EventTrigger(Trigger):
    """The first record of a class after the start of the phase.

    Attributes:
        record: The class.
    """

    record: type

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:  # noqa: ARG002
        """Whether there is one."""
        return any(isinstance(event, self.record) for event in observation.events)

    def rests_until_s(self, start_s: float, law: Controller) -> float:  # noqa: ARG002
        """Only events end it."""
        return math.inf


@dataclass(frozen=True)
class MeasurementBound(Trigger):
    """A bound on what a sensor measures.

    Attributes:
        sensor: Its full name.
        above: The measurement is beyond it above this value; None: no such bound.
        below: The measurement is beyond it below this value; None: no such bound.
    """

    sensor: str
    above: float | None = None
    below: float | None = None

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:  # noqa: ARG002
        """Whether the newest sample is valid, and its value, or the norm of a vector, is beyond the bound.

        Of a force or torque sensor its mean counts too, as on a load cell: an impact within its interval is in no value.
        """
        sample = observation.measured[self.sensor]
        if not sample.valid:
            return False
        value = float(sample.value[0]) if len(sample.value) == 1 else math.hypot(*sample.value.tolist())
        mean = math.hypot(*sample.mean.tolist())  # 0 of other sensors; NaN of the first sample
        value = max(value, mean)
        return value > self.above if self.above is not None else self.below is not None and value < self.below


class FinishedTrigger(Trigger):
    """The control law has finished, at a control tick."""

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:  # noqa: ARG002
        """Whether it has."""
        return observation.at_tick and isinstance(law, Finishes) and law.is_finished(observation.time_s)

    def rests_until_s(self, start_s: float, law: Controller) -> float:  # noqa: ARG002
        """A law that does not come to an end does not end it."""
        return -math.inf if isinstance(law, Finishes) else math.inf


@dataclass(frozen=True)
class TimeTrigger(Trigger):
    """The first control tick at or after a time since the start of the phase.

    Attributes:
        duration_s: The time, s.
    """

    duration_s: float

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:  # noqa: ARG002
        """Whether it is over."""
        return observation.at_tick and observation.time_s - start_s >= self.duration_s - TIME_TOLERANCE_S

    def rests_until_s(self, start_s: float, law: Controller) -> float:  # noqa: ARG002
        """A little before its time."""
        return start_s + self.duration_s - 2.0 * TIME_TOLERANCE_S
