"""The figure of ``docs/co-simulation.md``: ``tap`` as a unit under FMPy, and a simulator beside it: ``make figures``."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.fmu.unit_file import write_unit
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures"
STEP_S, STEPS = 0.005, 399
COMMAND = "actuators.robot_drive_command_N"
SHOWN = ("state.q_robot_stroke_m", "state.v_robot_stroke_m_s", "contact.paddle_force_x_N")


def law(position: float, rate: float) -> float:
    """Effort of the drive, N."""
    return 20.0 * (0.5 - position) - 2.0 * rate


def under_fmpy() -> np.ndarray:
    """Outputs after each step, (STEPS, 3)."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "tap.fmu"
        write_unit(ffsm_mj.Scenario.load("tap", {"duration_s": 2.0}), file)
        description, unzipped = fmpy.read_model_description(str(file)), fmpy.extract(str(file), folder)
        place = {variable.name: variable.valueReference for variable in description.modelVariables}
        name = description.coSimulation.modelIdentifier
        unit = FMU2Slave(guid=description.guid, unzipDirectory=unzipped, modelIdentifier=name)
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.setBoolean([place["robot/drive.external"]], [True])
        unit.exitInitializationMode()
        rows = [unit.getReal([place[name] for name in SHOWN])]
        for step in range(STEPS):
            unit.setReal([place[COMMAND]], [law(*rows[-1][:2])])
            unit.doStep(step * STEP_S, STEP_S)
            rows.append(unit.getReal([place[name] for name in SHOWN]))
        unit.terminate()
        unit.freeInstance()
    return np.array(rows[1:])


def by_simulator() -> tuple[np.ndarray, ffsm_mj.Run]:
    """The same of a simulator, and its run."""
    simulator = ffsm_mj.Simulator("tap", {"duration_s": 2.0})
    observation, joint, rows = simulator.reset(), simulator.system.joints["robot/stroke"], []
    q, v = joint.qpos.start, joint.dofs.start
    for _ in range(STEPS):
        data = observation.data
        observation = simulator.step({"drive": law(data.qpos[q], data.qvel[v])}).observation
        force = sum(contact.force_N[0] for contact in observation.contacts if contact.pair == "paddle")
        rows.append((data.qpos[q], data.qvel[v], force))
    return np.array(rows), simulator.close()


def main() -> None:
    """Run both, print the largest difference, draw, write."""
    outputs, (rows, run) = under_fmpy(), by_simulator()
    print(f"largest difference of {outputs.size} numbers: {np.abs(outputs - rows).max():g}; {len(run.impacts)} impacts")
    time_s = STEP_S * np.arange(1, STEPS + 1)
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.55 * WIDTH_IN))
        stroke, force = figure.subplots(2, 1, sharex=True)
        for axes, column in ((stroke, 0), (force, 2)):
            axes.plot(time_s, rows[:, column], color=BLUE, label="simulator")
            axes.plot(time_s[::8], outputs[::8, column], "o", color=VERMILION, markersize=3, label="unit under FMPy")
            for hit in run.impacts:
                axes.axvline(
                    hit.time_s, color=BLACK, linewidth=0.5, alpha=0.4, label="impact" if hit is run.impacts[0] else None
                )
        stroke.set(ylabel="stroke, m")
        force.set(xlabel="time, s", ylabel="force of the paddle, N")
        stroke.legend()
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "co-simulation", ("svg",))


if __name__ == "__main__":
    main()
