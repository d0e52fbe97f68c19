"""Files of an impact map: table, figure, and the best configuration as a scenario."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.assembly.simulator import Simulator
from ffsm_mj.errors import InputError
from ffsm_mj.impact_maps.impact_map import ImpactMap
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.report.export import to_arrow, write_arrow
from ffsm_mj.report.output_place import new_file, usable_folder
from ffsm_mj.report.plots.style import write
from ffsm_mj.scenario.shipped import scenario_names, scenario_path
from ffsm_mj.scenario.source import read_yaml
from ffsm_mj.yaml.parser import write_yaml

NAME = "impact-map"
BEST = "best.yaml"
_GONE_ON = ("from", "at_s")
"""Keys of ``initial`` of a scenario that goes on from another run: the best configuration begins anew."""


def save(mapped: ImpactMap, scenario: str | Path, folder: Path, axes: tuple[str, str] = ("", "")) -> list[Path]:
    """Write a map into a folder: ``impact-map.csv``, ``.parquet``, ``.png``, ``.svg``, and ``best.yaml``.

    Args:
        mapped: The map.
        scenario: Its scenario, which ``best.yaml`` extends.
        folder: Output folder; created if it does not exist.
        axes: Columns of the figure, see :func:`ffsm_mj.impact_maps.figure.draw`.

    Returns:
        The files written.

    Raises:
        InputError: The folder is not writable, or there is no such column.
        OutputLostError: A file could not be written completely.
    """
    from ffsm_mj.impact_maps.figure import draw

    usable_folder(folder)
    figure = draw(mapped, *axes)
    files = [folder / f"{NAME}.{form}" for form in ("csv", "parquet")]
    for path in files:
        write_arrow(iter([to_arrow(mapped.table)]), path, path.suffix[1:])
    files += write(figure, folder, NAME)
    best = folder / BEST
    with new_file(best) as place:
        place.write_text(best_scenario(mapped, scenario, folder), encoding="utf-8")
    return [*files, best]


def best_scenario(mapped: ImpactMap, scenario: str | Path, folder: Path) -> str:
    """YAML of a scenario that begins at the best configuration, just before the impact."""
    path = scenario_path(scenario).resolve()
    shipped = str(scenario) in scenario_names() and not Path(scenario).exists()
    parent = str(scenario) if shipped else os.path.relpath(path, folder.resolve())
    words = (
        f"{'Largest' if mapped.objective.maximize else 'Least'} {mapped.objective.effect} of the impact map of {path.stem}."
    )
    value = mapped.best.effects[mapped.objective.effect]
    data = {
        "extends": parent,
        "name": f"{path.stem}-best",
        "description": f"{words} The run begins just before the impact: {mapped.objective.effect} {value:.10g}.",
        "initial": {key: None for key in _GONE_ON if key in (read_yaml(path).data.get("initial") or {})} | mapped.initial(),
    }
    return write_yaml(data)


def difference(mapped: ImpactMap, path: Path, overrides: Sequence[str] | Mapping[str, Any] = ()) -> float:
    """Largest difference between the jump of velocities in a run of the best configuration and in the map, rad/s or m/s.

    Raises:
        InputError: The scenario cannot run, or begins with another impact.
    """
    with Simulator(path, overrides, record=False) as simulator:
        simulator.reset()
        events = simulator.step(until="event").events
        found = [each for each in events if isinstance(each, ImpactRecord)]
        if [each.pair for each in found] != [mapped.target.pair.name]:
            raise InputError(f"{path}: the run does not begin with an impact of {mapped.target.pair.name} alone")
        joints = simulator.system.joints
        jump = [np.subtract(found[0].qvel_after[name], found[0].qvel_before[name]) for name in joints]
    return float(np.abs(np.concatenate(jump) - mapped.best.jump).max())
