"""The figure of ``docs/grippers.md``, from the scenario as it is: ``make figures``.

Above the pads' friction force as a share of 2 mu N, below the distance that the cube has slipped in the left pad.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "squeeze"
LIMIT_N = 2 * 0.3 * 15.0


def main() -> None:
    """Run the scenario, draw, write."""
    run = ffsm_mj.run("squeeze")
    force = sum(np.stack([run[f"contact.{side}_friction_{axis}_N"] for axis in "xyz"], axis=1) for side in ("left", "right"))
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.55 * WIDTH_IN))
        forces, slip = figure.subplots(2, 1, sharex=True)
        forces.plot(run.time, np.linalg.norm(force, axis=1) / LIMIT_N, color=BLUE)
        forces.axhline(1.0, color=VERMILION, linewidth=0.8)
        forces.set(ylabel=r"friction over $2 \mu N$", ylim=(0.0, 1.1))
        for record in run.records["phases"]:
            forces.axvline(record.start_s, color="0.7", linewidth=0.6)
            forces.text(record.start_s + 0.01, 0.92, record.name, fontsize=6, color="0.4", rotation=90, va="top")
        slip.plot(run.time, 1e3 * run["contact.left_slip_m"], color=BLUE)
        slip.set(xlabel="time, s", ylabel="slip in the left pad, mm")
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "grip", ("svg",))


if __name__ == "__main__":
    main()
