"""Configuration of the phases of a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias, Union

from pydantic import (
    ConfigDict,
    Field,
    PositiveFloat,
    SerializeAsAny,
    model_validator,
)

from ffsm_controllers import kinds
from ffsm_controllers.settled import SettledConfig
from ffsm_controllers.stop_condition import StopCondition
from ffsm_mj.config import Name, PartName, StrictModel

_KINDS = kinds()
if TYPE_CHECKING:
    ControllerConfig: TypeAlias = Any
    OptionalController: TypeAlias = Any
else:
    ControllerConfig = Annotated[
        Union[tuple(_KINDS.configs.values())],  # noqa: UP007 (a union of unknown length)
        Field(discriminator="kind"),
    ]
    OptionalController = ControllerConfig | None


class SensorEndConfig(StrictModel):
    """A phase ends at a control tick at which a valid measurement is beyond a bound."""

    sensor: Name
    """A sensor; of a vector its norm counts, of a force or torque sensor the greater one of its value and its mean over the
    interval, which contains impulses."""
    above: float | None = None
    """The phase ends above this value, in the unit of the sensor."""
    below: float | None = None
    """The phase ends below this value."""

    @model_validator(mode="after")
    def _has_one_bound(self) -> SensorEndConfig:
        if (self.above is None) == (self.below is None):
            raise ValueError("needs 'above' or 'below', one of the two")
        return self


class SensorBranchConfig(StrictModel):
    """A measurement beyond a bound, and the phase that follows."""

    above: float | None = None
    """The phase ends above this value, in the unit of the sensor; of a vector its norm counts."""
    below: float | None = None
    """The phase ends below this value."""
    phase: Name
    """The phase that follows."""

    @model_validator(mode="after")
    def _has_one_bound(self) -> SensorBranchConfig:
        if (self.above is None) == (self.below is None):
            raise ValueError("needs 'above' or 'below', one of the two")
        return self


class PhaseEnd(NamedTuple):
    """One of the ends of a phase.

    Attributes:
        keys: Its keys in the phase.
        trigger: ``impact``, ``time``, ``settled``, ``stop_when``, ..., or the bound on a measurement.
        to: Name of the phase that follows; None: the next one.
    """

    keys: tuple[str, ...]
    trigger: str | SensorEndConfig
    to: str | None

    @property
    def event(self) -> str | None:
        """The event or state of the control law that it waits for; None for times, conditions and measurements."""
        return self.trigger if isinstance(self.trigger, str) and self.trigger not in ("time", "stop_when") else None


class PhaseConfig(StrictModel):
    """A phase of the task; it ends at events, when the tip has settled, after a time, or with the run."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["controller"]}, {"required": ["controllers"]}]})

    name: Name
    until: Name | SensorEndConfig | None = None
    """``impact``, ``contact_begins``, ``contact_ends``, ``contact_slips``, ``contact_sticks`` (of a contact with friction),
    ``limit_impact``, ``limit_begins``, ``limit_ends`` (of a joint at a limit), ``grasp``, ``release`` or a record of a
    contact model: the first such event after the start of the phase; ``settled``: see that key; ``finished``: the control
    law has finished (``playback``: the record is over; ``joint_path``: the time of the last waypoint); ``end``: the end of
    the run; ``{sensor: NAME, above: VALUE}`` (or ``below``): a measurement."""
    on: dict[Name, Name | SensorBranchConfig] = {}
    """Phases that follow at other ends than that of ``until``, by what ends this one: an event or state as in ``until``,
    ``time`` (with ``for_s``), ``stop_when`` (with that key), or a sensor with ``{above: VALUE, phase: NAME}`` (or below).
    Of several at one instant the first one listed counts, and those here before ``until``. A phase may be entered again."""
    stop_when: str | None = None
    """A condition that ends the phase: ``base_rate``, ``joint_rate`` in rad/s, ``base_speed``, ``tip_speed`` in m/s or
    ``tip_error`` in m, or ``stack_momentum`` in N m s (of robot and grasped object without the wheels), ``<`` or ``>``,
    number and unit, and for how long: ``base_rate < 1e-3 rad/s for 2 s``."""
    settled: SettledConfig | None = None
    """With ``settled`` in ``until`` or ``on``: the phase ends when the tip has been near its target and slow for a time."""
    for_s: PositiveFloat | None = None
    """Duration in s; the phase ends at the first control tick at or after it, or before at the event of ``until``."""
    arm: tuple[Name, ...] = ()
    """Grasps that are armed during the phase; their bounds may already be met at its start."""
    release: tuple[Name, ...] = ()
    """Grasps that are released at the start of the phase."""
    controller: SerializeAsAny[OptionalController] = None
    """Control law, chosen by ``kind``."""
    controllers: Annotated[dict[PartName, SerializeAsAny[ControllerConfig]], Field(min_length=1)] | None = None
    """In place of ``controller``: several control laws at once by part of the robot, each with actuators of its own."""
    drives: dict[PartName, Name] = {}
    """Objects that parts of ``controllers`` drive, by the name of the part; all other parts drive the robot. For its law the
    object is in the place of the robot: its base, its joints, its thrusters and wheels."""

    @model_validator(mode="after")
    def _is_consistent(self) -> PhaseConfig:
        if self.controller is None and self.controllers is None:
            raise ValueError("a phase needs 'controller: {kind: ...}', or 'controllers: {PART: {kind: ...}, ...}'")
        if self.controller is not None and self.controllers is not None:
            raise ValueError("has both 'controller' and 'controllers'; leave one of them out")
        if unknown := [part for part in self.drives if part not in (self.controllers or {})]:
            raise ValueError(f"'drives' names {unknown[0]!r}, which is no part of 'controllers'")
        if self.stop_when is not None:
            StopCondition.parse(self.stop_when)
        if message := self._fault_of_ends():
            raise ValueError(message)
        return self

    def _fault_of_ends(self) -> str:
        """What is wrong with the ends of the phase as a whole; empty if nothing is."""
        given = {"time": ("for_s", self.for_s), "stop_when": ("stop_when", self.stop_when)}
        needs = given | {"settled": ("settled", self.settled)}
        faults = [
            f"'on: {trigger}' needs {key!r}" for trigger, (key, value) in needs.items() if trigger in self.on and not value
        ]
        if isinstance(self.until, str) and self.until in self.on:
            faults.append(f"{self.until!r} is in 'until' and in 'on'; leave one of them out")
        if not (self.until or self.for_s or self.stop_when or self.on):
            faults.append("a phase needs 'until' (impact, settled, end, ...) or 'for_s', or an event and 'for_s'")
        if self.until == "settled" and self.settled is None:
            faults.append("'until: settled' needs 'settled: {error_m: ..., speed_m_s: ..., for_s: ...}'")
        if self.until != "settled" and "settled" not in self.on and self.settled is not None:
            faults.append("'settled' has no effect without 'until: settled'; leave it out")
        if self.until == "end":
            without = [key for trigger, (key, value) in given.items() if value is not None and trigger not in self.on]
            faults += [f"{key!r} has no effect with 'until: end'; leave one of them out" for key in without]
        return faults[0] if faults else ""

    @property
    def ends(self) -> list[PhaseEnd]:
        """What ends the phase, in the order in which it counts at one instant; empty if only the end of the run does."""
        found = [
            PhaseEnd(("on", name), name, to)
            if isinstance(to, str)
            else PhaseEnd(("on", name), SensorEndConfig(sensor=name, above=to.above, below=to.below), to.phase)
            for name, to in self.on.items()
        ]
        if self.until is not None and self.until != "end":
            found.append(PhaseEnd(("until",), self.until, None))
        for trigger, key, given in (("stop_when", "stop_when", self.stop_when), ("time", "for_s", self.for_s)):
            if given is not None and trigger not in self.on:
                found.append(PhaseEnd((key,), trigger, None))
        return found

    @property
    def laws(self) -> dict[tuple[str, ...], Any]:
        """Configurations of the control laws by their keys in the phase: ``controller``, or ``controllers`` and a part."""
        if self.controllers is None:
            return {("controller",): self.controller}
        return {("controllers", part): law for part, law in self.controllers.items()}

    @property
    def kind(self) -> str:
        """Kind of the control law; with several parts ``name: kind`` of each."""
        if self.controllers is None:
            return str(self.controller.kind)
        return ", ".join(f"{part}: {law.kind}" for part, law in self.controllers.items())
