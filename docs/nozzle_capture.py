"""The figures and the table of ``docs/missions.md``, from the scenario as it is: ``make figures``."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure
from piece_pictures import colours, mark_phases, model_of, rendered, save

import ffsm_mj
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "nozzle-capture"
PINS = ("pin_1", "pin_2", "pin_3")
APART = 0.5
"""How far pieces are moved apart in the figure, as a share of their distances from the middle of the nozzle."""
THROAT_MM = 460.0, 500.0
"""The throat along the axis, from the exit."""


def in_nozzle(run: ffsm_mj.Run) -> np.ndarray:
    """Place of the head of the probe in the axes of the stage, its x from the exit of the nozzle, by row, (n, 3), m."""
    model = ffsm_mj.Scenario.load("nozzle-capture").system.mj
    data = mujoco.MjData(model)
    head, stage, nozzle = model.site("robot/head").id, model.body("stage/stage").id, model.site("stage/chamber").id
    exit_m = model.site_pos[nozzle] - (0.6, 0.0, 0.0)
    places = []
    for row in run.qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        places.append(data.xmat[stage].reshape(3, 3).T @ (data.site_xpos[head] - data.xpos[stage]) - exit_m)
    return np.array(places)


def table(run: ffsm_mj.Run, places: np.ndarray) -> None:
    """Print the impacts, and what the pins carry at the end."""
    print("| t, s | what | impulse, N s | head from the exit, mm | beside the axis, mm |")
    print("|---|---|---|---|---|")
    for record in run.impacts:
        if record.impulse_N_s > 0.01:
            x, y, z = 1e3 * places[int(np.searchsorted(run.time, record.time_s))]
            what = record.geoms[0].removeprefix("robot/")
            print(f"| {record.time_s:.3f} | {what} | {record.impulse_N_s:.3f} | {x:.0f} | {np.hypot(y, z):.1f} |")
    print("\n| pin | force at the end, N | friction, N | share of mu N, largest at rest | slid, mm |")
    print("|---|---|---|---|---|")
    for pin in PINS:
        force, friction, use = (run[f"contact.{pin}_{what}"] for what in ("force_N", "friction_N", "friction_use"))
        still = run.time > run.time[-1] - 3.0
        slip = 1e3 * run[f"contact.{pin}_slip_m"][-1]
        print(f"| {pin} | {force[-1]:.2f} | {friction[-1]:.3f} | {use[still].max():.3f} | {slip:.1f} |")
    still = run.time > run.time[-1] - 3.0
    print(f"\nhead against the stage in the last 3 s: {1e3 * np.ptp(places[still], axis=0).max():.1e} mm")


def pieces(path: Path) -> int:
    """Draw the pieces of the nozzle behind a cut through its axis, as it is and moved apart; returns their number."""
    system = ffsm_mj.Scenario.load("nozzle-capture").system
    geom, turn = system.index("geom", "stage/nozzle"), np.empty(9)
    mujoco.mju_quat2Mat(turn, system.mj.geom_quat[geom])
    parts = [part.moved(np.zeros(3), turn.reshape(3, 3)).vertices for part in system.pieces[geom]]
    half = [(part, tint) for part, tint in zip(parts, colours(len(parts)), strict=True) if part.mean(axis=0)[1] > 0.0]
    pictures = []
    for apart in (0.0, APART):
        model = model_of([part + apart * part.mean(axis=0) for part, _ in half], [tint for _, tint in half])
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        pictures.append(rendered(model, data, lookat=(0.05, 0.1, 0.07), distance=1.2, azimuth=70.0, elevation=-20.0))
    save(pictures, path)
    return len(parts)


def motion(run: ffsm_mj.Run, places: np.ndarray) -> Figure:
    """Way of the head into the nozzle, forces on the wall."""
    figure = Figure(figsize=(WIDTH_IN, 0.75 * WIDTH_IN))
    way, beside, force = figure.subplots(3, 1, sharex=True)
    way.plot(run.time, 1e3 * places[:, 0], color=BLUE)
    way.axhspan(*THROAT_MM, color="0.85")
    way.text(run.time[-1], sum(THROAT_MM) / 2.0, "throat", ha="right", va="center")
    way.set(ylabel="head from\nthe exit, mm")
    beside.plot(run.time, 1e3 * np.hypot(places[:, 1], places[:, 2]), color=BLUE)
    beside.set(ylabel="head beside\nthe axis, mm")
    for pin, colour in zip(PINS, (BLUE, VERMILION, BLACK), strict=True):
        force.plot(run.time, run[f"contact.{pin}_force_N"], color=colour, label=pin)
    force.set(xlabel="time, s", ylabel="force of the pins\non the wall, N")
    force.legend()
    mark_phases(run, (way, beside, force))
    return figure


def main() -> None:
    """Run the scenario, print the tables, draw, write."""
    run = ffsm_mj.run("nozzle-capture")
    places = in_nozzle(run)
    table(run, places)
    FOLDER.mkdir(parents=True, exist_ok=True)
    with publication():
        write(motion(run, places), FOLDER, "capture", ("svg",))
    print(f"pieces of the nozzle: {pieces(FOLDER / 'pieces.png')}")


if __name__ == "__main__":
    main()
