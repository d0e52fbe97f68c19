"""The figure and the table of ``docs/missions.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "probe-and-cone"
LOADS = tuple(f"contact.grasp_{load}" for load in ("force_{}_N", "torque_{}_N_m"))


def relative_motion(run: ffsm_mj.Run) -> dict[str, np.ndarray]:
    """Motion of the cone against the head of the probe, along, beside and about its axis, and of the load, by row."""
    model = ffsm_mj.Scenario.load("probe-and-cone").system.mj
    data = mujoco.MjData(model)
    head, cone = (model.site(name).id for name in ("robot/head", "satellite/cone"))
    force, torque = (np.column_stack([run[key.format(x)] for x in "xyz"]) for key in LOADS)
    found = []
    for row in range(len(run.time)):
        data.qpos[:] = run.qpos[row]
        mujoco.mj_kinematics(model, data)
        one, other = (data.site_xmat[site].reshape(3, 3) for site in (head, cone))
        turn, axis = one.T @ other, one[:, 0]
        roll = np.arctan2(turn[2, 1] - turn[1, 2], turn[1, 1] + turn[2, 2])
        offset = data.site_xpos[cone] - data.site_xpos[head]
        along = axis @ offset
        beside = np.linalg.norm(offset - along * axis)
        across = np.linalg.norm(force[row] - axis @ force[row] * axis)
        found.append((along, beside, roll, axis @ force[row], across, axis @ torque[row]))
    names = "distance_m", "beside_m", "roll_rad", "axial_N", "across_N", "axial_N_m"
    return dict(zip(names, np.array(found).T, strict=True))


def table(run: ffsm_mj.Run, moved: dict[str, np.ndarray]) -> None:
    """Print the impact and the grasps, and the largest axial load while only the soft latch holds."""
    for hit in run.impacts:
        row = int(np.searchsorted(run.time, hit.time_s))
        place = f"{moved['distance_m'][row]:.3f} m before the bottom and {moved['beside_m'][row]:.3f} m beside the axis"
        speeds = f"{hit.approach_speed_m_s:.4f} and {hit.separation_speed_m_s:.4f} m/s"
        print(f"{hit.pair}: {hit.time_s:.3f} s, {hit.impulse_N_s:.3f} N s, {speeds}, {place}\n")
    print("| latch | t, s | stopped components | loss, J | impulse, N s | along the axis, m | beside it, m | roll, rad |")
    print("|---|---|---|---|---|---|---|---|")
    for record in run.records["grasp_impulses"]:
        row = int(np.searchsorted(run.time, record.time_s))
        size = float(np.linalg.norm(record.impulse_N_s))
        place = " | ".join(f"{moved[key][row]:.3f}" for key in ("distance_m", "beside_m", "roll_rad"))
        print(f"| {record.grasp} | {record.time_s:.3f} | {record.rank} | {record.loss_J:.2e} | {size:.3f} | {place} |")
    soft = run["contact.grasp_closed"] == 1.0
    axial, across = (float(np.abs(moved[name][soft]).max()) for name in ("axial_N", "across_N"))
    print(f"\nsoft latch: largest force across the axis {across:.2e} N, along it {axial:.0e} N")


def main() -> None:
    """Run the scenario, print the table, draw, write."""
    run = ffsm_mj.run("probe-and-cone")
    moved = relative_motion(run)
    table(run, moved)
    shown = run.time < 20.0
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.75 * WIDTH_IN))
        distance, roll, force = figure.subplots(3, 1, sharex=True)
        distance.plot(run.time[shown], 1e3 * moved["distance_m"][shown], color=BLUE, label="along the axis")
        distance.plot(run.time[shown], 1e3 * moved["beside_m"][shown], color=VERMILION, label="beside it")
        distance.set(ylabel="head from the\nbottom, mm")
        distance.legend()
        roll.plot(run.time[shown], moved["roll_rad"][shown], color=VERMILION)
        roll.set(ylabel="roll, rad")
        force.plot(run.time[shown], 1e3 * moved["across_N"][shown], color=BLUE, label="across the axis")
        force.plot(run.time[shown], 1e3 * np.abs(moved["axial_N"][shown]), color=VERMILION, label="along the axis")
        force.set(xlabel="time, s", ylabel="force on the\nsatellite, mN")
        force.legend()
        for axes in (distance, roll, force):
            for record in (*run.impacts, *run.records["grasp_impulses"]):
                axes.axvline(record.time_s, color="0.6", linewidth=0.7)
        for hit in run.impacts:
            distance.text(hit.time_s - 0.15, 110.0, "cone", fontsize=6, color="0.4", ha="right")
        for record, side in zip(run.records["grasp_impulses"], ("right", "left"), strict=True):
            place = record.time_s + (0.15 if side == "left" else -0.15)
            distance.text(place, 110.0, f"{record.grasp} latch", fontsize=6, color="0.4", ha=side)
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "approach", ("svg",))


if __name__ == "__main__":
    main()
