"""Plots of a recording: entities, the columns that they show, names and colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import external_actuators
from ffsm_mj.log.palette import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PURPLE,
    ROBOT_ON_DARK,
    SKY,
    VERMILION,
    Colour,
    object_colour,
)
from ffsm_mj.log.rerun.states import friction_modes
from ffsm_mj.model.system import System
from ffsm_mj.records.metadata import free_components
from ffsm_mj.records.signals import COMPONENTS, SUBSYSTEMS, Layout, effort_key, identifier

_COLOURS = {
    "total": (PALE, PALE, PALE),
    "robot": (ROBOT_ON_DARK, BLUE, GREEN),
    "objects": (object_colour(0), ORANGE, PURPLE),
}
_USE_COLOURS = (ORANGE, SKY, GREEN, PURPLE, VERMILION, BLUE)
JOINTS, BASE = "plots/joints", "plots/base"
"""Parent entities of the efforts of joint motors, and of thrusters and ideal base torques."""
_LEAST = 1e-18
"""Least value on a logarithmic axis, far below rounding."""
FORCES = "plots/contact_forces"
"""Parent entity of the magnitudes of forces."""
TORQUES = "plots/interface_torque"
"""Parent entity of the magnitudes of torques."""
FRICTION_USE = "plots/friction_use"
"""Entity of the shares of the friction limit that contacts use."""


@dataclass(frozen=True)
class Plot:
    """Curves of one entity.

    Attributes:
        entity: Path of the entity.
        columns: Column of a row for each curve.
        names: Name of each curve.
        colours: Colour of each curve, with its opacity from 0 to 255 if it is not opaque.
        unit: Common unit of the curves; empty if there is none.
        logarithmic: Whether the decimal logarithms of the magnitudes are shown.
        title: Title without the unit; empty if the layout gives one.
        widths: Width of each curve in points; none: the usual one.
        factors: Factor of each column; none: 1.
    """

    entity: str
    columns: list[int]
    names: list[str]
    colours: Sequence[Colour | tuple[int, int, int, int]]
    unit: str = ""
    logarithmic: bool = False
    title: str = ""
    widths: Sequence[float] = ()
    factors: Sequence[float] = ()

    def values(self, rows: FloatArray) -> FloatArray:
        """Values to show for some rows, (n, number of curves)."""
        values = rows[:, self.columns]
        if self.factors:
            values = values * np.array(self.factors)
        return np.log10(np.maximum(np.abs(values), _LEAST)) if self.logarithmic else values


def plots(layout: Layout, system: System, metadata: Mapping[str, str]) -> list[Plot]:
    """All plots of a run except the tip error, which is not a column."""
    index = layout.index
    subsystems = [subsystem for subsystem in SUBSYSTEMS if subsystem != "objects" or system.objects]
    energy = [index[f"energy.{subsystem}_J"] for subsystem in subsystems]
    return [
        Plot("plots/energy", energy, subsystems, [_COLOURS[subsystem][0] for subsystem in subsystems]),
        *_momenta(index, metadata, subsystems[1:]),
        _residuals(index, metadata),
        *_friction_use(layout),
        *_efforts(layout, system),
    ]


def _friction_use(layout: Layout) -> list[Plot]:
    rules = friction_modes(layout)
    columns = [layout.index[f"contact.{name}_friction_use"] for name in rules]
    colours = [_USE_COLOURS[i % len(_USE_COLOURS)] for i in range(len(rules))]
    return [Plot(FRICTION_USE, columns, list(rules), colours)] if rules else []


def _free(metadata: Mapping[str, str], subsystem: str) -> list[str]:
    """Components of momentum that the joints of a subsystem leave free; the others are not conserved."""
    flags = free_components(metadata, subsystem)
    return [component for component, flag in zip(COMPONENTS, flags, strict=True) if flag]


def _momenta(index: Mapping[str, int], metadata: Mapping[str, str], subsystems: Sequence[str]) -> list[Plot]:
    found = []
    for subsystem in subsystems:
        for kind, letter in (("linear", "P"), ("angular", "L")):
            components = [c for c in _free(metadata, subsystem) if c.startswith(letter)]
            colours = [_COLOURS[subsystem]["xyz".index(c[2])] for c in components]
            columns = [index[f"momentum.{subsystem}_{c}"] for c in components]
            names = [f"{subsystem} {c[:3]}" for c in components]
            if components:
                found.append(Plot(f"plots/{kind}_momentum/{subsystem}", columns, names, colours))
    return found


def _residuals(index: Mapping[str, int], metadata: Mapping[str, str]) -> Plot:
    colours = dict(zip(COMPONENTS, (ORANGE, VERMILION, PURPLE, SKY, BLUE, GREEN), strict=True))
    components = _free(metadata, "total")
    columns = [index["balance.total_energy_residual_J"], *(index[f"balance.total_residual_{c}"] for c in components)]
    names = ["energy", *(c[:3] for c in components)]
    return Plot("plots/balance", columns, names, [PALE, *(colours[c] for c in components)], logarithmic=True)


def _efforts(layout: Layout, system: System) -> list[Plot]:
    found = []
    external = external_actuators(system)
    for i, name in enumerate(system.names("actuator")):
        columns = [layout.index[effort_key(layout, name, what)] for what in ("lower", "upper", "applied")]
        entity = f"{BASE if external[i] else JOINTS}/{identifier(name)}"
        names, unit = ["lower bound", "upper bound", name.rsplit("/", 1)[-1]], layout.signals[columns[-1]].unit
        found.append(Plot(entity, columns, names, [GREY, GREY, ORANGE], unit))
    return found
