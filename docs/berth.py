"""The figure and the table of ``docs/missions.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLUE, GREEN, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "berth"
GRASPS = {"left": BLUE, "right": VERMILION, "port": GREEN}


def distance_m(run: ffsm_mj.Run) -> np.ndarray:
    """Distance of the ring of the satellite from the port, by row."""
    model = ffsm_mj.Scenario.load("berth").system.mj
    data = mujoco.MjData(model)
    port, ring = (model.site(name).id for name in ("robot/port", "satellite/ring"))
    found = []
    for qpos in run.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        found.append(float(np.linalg.norm(data.site_xpos[ring] - data.site_xpos[port])))
    return np.array(found)


def load(run: ffsm_mj.Run, grasp: str, what: str) -> np.ndarray:
    """Norm of force (``force_{}_N``) or torque (``torque_{}_N_m``) of a grasp on the satellite, by row; NaN while open."""
    start = f"contact.grasp_{grasp}_"
    size = np.linalg.norm([run[f"{start}{what.format(x)}"] for x in "xyz"], axis=0)
    return np.where(run[f"{start}closed"] > 0.0, size, np.nan)


def table(run: ffsm_mj.Run) -> None:
    """Print the closings and the peak loads."""
    intervals = {each.grasp: each for each in run.grasps}
    print("| grasp | t, s | rank | mobility | loss, J | impulse, N s | peak force, N | peak torque, N m | opens, s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for record in run.records["grasp_impulses"]:
        each = intervals[record.grasp]
        counted = f"{record.rank} | {record.mobility}"
        effect = f"{record.loss_J:.2e} | {np.linalg.norm(record.impulse_N_s):.3f}"
        peaks = f"{each.peak_force_N:.2f} | {each.peak_torque_N_m:.2f}"
        opens = f"{each.release_s:.2f}" if each.release_s is not None else ""
        print(f"| {record.grasp} | {record.time_s:.3f} | {counted} | {effect} | {peaks} | {opens} |")


def main() -> None:
    """Run the scenario, print the table, draw, write."""
    run = ffsm_mj.run("berth")
    table(run)
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.8 * WIDTH_IN))
        place, force, torque = figure.subplots(3, 1, sharex=True)
        place.plot(run.time, distance_m(run), color="0.2")
        place.set(ylabel="ring from port, m")
        for grasp, colour in GRASPS.items():
            force.plot(run.time, load(run, grasp, "force_{}_N"), color=colour, label=grasp)
            torque.plot(run.time, load(run, grasp, "torque_{}_N_m"), color=colour, label=grasp)
        force.set(ylabel="force on the\nsatellite, N")
        torque.set(xlabel="time, s", ylabel="torque, N m")
        force.legend()
        for axes in (place, force, torque):
            for phase in run.phases[1:]:
                axes.axvline(phase.start_s, color="0.7", linewidth=0.7)
        for phase in run.phases:
            if phase.name in ("approach", "second_grasp", "bring_in", "hand_over"):
                place.text(phase.start_s + 0.3, 0.12, phase.name, fontsize=6, color="0.4")
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "loads", ("svg",))


if __name__ == "__main__":
    main()
