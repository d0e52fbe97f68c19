"""Preparation of one model of a scenario before it is attached to the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ffsm_mj.errors import InputError
from ffsm_mj.model.actuators import make_motors
from ffsm_mj.model.alone import warnings_alone
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.flex import add_flex
from ffsm_mj.model.joint_limits import empty_ranges
from ffsm_mj.model.overrides import ModelOverrides, override
from ffsm_mj.model.sensors import Sensors, sensors_of_model
from ffsm_mj.model.settings import outermost_faults, setting_faults, setting_notes
from ffsm_mj.model.sites import add_sites
from ffsm_mj.model.source import load_with_timing
from ffsm_mj.model.strip import strip


@dataclass(frozen=True)
class Part:
    """A prepared model.

    Attributes:
        spec: Its specification; all its elements have names.
        notes: Removed elements, and ignored settings, as text.
        overridden: Changed properties, to be verified in the compiled scene; None if there are none.
        warnings: MuJoCo's warnings about the model compiled alone.
        sensors: Its sensors.
        delays_s: Delays of its actuators by full name, s.
    """

    spec: Any
    notes: list[str]
    overridden: ModelOverrides | None
    warnings: tuple[str, ...]
    sensors: Sensors
    delays_s: dict[str, float]


def part(name: str, files: ModelFiles, vfs: Any) -> Part:
    """Prepare one model: remove elements, make servos motors, change properties, add sites and flexible drives, in order.

    Args:
        name: Name of the model in the scene.
        files: Files of the model, and what to change.
        vfs: MuJoCo's virtual files; those of the model are added. They are needed until the scene is compiled.

    Raises:
        InputError: MuJoCo refuses the model, a joint has an empty range, a setting would make another plant of it, or a
            sensor cannot be measured.
        ScenarioFaults: A site, a flexible drive or a property is impossible.
    """
    spec, timing = load_with_timing(files, vfs)
    notes = [f"removed from {name}: {what}" for what in strip(spec, files.strip)]
    make_motors(spec, files.motors)
    notes += setting_notes(spec, name, files)
    notes += [
        f"{files.place}: interp of {what} has no effect: delayed values are those of the last sample"
        for what in timing.interpolated
    ]
    if faults := [*empty_ranges(spec, name, files), *setting_faults(spec, files), *outermost_faults(spec, files)]:
        raise InputError(faults)
    overridden = override(spec, name, files, vfs) if files.overrides else None
    warnings = overridden.warnings if overridden is not None else warnings_alone(files, vfs)
    add_sites(spec, files.sites)
    add_flex(spec, files.flex)
    sensors = sensors_of_model(spec, name, files, timing.sensors)
    left = {actuator.name for actuator in spec.actuators}
    delays_s = {f"{name}/{each}": delay for each, delay in timing.actuator_delays_s.items() if each in left}
    return Part(spec, notes + sensors.notes, overridden, warnings, sensors, delays_s)
