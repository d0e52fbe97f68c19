"""The figure and the table of ``docs/grippers.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "gripper-2f85"
FINGERS = {"right": BLUE, "left": VERMILION}
HELD_S = 1.6


def size(run: ffsm_mj.Run, start: str) -> np.ndarray:
    """Norm of a force with columns ``<start>_x_N`` and so on, by row."""
    return np.asarray(np.linalg.norm([run[f"{start}_{x}_N"] for x in "xyz"], axis=0))


def table(run: ffsm_mj.Run) -> list[str]:
    """Lines of the table of the page: loads while the cube is held, and the largest ones while it swings."""
    held, swings = int(np.searchsorted(run.time, HELD_S)), (run.time > 0.5) & (run.time < HELD_S)
    lines = [
        "| finger | pad, N | friction, N | share of mu N, largest | pin, N | stop of the coupler, N m |",
        "|---|---|---|---|---|---|",
    ]
    for finger in FINGERS:
        force, friction = (run[f"contact.{finger}_{what}_N"][held] for what in ("force", "friction"))
        use, pin = run[f"contact.{finger}_friction_use"][swings].max(), size(run, f"contact.robot_{finger}_pin_force")[held]
        stop = abs(run[f"contact.robot_{finger}_coupler_limit_torque_N_m"][held])
        lines.append(f"| {finger} | {force:.2f} | {friction:.2f} | {use:.3f} | {pin:.2f} | {stop:.3f} |")
    return lines


def main() -> None:
    """Run the scenario, print the table, draw, write."""
    run = ffsm_mj.run("gripper-2f85")
    print("\n".join(table(run)))
    with publication():
        figure = Figure(figsize=(WIDTH_IN, WIDTH_IN))
        servo, pads, pins, stops = figure.subplots(4, 1, sharex=True)
        servo.step(run.time, run["actuators.robot_fingers_force_N"], where="post", color=BLACK)
        servo.set(ylabel="force of the servo\nalong the tendon, N")
        for finger, colour in FINGERS.items():
            pads.plot(run.time, run[f"contact.{finger}_force_N"], color=colour, label=f"{finger}, normal")
            pads.plot(
                run.time, run[f"contact.{finger}_friction_N"], color=colour, linestyle="--", label=f"{finger}, friction"
            )
            pins.plot(run.time, size(run, f"contact.robot_{finger}_pin_force"), color=colour, label=finger)
            stop = np.abs(run[f"contact.robot_{finger}_coupler_limit_torque_N_m"])
            stops.plot(run.time, stop, color=colour, label=finger)
        pads.set(ylabel="pads on the cube, N")
        pins.set(ylabel="pins between coupler\nand follower, N")
        stops.set(xlabel="time, s", ylabel="stops of the\ncouplers, N m")
        pads.legend(ncols=2)
        pins.legend()
        for axes in (servo, pads, pins, stops):
            for phase in run.phases[1:]:
                axes.axvline(phase.start_s, color="0.7", linewidth=0.7)
        for phase in run.phases:
            servo.text(phase.start_s + 0.02, 4.2, phase.name, fontsize=6, color="0.4")
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "loads", ("svg",))


if __name__ == "__main__":
    main()
