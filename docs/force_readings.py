"""The figure and the table of ``docs/sensors.md``, from ``probe-and-cone`` as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLACK, BLUE, GREEN, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "probe-and-cone"
SENSORS = {"cell": BLACK, "contact": VERMILION, "grasp": BLUE, "tool": GREEN}
"""What the load cell reads, and its parts, with their colours."""


def vectors(run: ffsm_mj.Run, what: str, unit: str) -> dict[str, np.ndarray]:
    """A column of three components of the cell and of its parts, (n, 3), in axes of its site."""
    names = {part: "cell" if part == "cell" else f"cell_{part}" for part in SENSORS}
    return {part: np.column_stack([run[f"sensor.{name}_{what}_{x}_{unit}"] for x in "xyz"]) for part, name in names.items()}


def events(run: ffsm_mj.Run) -> dict[str, float]:
    """Times of the impact and of the closings, by their names."""
    closings = {f"{record.grasp} latch": record.time_s for record in run.records["grasp_impulses"]}
    return {"cone": run.impacts[0].time_s} | closings


def impulses(run: ffsm_mj.Run) -> dict[tuple[str, float, str], dict[str, float]]:
    """Impulses along the probe and across it of the cell and its parts, by event, its time and direction."""
    parts, found = vectors(run, "impulse", "N_s"), {}
    for name, time_s in events(run).items():
        # The sample that is taken after the event is the first that has it.
        row = int(np.searchsorted(run["sensor.cell_sampled_s"], time_s))
        found[name, time_s, "along"] = {part: float(value[row, 0]) for part, value in parts.items()}
        found[name, time_s, "across"] = {part: float(np.linalg.norm(value[row, 1:])) for part, value in parts.items()}
    return found


def main() -> None:
    """Run the scenario, print the table, draw, write."""
    run = ffsm_mj.run("probe-and-cone", {"duration_s": 20.0})
    found, means, held_s = impulses(run), vectors(run, "mean", "N"), events(run)["hard latch"] + 0.05
    print("| event | t, s | direction | " + " | ".join(SENSORS) + " |")
    print("|---|---|---|" + "---|" * len(SENSORS))
    for (name, time_s, direction), parts in found.items():
        print(f"| {name} | {time_s:.3f} | {direction} | " + " | ".join(f"{abs(v):.4f}" for v in parts.values()) + " |")
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.62 * WIDTH_IN))
        hits, hold = figure.subplots(2, 1)
        for i, (part, colour) in enumerate(SENSORS.items()):
            places = np.arange(len(found)) + 0.2 * (i - 1.5)
            hits.bar(places, [abs(parts[part]) for parts in found.values()], width=0.18, color=colour, label=part)
        hits.set_xticks(range(len(found)), [f"{name},\n{direction}" for name, _, direction in found])
        hits.set(ylabel="impulse, N s")
        hits.legend(ncols=len(SENSORS), loc="upper left")
        held = run.time > held_s
        for part, colour in SENSORS.items():
            style = (0, (4, 3)) if part == "cell" else "-"
            force = 1e3 * np.linalg.norm(means[part][held], axis=1)
            hold.plot(run.time[held], force, color=colour, linestyle=style, zorder=3 if part == "cell" else 2, label=part)
        hold.set(xlabel="time, s", ylabel="force while the\nhard latch holds, mN")
        hold.legend()
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "force_readings", ("svg",))


if __name__ == "__main__":
    main()
