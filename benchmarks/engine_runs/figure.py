"""Error against cost of all settings."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from engine_runs.costs import OURS, PANELS, Row, settings
from ffsm_mj.report.plots.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    WIDTH_IN,
    publication,
    write,
)

GREY, BROWN, OLIVE = "#8C8C8C", "#8B5A2B", "#9A9A00"
COLOURS = {
    "ffsm-mj": BLUE,
    "MuJoCo": VERMILION,
    "Newton": GREEN,
    "Drake": ORANGE,
    "Bullet": PURPLE,
    "ODE": BLACK,
    "Siconos": BROWN,
    "Exudyn": OLIVE,
    "Pinocchio": SKY,
    "Basilisk": GREY,
}
MARKERS = "osD^vPX*"
FLOOR = 1e-17


def draw(rows: list[Row], folder: Path) -> None:
    """``engines.svg``: one panel for each error."""
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.72 * WIDTH_IN))
        for axes, panel in zip(figure.subplots(2, 3).flat, PANELS, strict=True):
            used: dict[str, int] = {}
            for (engine, name), runs in settings(rows, panel).items():
                number = used[engine] = used.get(engine, -1) + 1
                points = sorted((run["cost"], max(run["errors"][panel.key], FLOOR)) for run in runs)
                axes.plot(
                    *zip(*points, strict=True),
                    color=COLOURS[engine],
                    marker=MARKERS[number],
                    markersize=3.0 if (engine, name) != OURS else 4.5,
                    linewidth=0.8 if (engine, name) != OURS else 1.6,
                    zorder=3 if (engine, name) == OURS else 2,
                )
            axes.set(xscale="log", yscale="log", ylim=(0.3 * FLOOR, 30.0))
            axes.set_title(panel.title, fontsize=8.0)
            axes.set_yticks([10.0**power for power in (-17, -14, -11, -8, -5, -2, 1)])
            axes.minorticks_off()
        figure.supxlabel("CPU time per simulated time", fontsize=8.5)
        figure.supylabel("error", fontsize=8.5)
        lines = [figure.axes[0].plot([], [], color=colour, marker="o", markersize=3.0)[0] for colour in COLOURS.values()]
        figure.legend(
            lines,
            list(COLOURS),
            loc="outside upper center",
            ncols=len(COLOURS),
            handlelength=1.2,
            columnspacing=1.0,
            fontsize=7.5,
        )
    write(figure, folder, "engines", ("svg",))
