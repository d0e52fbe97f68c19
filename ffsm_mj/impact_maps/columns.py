"""Columns of an impact map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.analysis.tables import Table
from ffsm_mj.impact_maps.configuration import Configuration
from ffsm_mj.impact_maps.evaluation import EFFECTS
from ffsm_mj.impact_maps.target import Target
from ffsm_mj.records.signals import identifier

_UNITS = {"hinge": ("rad", "rad/s", "rad_s"), "slide": ("m", "m/s", "m_s")}
_REST = {
    "origin": "run: as the scenario arrives; sample; optimum",
    "status": "ok; overlap: geoms overlap; no rates: the arm cannot arrive with the velocity of the run",
    "overlapping": "geoms of the deepest overlap",
}


def table_of(target: Target, configurations: Sequence[Configuration]) -> Table:
    """Table with one row per configuration; joints of one coordinate have columns."""
    columns: dict[str, Any] = {"origin": [each.origin for each in configurations]}
    units, meanings = {"origin": ""}, {"origin": _REST["origin"]}

    def add(name: str, unit: str, meaning: str, values: list[Any]) -> None:
        columns[name], units[name], meanings[name] = values, unit, meaning

    add("status", "", _REST["status"], [each.status for each in configurations])
    for name, (unit, meaning) in EFFECTS.items():
        add(name, unit, meaning, [each.effects[name] for each in configurations])
    for joint in target.system.robot.joints:
        if joint.kind not in _UNITS:
            continue
        unit, rate, suffix = _UNITS[joint.kind]
        name, at, dof = identifier(joint.name), joint.qpos.start, joint.dofs.start
        add(f"q_{name}_{unit}", unit, f"coordinate of {joint.name}", [float(each.qpos[at]) for each in configurations])
        rates = [np.nan if each.qvel is None else float(each.qvel[dof]) for each in configurations]
        add(f"rate_{name}_{suffix}", rate, f"rate of {joint.name} before the impact", rates)
        jumps = [float(each.jump[dof]) for each in configurations]
        add(f"change_{name}_{suffix}", rate, f"change of the rate of {joint.name}", jumps)
    add("overlap_m", "m", "greatest depth of an overlap", [each.overlap_m for each in configurations])
    add("overlapping", "", _REST["overlapping"], [each.overlapping for each in configurations])
    return Table("impact_map", {name: np.array(values) for name, values in columns.items()}, units, meanings)
