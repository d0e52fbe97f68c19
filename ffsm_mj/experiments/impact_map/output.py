"""Output of an impact map: text for a terminal, the figure, and the files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.simulator import Simulator
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.experiments.impact_map.evaluation import Configuration
from ffsm_mj.experiments.impact_map.impact_map import ImpactMap
from ffsm_mj.log import palette
from ffsm_mj.log.palette import hexadecimal
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.report.export import to_arrow, write_arrow
from ffsm_mj.report.output_place import new_file, usable_folder
from ffsm_mj.report.plots.silhouette import Plane, Silhouette
from ffsm_mj.report.plots.style import BLACK, VERMILION, WIDTH_IN, plain, publication, write
from ffsm_mj.report.terminal import table
from ffsm_mj.scenario.overrides import Overrides
from ffsm_mj.scenario.shipped import scenario_names, scenario_path
from ffsm_mj.scenario.source import read_yaml
from ffsm_mj.yaml import write_yaml

_SHOWN = {
    "impulse_N_s": ("impulse\nN s", "impulse"),
    "effective_mass_kg": ("eff. mass\nkg", "effective mass"),
    "base_rate_change_rad_s": ("base rate\nrad/s", "base rate"),
    "joint_rate_change": ("joint rate\nrad/s", "joint rate"),
    "object_spin_rad_s": ("object spin\nrad/s", "object spin"),
}
"""Effects of the table: head of the column, and words."""
_HOLDS = {
    "com": "with the robot's centre of mass where it is in the run",
    "base": "with the base where it is in the run",
    "nothing": "with the base anywhere",
}


def lines(mapped: ImpactMap, hold: str) -> Iterator[str]:
    """Contact, counts, and a table of the run, the best configuration and the extremes."""
    target = mapped.target
    place, normal = (", ".join(f"{x + 0.0:.6g}" for x in v) for v in (target.contact.point, target.outward))
    yield (
        f"contact of {target.pair} at ({place}) m, normal ({normal}): approach {target.approach_speed:.4g} m/s, "
        f"e = {target.contact.restitution:g}, mu = {target.contact.mu:g}"
    )
    counts = {status: sum(one.status == status for one in mapped.configurations) for status in ("overlap", "no rates")}
    said = "".join(f"; {counts[name]} {words}" for name, words in _COUNTED.items() if counts[name])
    yield f"{mapped.reached} of {mapped.drawn} drawn configurations reach it {_HOLDS[hold]}{said}"
    head = ("configuration", *(head for head, _ in _SHOWN.values()), "status")
    yield table(head, _rows(mapped), spare=("joint rate", "eff. mass"))


_COUNTED = {"overlap": "of all have overlapping geoms", "no rates": "cannot arrive with the velocity of the run"}


def _rows(mapped: ImpactMap) -> Iterator[tuple[str, ...]]:
    if mapped.of_run is not None:
        yield _row("as in the run", mapped.of_run)
    most = "largest" if mapped.objective.maximize else "least"
    yield _row(f"best ({most} {_SHOWN.get(mapped.objective.effect, ('', mapped.objective.effect))[1]})", mapped.best)
    allowed = [one for one in mapped.configurations if mapped.allows(one)]
    for effect in ("impulse_N_s", "base_rate_change_rad_s", "object_spin_rad_s"):
        for word, choose in (("least", min), ("largest", max)):
            extreme = choose(allowed, key=lambda one: one.effects[effect])
            if extreme is not mapped.best and extreme is not mapped.of_run:
                yield _row(f"{word} {_SHOWN[effect][1]}", extreme)


def _row(name: str, configuration: Configuration) -> tuple[str, ...]:
    return (name, *(f"{configuration.effects[effect]:.5g}" for effect in _SHOWN), configuration.status)


_PLANES = (Plane(0, 1), Plane(0, 2), Plane(1, 2))


def draw(mapped: ImpactMap, x: str = "", y: str = "") -> Figure:
    """Draw a map.

    Args:
        mapped: The map.
        x: Column of the table for the horizontal axis; empty: the first joint of the arm.
        y: Likewise for the vertical axis; empty: the second joint.

    Raises:
        InputError: No such column of numbers.
    """
    chosen = _columns(mapped, x, y)
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.46 * WIDTH_IN), layout="constrained")
        left, right = figure.subplots(1, 2)
        _scatter(figure, left, mapped, chosen)
        _outlines(right, mapped)
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _columns(mapped: ImpactMap, x: str, y: str) -> tuple[str, str]:
    table = mapped.table
    numeric = [name for name, values in table.columns.items() if np.issubdtype(values.dtype, np.number)]
    for name in (x, y):
        if name and name not in numeric:
            raise InputError(f"--axes: {unknown_name('column', name, numeric)}")
    moving = [name for name in numeric if name.startswith("q_") and np.ptp(table.columns[name]) > 0.0]
    arm = [name for name in moving if any(name.startswith(f"q_{joint}_") for joint in mapped.arm_names)]
    first, second = ([*arm, *(name for name in moving if name not in arm), *numeric])[:2]
    return x or first, y or second


def _scatter(figure: Figure, axes: Axes, mapped: ImpactMap, chosen: tuple[str, str]) -> None:
    table, effect = mapped.table, mapped.objective.effect
    x, y = (table.columns[name] for name in chosen)
    values, overlap = table.columns[effect], table.columns["status"] != "ok"
    axes.scatter(x[overlap], y[overlap], s=9, c="#BBBBBB", marker="x", linewidths=0.7, label="overlap or no rates")
    drawn = axes.scatter(x[~overlap], y[~overlap], s=11, c=values[~overlap], cmap="viridis", linewidths=0)
    order = list(mapped.configurations)
    best = order.index(mapped.best)
    if mapped.of_run is not None:
        axes.plot(x[0], y[0], "*", color=BLACK, markersize=10, linestyle="none", label="as in the run")
    axes.plot(x[best], y[best], "D", color=VERMILION, markersize=6, linestyle="none", label="best")
    axes.set_xlabel(_label(mapped, chosen[0]))
    axes.set_ylabel(_label(mapped, chosen[1]))
    figure.colorbar(drawn, ax=axes, label=_label(mapped, effect), location="top", shrink=0.9, aspect=40)


def _label(mapped: ImpactMap, name: str) -> str:
    """Name of a column in words, with its unit."""
    unit = mapped.table.units[name]
    words = name.removeprefix("q_").removesuffix("_" + unit.replace(" ", "_").replace("/", "_")).replace("_", " ")
    return plain(f"{words}, {unit}" if unit else words)


def _outlines(axes: Axes, mapped: ImpactMap) -> None:
    """The scene in the run, pale, and the robot of the best configuration, dark."""
    target = mapped.target
    plane = min(_PLANES, key=lambda candidate: abs(float(target.outward @ candidate.towards)))
    silhouette = Silhouette(target.system)
    robot, other = hexadecimal(palette.ROBOT), hexadecimal(palette.object_colour(0))
    if mapped.of_run is not None:
        axes.add_collection(_polygons(silhouette, mapped.of_run, plane, {"robot": "#999999"}, 0.25))
    colours = {"robot": robot} | {tree.name: other for tree in target.system.objects}
    axes.add_collection(_polygons(silhouette, mapped.best, plane, colours, 0.45))
    axes.plot(*target.contact.point[plane.axes], "o", color=VERMILION, markersize=3.5, linestyle="none", zorder=40)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.05)
    axes.set_xlabel(f"${plane.names[0]}$, m")
    axes.set_ylabel(f"${plane.names[1]}$, m")
    axes.set_title("robot as in the run (grey) and best (blue)", fontsize=8.0)


def _polygons(
    silhouette: Silhouette, configuration: Configuration, plane: Plane, colours: dict[str, str], strength: float
) -> PolyCollection:
    qpos: FloatArray = configuration.qpos
    shown = [outline for outline in silhouette.outlines(qpos, plane) if outline.tree in colours]
    faces = [(colours[outline.tree], strength) for outline in shown]
    return PolyCollection(
        [outline.points for outline in shown], facecolors=faces, edgecolors=[colours[e.tree] for e in shown], linewidths=0.6
    )


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
        axes: Columns of the figure, see :func:`ffsm_mj.experiments.impact_map.output.draw`.

    Returns:
        The files written.

    Raises:
        InputError: The folder is not writable, or there is no such column.
        OutputLostError: A file could not be written completely.
    """
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


def jump_error(mapped: ImpactMap, path: Path, overrides: Overrides = ()) -> float:
    """Largest difference between the jump of velocities in a run of the best configuration and in the map, rad/s or m/s.

    Raises:
        InputError: The scenario cannot run, or begins with another impact.
    """
    with Simulator(path, overrides, record=False) as simulator:
        simulator.reset()
        events = simulator.step(until="event").events
        impacts = [event for event in events if isinstance(event, ImpactRecord)]
        if [one.pair for one in impacts] != [mapped.target.pair.name]:
            raise InputError(f"{path}: the run does not begin with an impact of {mapped.target.pair.name} alone")
        joints = simulator.system.joints
        jump = [np.subtract(impacts[0].qvel_after[name], impacts[0].qvel_before[name]) for name in joints]
    return float(np.abs(np.concatenate(jump) - mapped.best.jump).max())
