"""What a recording plots: entities, the columns of a row that they show, names and colours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ffsm_mj.model.dynamics import external_actuators
from ffsm_mj.model.system import System
from ffsm_mj.records.facts import free_components
from ffsm_mj.records.signals import COMPONENTS, PARTIES, Layout, identifier

Colour = tuple[int, int, int]
# Okabe and Ito's colours: told apart by every eye. Orange is the robot, blue are the objects.
WHITE, GREY = (230, 230, 230), (130, 130, 130)
ORANGE, VERMILION, YELLOW = (230, 159, 0), (213, 94, 0), (240, 228, 66)
SKY, BLUE, GREEN, PURPLE = (86, 180, 233), (0, 114, 178), (0, 158, 115), (204, 121, 167)
_OF_PARTY = {
    "total": (WHITE, WHITE, WHITE),
    "robot": (ORANGE, VERMILION, PURPLE),
    "objects": (SKY, BLUE, GREEN),
}
JOINTS, BASE = "plots/joints", "plots/base"
"""Entities above the efforts of the joints' motors, and of thrusters and ideal base torques."""


@dataclass(frozen=True)
class Plot:
    """Lines of one entity.

    Attributes:
        entity: Where they are logged.
        columns: Columns of a row, one per line.
        names: One per line.
        colours: One per line.
        unit: Unit of the lines where they share one.
    """

    entity: str
    columns: list[int]
    names: list[str]
    colours: list[Colour]
    unit: str = ""


def plots(layout: Layout, system: System, facts: Mapping[str, str]) -> list[Plot]:
    """All plots of a run but the tip's error, which is no column of its own."""
    index = layout.index
    energy = [index[f"energy.{party}_J"] for party in PARTIES]
    return [
        Plot("plots/energy", energy, list(PARTIES), [_OF_PARTY[party][0] for party in PARTIES]),
        *_momenta(index, facts),
        _ledger(index, facts),
        *_efforts(layout, system),
    ]


def _free(facts: Mapping[str, str], party: str) -> list[str]:
    """Components of momentum that the joints leave free: the others are zero or borne."""
    flags = free_components(facts, party)
    return [component for component, flag in zip(COMPONENTS, flags, strict=True) if flag]


def _momenta(index: Mapping[str, int], facts: Mapping[str, str]) -> list[Plot]:
    found = []
    for party in ("robot", "objects"):
        for kind, letter in (("linear", "P"), ("angular", "L")):
            components = [c for c in _free(facts, party) if c.startswith(letter)]
            colours = [_OF_PARTY[party]["xyz".index(c[2])] for c in components]
            columns = [index[f"momentum.{party}_{c}"] for c in components]
            names = [f"{party} {c[:3]}" for c in components]
            if components:
                found.append(Plot(f"plots/{kind}_momentum/{party}", columns, names, colours))
    return found


def _ledger(index: Mapping[str, int], facts: Mapping[str, str]) -> Plot:
    colours = dict(zip(COMPONENTS, (ORANGE, VERMILION, PURPLE, SKY, BLUE, GREEN), strict=True))
    components = _free(facts, "total")
    columns = [index["ledger.total_energy_residual_J"], *(index[f"ledger.total_residual_{c}"] for c in components)]
    return Plot(
        "plots/ledger", columns, ["energy", *(c[:3] for c in components)], [WHITE, *(colours[c] for c in components)]
    )


def _efforts(layout: Layout, system: System) -> list[Plot]:
    found = []
    external = external_actuators(system)
    for i, full_name in enumerate(system.names("actuator")):
        name = identifier(full_name)
        key = next(key for key in layout.keys if key.startswith(f"actuators.{name}_applied_"))
        columns = [layout.index[key.replace("_applied_", f"_{which}_")] for which in ("lower", "upper", "applied")]
        entity = f"{BASE if external[i] else JOINTS}/{name}"
        short = full_name.rsplit("/", 1)[-1]
        names, unit = ["lower bound", "upper bound", short], layout.signals[columns[-1]].unit
        found.append(Plot(entity, columns, names, [GREY, GREY, ORANGE], unit))
    return found


def thrusters(layout: Layout, system: System) -> dict[str, tuple[int, int]]:
    """Column of the applied force, and actuator, of everything that pushes the base; by name."""
    model, names = system.mj, system.names("actuator")
    found = {}
    for i in np.flatnonzero(external_actuators(system)).tolist():
        key = f"actuators.{identifier(names[i])}_applied_N"
        if key in layout.index:
            found[model.actuator(i).name.rsplit("/", 1)[-1]] = (layout.index[key], i)
    return found
