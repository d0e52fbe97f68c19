"""Figures of the comparison: the error after one collision with its floor, and error against effort."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from cells import CELLS, REACH_END_S
from laws import LAWS, Config
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from once import curve
from table import Table, mean_of

from ffsm_mj.report.plots.style import BLACK, COLOURS, LINE_STYLES, WIDTH_IN, publication, write

FOLDER = Path(__file__).resolve().parents[1] / "figures" / "law-comparison"
_COLOUR = {law.name: colour for law, colour in zip(LAWS, COLOURS, strict=False)}
_STYLE = dict(zip(_COLOUR, LINE_STYLES, strict=False))
_TITLE = {law.name: law.title.replace("`", "") for law in LAWS}


def draw(table: Table, once: Config) -> None:
    """Draw all figures."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with publication():
        _errors(once)
        _pareto(table)


def _errors(once: Config) -> None:
    """Error of the tip after the same collision, default and tuned, with the floor."""
    figure = Figure(figsize=(WIDTH_IN, 0.45 * WIDTH_IN), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    floor = np.array(once["floor"])
    times = 0.05 * np.arange(len(floor))
    for each, variant in zip(axes, ("default", "tuned"), strict=True):
        for law in LAWS:
            at, errors = curve(once["restart"][f"{law.name} {variant}"])
            line = {"color": _COLOUR[law.name], "linestyle": _STYLE[law.name]}
            each.plot(at, errors, label=_TITLE[law.name], **line)
        reached = times >= REACH_END_S
        each.fill_between(times[reached], floor[reached], color=BLACK, alpha=0.15, linewidth=0)
        each.plot(times[reached], floor[reached], color=BLACK, linewidth=1.0, label="floor: the target is out of reach")
        each.axvline(once["start_s"], color=BLACK, linewidth=0.6, linestyle=":")
        each.axvline(REACH_END_S, color=BLACK, linewidth=0.6, linestyle="--")
        each.set_title(f"{variant} parameters")
        each.set_xlabel("time, s")
        each.set_xlim(9.0, 30.0)
        each.set_ylim(0.0, 1.5)
    axes[0].set_ylabel("error of the tip, m")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    write(figure, FOLDER, "errors", ("svg",))


def _pareto(table: Table) -> None:
    """Integral of the squared error against that of the squared torques."""
    cells = [name for name in table.cells if table.common(name)]
    figure = Figure(figsize=(WIDTH_IN, 0.46 * WIDTH_IN * ((len(cells) + 1) // 2)), layout="constrained")
    panels = figure.subplots((len(cells) + 1) // 2, 2, squeeze=False).ravel()
    for axes, cell in zip(panels, cells, strict=False):
        _pareto_of_cell(axes, table, cell)
    for axes in panels[len(cells) :]:
        axes.set_axis_off()
    handles: dict[str, Any] = {}
    for axes in panels[: len(cells)]:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend([*handles.values()], [*handles], loc="outside lower center", ncols=3)
    write(figure, FOLDER, "pareto", ("svg",))


def _pareto_of_cell(axes: Axes, table: Table, cell: str) -> None:
    """The points that were tried, faint, where the cell has some; default and tuned parameters in the judged runs."""
    for law in CELLS[cell].laws:
        colour = _COLOUR[law.name]
        tried = [runs for _, runs in table.points(cell, law.name)]
        pairs = [(mean_of(runs, "effort_integral"), mean_of(runs, "error_integral")) for runs in tried]
        axes.plot(*_columns(pairs), ".", color=colour, alpha=0.5, markersize=5, markeredgewidth=0)
        for variant, marker in (("default", "o"), ("tuned", "*")):
            effort, error = (
                table.values(cell, law.name, variant, metric) for metric in ("effort_integral", "error_integral")
            )
            if np.isfinite(effort).any():
                of = {"color": colour, "marker": marker, "markersize": 5 if marker == "o" else 8, "linestyle": "none"}
                edge = {"markeredgecolor": BLACK, "markeredgewidth": 0.5}
                label = _TITLE[law.name] if variant == "default" else None
                axes.plot(float(np.nanmedian(effort)), float(np.nanmedian(error)), label=label, **of, **edge)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(CELLS[cell].title.replace("`", ""))
    axes.set_xlabel(r"$\int |u|^2\,\mathrm{d}t$, (N m)$^2$ s")
    axes.set_ylabel(r"$\int |e|^2\,\mathrm{d}t$, m$^2$ s")


def _columns(pairs: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [first for first, _ in pairs], [second for _, second in pairs]
