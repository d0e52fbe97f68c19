"""Data model of the surroundings of a scenario: an orbit and other external fields."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import WithJsonSchema

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import Fault
from ffsm_mj.fields.config import OrbitConfig, orbit_faults

OF_PLUGIN = WithJsonSchema({"type": "object", "required": ["kind"], "properties": {"kind": {"type": "string"}}})
"""Schema of the configuration of a plug-in that is looked up by its kind."""


class EnvironmentConfig(StrictModel):
    """What acts on all bodies from outside, entered in the balance as external work and impulses."""

    orbit: OrbitConfig | None = None
    """Orbit of the origin of the world axes, with tide and gravity-gradient torque on all bodies; see docs/orbit.md."""
    world_axes: Literal["hill", "lvlh", "eci"] = "hill"
    """World axes, which do not rotate: ``hill`` (x up, y forward, z along the orbit's angular momentum) or ``lvlh`` (x along
    V-bar, y along -H-bar, z along R-bar) at t = 0, or ``eci``, the inertial axes of the central body."""
    epoch: str | None = None
    """Date and time of t = 0, ISO 8601 in UTC, such as 2027-03-01T12:00:00Z; for outputs."""
    fields: tuple[Annotated[Any, OF_PLUGIN], ...] = ()
    """External fields, each with its ``kind``: ``uniform``, or one of a package or a script; see docs/fields.md."""


def environment_faults(environment: EnvironmentConfig) -> list[Fault]:
    """What is wrong with the orbit and the epoch."""
    faults = []
    if environment.orbit is None and environment.world_axes != "hill":
        faults.append(Fault("has no effect without 'orbit'; leave it out", ("environment", "world_axes")))
    if environment.orbit is not None:
        for fault in orbit_faults(environment.orbit, environment.world_axes):
            faults.append(Fault(fault.message, ("environment", "orbit", *([fault.key] if fault.key else []))))
    if environment.epoch is not None and not _is_epoch(environment.epoch):
        text = f"{environment.epoch!r} is no date and time in UTC; write it as 2027-03-01T12:00:00Z"
        faults.append(Fault(text, ("environment", "epoch")))
    return faults


def _is_epoch(text: str) -> bool:
    """Whether a text is a date and time in UTC."""
    try:
        return datetime.fromisoformat(text).utcoffset() == timedelta(0)
    except ValueError:
        return False
