"""Configuration of the phases of a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, Union

from ffsm_controllers import kinds
from ffsm_controllers.settled import SettledConfig
from pydantic import (
    ConfigDict,
    Field,
    PositiveFloat,
    SerializeAsAny,
    model_validator,
)

from ffsm_mj.config import Name, PartName, StrictModel

_KINDS = kinds()
if TYPE_CHECKING:
    ControllerConfig: TypeAlias = Any
    OptionalController: TypeAlias = Any
else:
    ControllerConfig = Annotated[
        Union[tuple(cls.Config for cls in _KINDS.classes.values())],  # noqa: UP007 (a union of unknown length)
        Field(discriminator="kind"),
    ]
    OptionalController = ControllerConfig | None


class SensorEndConfig(StrictModel):
    """A phase ends at a control tick at which a valid measurement is beyond a bound."""

    sensor: Name
    """A sensor; of a vector its norm counts."""
    above: float | None = None
    """The phase ends above this value, in the unit of the sensor."""
    below: float | None = None
    """The phase ends below this value."""

    @model_validator(mode="after")
    def _has_one_bound(self) -> SensorEndConfig:
        if (self.above is None) == (self.below is None):
            raise ValueError("needs 'above' or 'below', one of the two")
        return self


class PhaseConfig(StrictModel):
    """A phase of the task; it ends at an event, when the tip has settled, after a time, or with the run."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["controller"]}, {"required": ["controllers"]}]})

    name: Name
    until: Name | SensorEndConfig | None = None
    """``impact``, ``contact_begins``, ``contact_ends``, ``contact_slips``, ``contact_sticks`` (of a contact with friction),
    ``limit_impact``, ``limit_begins``, ``limit_ends`` (of a joint at a limit), ``capture``, ``release`` or a record of a
    contact model: the first such event after the start of the phase; ``settled``: see that key; ``finished``: the control
    law has finished (``playback``: the record is over; ``joint_path``: the time of the last waypoint); ``end``: the end of
    the run; ``{sensor: NAME, above: VALUE}`` (or ``below``): a measurement."""
    settled: SettledConfig | None = None
    """With ``until: settled``: the phase ends when the tip has been near its target and slow for a time."""
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

    @model_validator(mode="after")
    def _is_consistent(self) -> PhaseConfig:
        if self.controller is None and self.controllers is None:
            raise ValueError("a phase needs 'controller: {kind: ...}', or 'controllers: {PART: {kind: ...}, ...}'")
        if self.controller is not None and self.controllers is not None:
            raise ValueError("has both 'controller' and 'controllers'; leave one of them out")
        if self.until is None and self.for_s is None:
            raise ValueError("a phase needs 'until' (impact, settled, end, ...) or 'for_s', or an event and 'for_s'")
        if self.until == "settled" and self.settled is None:
            raise ValueError("'until: settled' needs 'settled: {error_m: ..., speed_m_s: ..., for_s: ...}'")
        if self.until != "settled" and self.settled is not None:
            raise ValueError("'settled' has no effect without 'until: settled'; leave it out")
        if self.until == "end" and self.for_s is not None:
            raise ValueError("'for_s' has no effect with 'until: end'; leave one of them out")
        return self

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
