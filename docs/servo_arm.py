"""The figure and the table of ``docs/grippers.md``, from the scenario as it is and with other drives: ``make figures``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.report.plots.style import BLUE, GREEN, ORANGE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "servo-arm"
JOINTS = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
MOTORS = {
    "actuators": {joint: {"kind": "torque"} for joint in JOINTS},
    "phases.before.controller.bandwidth_Hz": 2.0,
    "phases.after.controller.bandwidth_Hz": 2.0,
}
SMOOTH = {"robot.strip": ["frictionloss"]}
DRIVES: dict[str, tuple[dict[str, Any], str, str]] = {
    "servos": ({}, BLUE, "-"),
    "servos, no friction": (SMOOTH, GREEN, "--"),
    "ideal motors": (MOTORS, VERMILION, "-"),
    "ideal motors, no friction": (MOTORS | SMOOTH, ORANGE, "--"),
}
"""Overrides, colour and line style of each variant."""


def deflection_m(run: ffsm_mj.Run) -> np.ndarray:
    """Distance of the tip from where it was at the start, seen from the bus, by row."""
    model = prepare("servo-arm").system.mj
    data, tip, bus = mujoco.MjData(model), model.site("robot/tip").id, model.body("robot/bus").id
    places = []
    for qpos in run.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places.append((data.site_xpos[tip] - data.xpos[bus]) @ data.xmat[bus].reshape(3, 3))
    return np.asarray(np.linalg.norm(np.array(places) - places[0], axis=1))


def torque_N_m(run: ffsm_mj.Run, joint: str) -> np.ndarray:
    """Torque of a servo or motor on its joint, by row."""
    start = f"actuators.robot_{joint}"
    return np.asarray(
        run[f"{start}_force_N_m" if f"{start}_force_N_m" in run.log.header.layout.index else f"{start}_applied_N_m"]
    )


def heat_J(run: ffsm_mj.Run) -> np.ndarray:
    """Heat of the dry friction of the joints, by row."""
    column = "balance.total_joint_friction_heat_J"
    return np.asarray(run[column]) if column in run.log.header.layout.index else np.zeros(len(run.time))


def table(runs: dict[str, ffsm_mj.Run]) -> list[str]:
    """Lines of the table of the page."""
    columns = (
        "drives",
        "impacts",
        "impulse, N s",
        "speed of the debris after, m/s",
        "deflection, mm",
        "at the end, mm",
        "largest torque of the elbow, N m",
        "work of the drives, J",
        "heat of friction, J",
    )
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for name, run in runs.items():
        impulse = sum(each.impulse_N_s for each in run.impacts) + float(run["contact.debris_impulse_N_s"][-1])
        moved, torque = 1e3 * deflection_m(run), np.abs(torque_N_m(run, "elbow")).max()
        motion = f"{run['state.v_debris_free_vx_m_s'][-1]:.3f} | {moved.max():.1f} | {moved[-1]:.2f}"
        energy = f"{run['balance.work_J'][-1]:.3f} | {heat_J(run)[-1]:.3f}"
        lines.append(f"| {name} | {len(run.impacts)} | {impulse:.2f} | {motion} | {torque:.0f} | {energy} |")
    return lines


def main() -> None:
    """Run the scenario with each drive, print the table, draw, write."""
    runs = {name: ffsm_mj.run("servo-arm", overrides) for name, (overrides, _, _) in DRIVES.items()}
    print("\n".join(table(runs)))
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.8 * WIDTH_IN))
        moved, torque, heat = figure.subplots(3, 1, sharex=True)
        for name, (_, colour, style) in DRIVES.items():
            run = runs[name]
            looks = {"color": colour, "linestyle": style, "label": name}
            moved.plot(run.time, 1e3 * deflection_m(run), **looks)
            torque.step(run.time, torque_N_m(run, "elbow"), where="post", **looks)
            heat.plot(run.time, heat_J(run), **looks)
        moved.set(ylabel="tip from its place, mm")
        torque.set(ylabel="torque of the elbow, N m")
        torque.legend(loc="lower right")
        heat.set(xlim=(0.1, 1.6), xlabel="time, s", ylabel="heat of friction, J")
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "drives", ("svg",))


if __name__ == "__main__":
    main()
