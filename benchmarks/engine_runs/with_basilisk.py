"""Basilisk's MJScene: MuJoCo's dynamics under Basilisk's integrators; free flight and MuJoCo's weld."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from engine_runs.mjcf import whole
from engine_runs.scene import Scene
from engine_runs.states import States
from engine_runs.with_mujoco import Recipe, built, states


def run(scene: Scene, recipe: Recipe, step_s: float, *, high_order: bool) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of ``ExecuteSimulation``."""
    from Basilisk.simulation import mujoco as basilisk
    from Basilisk.simulation import svIntegrators
    from Basilisk.utilities import SimulationBaseClass, macros

    model, data = built(scene, recipe, step_s)
    simulation = SimulationBaseClass.SimBaseClass()
    task = simulation.CreateNewProcess("process")
    task.addTask(simulation.CreateNewTask("task", macros.sec2nano(step_s)))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.xml"
        path.write_text(whole(scene, "", geom=recipe.geom, weld=recipe.weld))
        mjscene = basilisk.MJScene.fromFile(str(path))
    mjscene.extraEoMCall = True
    mjscene.highOrderAttitudeIntegration = high_order
    simulation.AddModelToTask("task", mjscene)
    integrator = svIntegrators.svIntegratorRK4(mjscene)
    mjscene.setIntegrator(integrator)
    simulation.InitializeSimulation()
    mjscene.getQvelState().setState([[x] for x in data.qvel])
    found, spent = [], 0.0
    for time_s in scene.times_s:
        simulation.ConfigureStopTime(macros.sec2nano(time_s))
        clock = time.process_time()
        simulation.ExecuteSimulation()
        spent += time.process_time() - clock
        message = mjscene.stateOutMsg.read()
        data.qpos[:], data.qvel[:] = np.ravel(message.qpos), np.ravel(message.qvel)
        found.append(states(scene, model, data))
    return found, spent
