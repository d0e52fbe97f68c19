"""The figure of ``docs/capture-detumble.md``, and its table: starts that saturate a wheel, with thrusters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "capture-detumble"
SATURATED = (3, 8, 10, 12)
"""Starts of the campaign that wheels alone cannot take."""
JETS = [f"jet_{face}_{i}" for face in ("front", "rear", "left", "right", "top", "bottom") for i in (1, 2)]
LEFT, WHEELS = "controller.stack_momentum_N_m_s", "controller.wheel_momentum_N_m_s"


def helped(number: int) -> Any:
    """The run of one start of the campaign with thrusters."""
    overrides = load_campaign("capture-detumble-dispersed").design().overrides(number)
    return ffsm_mj.run("capture-detumble", {**overrides, "phases.2.controller.thrusters": JETS})


def draw(axes: Axes, run: Any, title: str) -> None:
    """Angular momentum of the wheels and of the stack without them, over the time since the capture."""
    time = np.asarray(run.time) - run.grasps[0].time_s
    axes.semilogy(time, run[LEFT], color=BLUE, label="stack without wheels")
    axes.semilogy(time, run[WHEELS], color=BLACK, label="wheels")
    axes.axhline(1e-6, color=VERMILION, linewidth=0.8, linestyle="--", label="check at the end")
    axes.set_xlim(0.0, time[-1])
    axes.set_ylim(1e-9, 5.0)
    axes.set_xlabel("time since the capture, s")
    axes.set_title(title)


def main() -> None:
    """Run the scenario and the starts that saturate a wheel, draw two of them, print the table."""
    print("| start | wheel full at, s | left with thrusters, N m s | out by thrusters, N m s |\n|---|---|---|---|")
    first = None
    for number in SATURATED:
        run = helped(number)
        first, found = first or run, ffsm_mj.angular_momentum(run)
        full = run.summary()["controller"]["phases"][2]["reports"]["grasp: saturated_s"]
        out = np.linalg.norm(found["external_N_m_s"])
        print(f"| {number} | {full:.2f} | {found['stack_without_wheels_N_m_s']:.1e} | {out:.3f} |", flush=True)
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.42 * WIDTH_IN), layout="constrained")
        both = figure.subplots(1, 2, sharey=True)
        draw(both[0], ffsm_mj.run("capture-detumble"), "wheels alone")
        draw(both[1], first, f"start {SATURATED[0]}: a wheel is full, thrusters")
        both[0].set_ylabel("|L|, N m s")
        both[1].legend(loc="lower left")
        FOLDER.mkdir(parents=True, exist_ok=True)
        write(figure, FOLDER, "momentum", ("svg",))


if __name__ == "__main__":
    main()
