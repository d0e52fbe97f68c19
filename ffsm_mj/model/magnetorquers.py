"""Magnetorquers, which a scenario adds to the scene: actuators at sites whose commands are magnetic dipoles.

MJCF has no such element. In the compiled model each is a plain motor at a site whose gear is zero: it has a name, a command,
limits and delays as all others, and no force of its own. :mod:`ffsm_mj._core.magnetic` makes the torque.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray
from ffsm_mj.errors import Faults, full_name

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class Magnetorquer:
    """A magnetorquer of a scenario.

    Attributes:
        name: Its name.
        site: Name of the site that it is at.
        axis: Axis of the site along which a positive dipole points.
        max_dipole_A_m2: Largest dipole, in either direction.
    """

    name: str
    site: str
    axis: Axis
    max_dipole_A_m2: float


def add_magnetorquers(scene: Any, magnetorquers: Iterable[Magnetorquer]) -> None:
    """Add magnetorquers to the specification of a scene, behind all other actuators.

    Raises:
        ScenarioFaults: There is no such site, it does not move, or an actuator has the name.
    """
    sites = [site.name for site in scene.sites]
    with Faults() as faults:
        for one in magnetorquers:
            if any(other.name == one.name for other in scene.actuators):
                faults.add("is an actuator of a model already; choose another name", "actuators", one.name)
                continue
            with faults.below("actuators", one.name, "site"):
                site = full_name("site", one.site, sites)
                added = scene.add_actuator(name=one.name, trntype=mujoco.mjtTrn.mjTRN_SITE)
                added.target, added.gear = site, np.zeros(6)
                added.ctrllimited, added.ctrlrange = True, [-one.max_dipole_A_m2, one.max_dipole_A_m2]


def magnetorquer_mask(model: Any) -> BoolArray:
    """Which actuators of a compiled model are magnetorquers, (nu,)."""
    at_site = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_SITE)
    return np.asarray(at_site & (model.actuator_trnid[:, 1] < 0) & ~model.actuator_gear.any(axis=1))


def magnetorquers_of(configs: Mapping[str, Any]) -> tuple[Magnetorquer, ...]:
    """Magnetorquers among the configurations of actuators, or what a log states of them, by name."""
    return tuple(
        Magnetorquer(name, config.site, config.axis, config.max_dipole_A_m2)
        for name, config in configs.items()
        if config.kind == "magnetorquer"
    )
