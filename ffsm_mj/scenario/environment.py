"""Data model of the surroundings of a scenario: an orbit and other external fields."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import WithJsonSchema

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import Fault
from ffsm_mj.fields.config import DipoleConfig, MagneticConfig, OrbitConfig, orbit_faults

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
    """Date and time of t = 0, ISO 8601 in UTC, such as 2027-03-01T12:00:00Z; for outputs and the magnetic field."""
    magnetic_field: MagneticConfig | None = None
    """Magnetic field, for magnetometers and magnetorquers: ``dipole``, that of the Earth, or ``uniform``; see docs/orbit.md.
    Left out: that of the model files (``<option magnetic>``, in T), for magnetometers only."""
    fields: tuple[Annotated[Any, OF_PLUGIN], ...] = ()
    """External fields, each with its ``kind``: ``uniform``, or one of a package or a script; see docs/fields.md."""


def environment_faults(environment: EnvironmentConfig, *, stars: bool) -> list[Fault]:
    """What is wrong with the orbit, the epoch and the magnetic field.

    Args:
        environment: The surroundings.
        stars: Whether a star tracker measures in the inertial axes of the central body.
    """
    faults, dipole = [], isinstance(environment.magnetic_field, DipoleConfig)
    if environment.orbit is None and environment.world_axes != "hill":
        faults.append(Fault("has no effect without 'orbit'; leave it out", ("environment", "world_axes")))
    if environment.orbit is not None:
        inertial = {
            "world_axes: eci": environment.world_axes == "eci",
            "magnetic_field: {kind: dipole}": dipole,
            "the axes eci of a star tracker": stars,
        }
        for fault in orbit_faults(environment.orbit, next((what for what, needed in inertial.items() if needed), "")):
            faults.append(Fault(fault.message, ("environment", "orbit", *([fault.key] if fault.key else []))))
    if environment.epoch is not None and not _is_epoch(environment.epoch):
        text = f"{environment.epoch!r} is no date and time in UTC; write it as 2027-03-01T12:00:00Z"
        faults.append(Fault(text, ("environment", "epoch")))
    if dipole:
        faults += [Fault(text, ("environment", "magnetic_field", "kind")) for text in _lacking_for_dipole(environment)]
    return faults


def _lacking_for_dipole(environment: EnvironmentConfig) -> Iterator[str]:
    """What the dipole of the Earth needs and the surroundings lack."""
    if environment.orbit is None:
        yield "the dipole of the Earth needs 'environment.orbit', which says where the scene is; or use uniform"
    elif environment.orbit.body != "earth":
        yield "the dipole is that of the Earth, and the orbit is about another body; use uniform"
    if environment.epoch is None:
        yield "the dipole turns with the Earth: it needs 'environment.epoch', the date and time of t = 0"


def _is_epoch(text: str) -> bool:
    """Whether a text is a date and time in UTC."""
    try:
        return datetime.fromisoformat(text).utcoffset() == timedelta(0)
    except ValueError:
        return False
