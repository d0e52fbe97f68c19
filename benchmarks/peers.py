"""Other engines on the same smooth motion: 30 s of the case study's robot tumbling freely, no contact, no control.

``uv run --extra peers python benchmarks/peers.py`` prints, for each engine that is installed, the median wall time of the
loop, its ratio to MuJoCo's, and how far its final coordinates are from a reference of order 8 with a tolerance of 1e-13.
"""

from __future__ import annotations

import argparse
import logging
import statistics
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

from ffsm_mj.scenario.shipped import scenarios_dir

DURATION, STEP = 30.0, 1e-3
STEPS = round(DURATION / STEP)
RATES = np.array([0.05, -0.03, 0.1, 0.5, -0.4, 0.3])  # base x, y, yaw, then the joints
REFERENCE = "MuJoCo 4 RK4"
Timed = tuple[float, np.ndarray]


def robot_spec() -> mujoco.MjSpec:
    """The robot of the baseline without its object: MuJoCo's contacts off, no gravity."""
    spec = mujoco.MjSpec.from_file(str(scenarios_dir().parent / "mjcf" / "ffsm_3dof.xml"))
    spec.option.timestep = STEP
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec


def flat_file(folder: str) -> Path:
    """The same as one file without includes, for other parsers."""
    path = Path(folder) / "robot.xml"
    spec = robot_spec()
    spec.compile()
    path.write_text(spec.to_xml())
    return path


def with_mujoco() -> Timed:
    """Python loop of mj_step."""
    robot = robot_spec().compile()
    data = mujoco.MjData(robot)
    data.qvel[:] = RATES
    start = time.perf_counter()
    for _ in range(STEPS):
        mujoco.mj_step(robot, data)
    return time.perf_counter() - start, data.qpos.copy()


def _pinocchio():
    import pinocchio as pin

    with tempfile.TemporaryDirectory() as folder:
        robot = pin.buildModelFromMJCF(str(flat_file(folder)))
    robot.gravity = pin.Motion.Zero()
    return pin, robot, robot.createData()


def with_pinocchio() -> Timed:
    """Articulated-body algorithm and a classical Runge-Kutta step in Python; all joints are vector spaces here."""
    pin, robot, data = _pinocchio()
    aba, no_torque, h = pin.aba, np.zeros(6), STEP
    q, v = np.zeros(6), RATES.copy()
    start = time.perf_counter()
    for _ in range(STEPS):
        a1 = aba(robot, data, q, v, no_torque).copy()
        v2 = v + 0.5 * h * a1
        a2 = aba(robot, data, q + 0.5 * h * v, v2, no_torque).copy()
        v3 = v + 0.5 * h * a2
        a3 = aba(robot, data, q + 0.5 * h * v2, v3, no_torque).copy()
        v4 = v + h * a3
        a4 = aba(robot, data, q + h * v3, v4, no_torque)
        q = q + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
        v = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    return time.perf_counter() - start, q


def reference() -> np.ndarray:
    """DOP853 on Pinocchio's dynamics."""
    from scipy.integrate import solve_ivp

    pin, robot, data = _pinocchio()

    def rate(_, x):
        return np.concatenate((x[6:], pin.aba(robot, data, x[:6], x[6:], np.zeros(6))))

    solution = solve_ivp(rate, (0.0, DURATION), np.concatenate((np.zeros(6), RATES)), "DOP853", rtol=1e-13, atol=1e-13)
    return solution.y[:6, -1]


def with_drake() -> Timed:
    """Continuous plant, Runge-Kutta of order 3 at fixed steps."""
    from pydrake.all import DiagramBuilder, MultibodyPlant, Parser, ResetIntegratorFromFlags, Simulator

    logging.getLogger("drake").setLevel(logging.ERROR)  # it lists what it ignores of MJCF
    with tempfile.TemporaryDirectory() as folder:
        plant = DiagramBuilder().AddSystem(MultibodyPlant(0.0))
        Parser(plant).AddModels(str(flat_file(folder)))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
    plant.SetPositionsAndVelocities(context, np.concatenate((np.zeros(6), RATES)))
    ResetIntegratorFromFlags(simulator, "runge_kutta3", STEP)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    simulator.Initialize()
    start = time.perf_counter()
    simulator.AdvanceTo(DURATION)
    return time.perf_counter() - start, plant.GetPositions(context).copy()


def with_basilisk() -> Timed:
    """MJScene with Basilisk's own Runge-Kutta of order 4."""
    from Basilisk.simulation import mujoco as basilisk
    from Basilisk.simulation import svIntegrators
    from Basilisk.utilities import SimulationBaseClass, macros

    with tempfile.TemporaryDirectory() as folder:
        simulation = SimulationBaseClass.SimBaseClass()
        task = simulation.CreateNewProcess("process")
        task.addTask(simulation.CreateNewTask("task", macros.sec2nano(STEP)))
        scene = basilisk.MJScene.fromFile(str(flat_file(folder)))
    scene.extraEoMCall = True
    simulation.AddModelToTask("task", scene)
    integrator = svIntegrators.svIntegratorRK4(scene)
    scene.setIntegrator(integrator)
    simulation.InitializeSimulation()
    scene.getQvelState().setState([[x] for x in RATES])
    simulation.ConfigureStopTime(macros.sec2nano(DURATION))
    start = time.perf_counter()
    simulation.ExecuteSimulation()
    return time.perf_counter() - start, np.ravel(scene.stateOutMsg.read().qpos)


ENGINES: dict[str, tuple[str, Callable[[], Timed]]] = {
    REFERENCE: ("mujoco", with_mujoco),
    "Pinocchio ABA, RK4 in Python": ("pinocchio", with_pinocchio),
    "Drake RK3, fixed step": ("pydrake", with_drake),
    "Basilisk MJScene RK4": ("Basilisk", with_basilisk),
}


def report(repeats: int) -> None:
    """Run the engines that are installed in turn, several times, and print their table."""
    exact = reference()
    times: dict[str, list[float]] = {}
    errors: dict[str, float] = {}
    for _ in range(repeats):
        for name, (package, engine) in ENGINES.items():
            if find_spec(package) is None:
                continue
            seconds, end = engine()
            times.setdefault(name, []).append(seconds)
            errors[name] = float(np.abs(end - exact).max())
    print(f"{'30 s of free flight at 1 ms':32}{'median':>12}{'error':>24}{'ratio':>8}  to")
    for name, values in times.items():
        ratio = statistics.median(a / b for a, b in zip(values, times[REFERENCE], strict=True))
        print(f"{name:32}{statistics.median(values):>10.3f} s{errors[name]:>22.1e} m{ratio:>8.2f}  {REFERENCE}")
    for name in ENGINES.keys() - times.keys():
        print(f"{name}: not installed (uv run --extra peers ...)")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    report(parser.parse_args().repeats)
