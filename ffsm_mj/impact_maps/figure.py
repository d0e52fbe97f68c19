"""Figure of an impact map: an effect over two coordinates, and the robot as it arrives and in the best configuration."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.impact_maps.configuration import Configuration
from ffsm_mj.impact_maps.impact_map import ImpactMap
from ffsm_mj.log import palette
from ffsm_mj.log.palette import hexadecimal
from ffsm_mj.report.plots.silhouette import Plane, Silhouette
from ffsm_mj.report.plots.style import BLACK, VERMILION, WIDTH_IN, plain, publication

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
    plane = min(_PLANES, key=lambda each: abs(float(target.outward @ each.towards)))
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
    shown = [each for each in silhouette.outlines(qpos, plane) if each.tree in colours]
    faces = [(colours[each.tree], strength) for each in shown]
    return PolyCollection(
        [each.points for each in shown], facecolors=faces, edgecolors=[colours[e.tree] for e in shown], linewidths=0.6
    )
