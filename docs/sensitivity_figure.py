"""The figure of ``docs/sensitivity.md``: outcomes over the place of the object, from runs, with secant and derivative."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "sensitivity"
SIGMA_M = 0.01
TIP_SIGMA_M = 0.002


def impulses(axes: Axes) -> None:
    """Impulse of the first impact of ``coasting`` over the place of the box."""
    key, place = "initial.joints.object/y", -0.5
    run = ffsm_mj.run("coasting", {"duration_s": 5.5})
    offsets = SIGMA_M * np.linspace(-2.0, 2.0, 9)
    found = [ffsm_mj.run("coasting", {"stop_on_impact": True, key: place + y}).impacts[0].impulse_N_s for y in offsets]
    secant = ffsm_mj.sensitivity(run, "impacts.0.impulse_N_s", {key: SIGMA_M})
    slope = ffsm_mj.sensitivity(run, "impacts.0.impulse_N_s", {key: SIGMA_M}, "exact").derivative[0, 0]
    axes.plot(1e3 * offsets, found, "o", color=BLACK, markersize=3.5, label="runs")
    axes.plot(1e3 * offsets, secant.nominal[0] + slope * offsets, color=BLUE, label="derivative")
    ends = [secant.low[0, 0], secant.high[0, 0]]
    axes.plot([-1e3 * SIGMA_M, 1e3 * SIGMA_M], ends, "s--", color=VERMILION, markersize=5, fillstyle="none", label="secant")
    axes.set_xlabel("box moved along y, mm")
    axes.set_ylabel("impulse, N s")
    axes.set_title("coasting: a smooth outcome")


def tip_errors(axes: Axes) -> None:
    """Final error of the tip of ``baseline`` at 12 s over the place of the box: a staircase of control ticks."""
    key, place, short = "initial.joints.object/x", 3.5, {"duration_s": 12.0, "log.rerun": False}
    offsets = TIP_SIGMA_M * np.linspace(-1.0, 1.0, 25)
    found = [ffsm_mj.run("baseline", short | {key: place + x}).summary()["tip"]["final_error_m"] for x in offsets]
    ends = [0, -1]
    axes.plot(1e3 * offsets, found, "o", color=BLACK, markersize=3.0)
    axes.plot(1e3 * offsets[ends], np.array(found)[ends], "s--", color=VERMILION, markersize=5, fillstyle="none")
    axes.set_xlabel("box moved along x, mm")
    axes.set_ylabel("final error of the tip, m")
    axes.set_title("baseline: a staircase of control ticks")


def main() -> None:
    """Draw both."""
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.42 * WIDTH_IN), layout="constrained")
        left, right = figure.subplots(1, 2)
        impulses(left)
        tip_errors(right)
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "place", ("svg",))


if __name__ == "__main__":
    main()
