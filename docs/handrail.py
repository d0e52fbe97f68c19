"""The figures and the table of ``docs/missions.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from matplotlib.figure import Figure
from piece_pictures import colours, mark_phases, rendered, save

import ffsm_mj
from ffsm_mj.report.plots.style import BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "handrail"
PADS = ("left", "right")
JOINT_MM = 20.0
"""Joint of rail and rung, from the middle of the rail."""
PAD_MM = 13.0
"""Half width of a pad."""
VIEWS = (0.0, (-0.1, 0.0, -0.1), 2.0, 55.0), (1.4, (0.0, 0.0, 0.0), 0.45, 60.0), (7.0, (0.0, 0.0, 0.0), 0.45, 60.0)
"""Time of each picture, s; its middle from the grip, m; distance of the camera, m; azimuth, degrees."""


def at(run: ffsm_mj.Run, data: Any, time_s: float) -> None:
    """Set the poses of the run at an instant."""
    data.qpos[:] = run.qpos[int(np.searchsorted(run.time, time_s))]
    mujoco.mj_forward(data.model, data)


def on_bar(run: ffsm_mj.Run) -> np.ndarray:
    """Middle of the pads across the rail in the axes of the frame, from the middle of the rail, by row, (n,), m."""
    model = ffsm_mj.Scenario.load("handrail").system.mj
    data = mujoco.MjData(model)
    pad, frame, rail = model.geom("robot/left_pad").id, model.body("frame/frame").id, model.geom("frame/rail_near_middle").id
    places = []
    for row in run.qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        local = data.xmat[frame].reshape(3, 3).T @ (data.geom_xpos[pad] - data.geom_xpos[rail])
        places.append(local[0])
    return np.array(places)


def table(run: ffsm_mj.Run, places: np.ndarray) -> None:
    """Print what the pads do by phase."""
    print("| end of | t, s | pads from the middle of the rail, mm | force of a pad, N | friction, N | share of mu N |")
    print("|---|---|---|---|---|---|")
    ends = [*[record.start_s for record in run.records["phases"]][1:], float(run.time[-1])]
    for record, end_s in zip(run.records["phases"], ends, strict=True):
        row = int(np.searchsorted(run.time, end_s)) - 1
        force, friction, use = (run[f"contact.left_{what}"][row] for what in ("force_N", "friction_N", "friction_use"))
        print(f"| `{record.name}` | {end_s:.1f} | {1e3 * places[row]:.1f} | {force:.3f} | {friction:.3f} | {use:.3f} |")
    sticks = run.records["contact_sticks"][0].time_s
    held = run.time > sticks
    print(f"\npads stick from {sticks:.6f} s; then they move by {1e3 * np.ptp(places[held]):.1e} mm on the bar")
    print(f"slid: {1e3 * run['contact.left_slip_m'][-1]:.2f} mm, heat {1e3 * run['contact.left_heat_J'][-1]:.3f} mJ a pad")
    print(f"energy of projections: {run['balance.projected_contacts_J'].max():.1e} J at most")


def pieces(run: ffsm_mj.Run, path: Path) -> None:
    """Draw the gripper on the frame whose bars have a colour each: from afar, as the pads touch, and as they hold."""
    model = ffsm_mj.Scenario.load("handrail").system.mj
    data = mujoco.MjData(model)
    bars = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("frame/")]
    for geom, tint in zip(bars, colours(len(bars)), strict=True):
        model.geom_matid[geom], model.geom_rgba[geom], model.geom_group[geom] = -1, tint, 0
    pictures = []
    for time_s, beside, distance, azimuth in VIEWS:
        at(run, data, time_s)
        lookat = data.site("robot/grip").xpos + beside
        pictures.append(rendered(model, data, lookat=lookat, distance=distance, azimuth=azimuth, elevation=-30.0))
    save(pictures, path)


def motion(run: ffsm_mj.Run, places: np.ndarray) -> Figure:
    """Way of the pads over the joint, force and friction."""
    figure = Figure(figsize=(WIDTH_IN, 0.75 * WIDTH_IN))
    way, force, friction = figure.subplots(3, 1, sharex=True)
    way.plot(run.time, 1e3 * places, color=BLUE)
    way.fill_between(run.time, 1e3 * places - PAD_MM, 1e3 * places + PAD_MM, color=BLUE, alpha=0.2, linewidth=0.0)
    way.axhline(JOINT_MM, color="0.4", linestyle="--")
    way.text(run.time[-1], JOINT_MM - 1.0, "joint of rail and rung", ha="right", va="top")
    way.set(ylabel="pads on\nthe bar, mm")
    for pad, colour, style in zip(PADS, (BLUE, VERMILION), ("-", "--"), strict=True):
        force.plot(run.time, run[f"contact.{pad}_force_N"], color=colour, linestyle=style, label=pad)
        friction.plot(run.time, run[f"contact.{pad}_friction_N"], color=colour, linestyle=style)
    force.set(ylabel="force of\na pad, N", yscale="log", ylim=(0.1, 40.0))
    force.legend()
    friction.set(xlabel="time, s", ylabel="friction of\na pad, N")
    mark_phases(run, (way, force, friction))
    return figure


def main() -> None:
    """Run the scenario, print the table, draw, write."""
    run = ffsm_mj.run("handrail")
    places = on_bar(run)
    table(run, places)
    FOLDER.mkdir(parents=True, exist_ok=True)
    with publication():
        write(motion(run, places), FOLDER, "grasp", ("svg",))
    pieces(run, FOLDER / "pieces.png")


if __name__ == "__main__":
    main()
