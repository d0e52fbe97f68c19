"""Two spacecraft in orbit, beside Basilisk: relative position and attitude over an orbit.

``uv run --group engines python benchmarks/orbit.py`` (see docs/engines.md for an environment of its own) runs the
same two bodies, 40 m apart and tumbling in 400 km, here and as Basilisk's ``Spacecraft`` with ``GravityGradientEffector``,
RKF78 and steps of 1 s, for 5550 s. Basilisk has absolute positions, of which a rounding is 9e-10 m, and the torque alone of
the gravity gradient; here is also its force, 1e-14 m/s^2 for these bodies, 1e-7 m in an orbit.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import json
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ffsm_mj
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.fields.config import CENTRAL_BODIES, OrbitConfig
from ffsm_mj.fields.orbit import Orbit

ORBIT = {"altitude_km": 400.0, "inclination_deg": 51.6, "raan_deg": 30.0, "argument_of_latitude_deg": 20.0}
DURATION_S, STEP_S, SHOWN_S = 5550.0, 1.0, (300.0, 1500.0, 5550.0)


class Craft(NamedTuple):
    """A spacecraft at t = 0, relative to the origin in inertial axes."""

    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    rate_rad_s: tuple[float, float, float]


CRAFTS = {
    "robot": Craft(
        500.0, (10.0, 25.0, 30.0), (6.0, -7.0, 4.0), (0.003, 0.01, -0.002), (0.8, 0.2, -0.4, 0.4), (0.0, 0.0, 1e-3)
    ),
    "other": Craft(
        800.0, (30.0, 45.0, 50.0), (-20.0, 15.0, 8.0), (-0.01, 0.0, 0.004), (0.6, 0.0, 0.8, 0.0), (1e-3, 2e-3, 0.0)
    ),
}


class Motion(NamedTuple):
    """Positions, (n, 3), and rotation matrices from body to inertial axes, (n, 3, 3), at every second."""

    position_m: FloatArray
    attitude: FloatArray


def of_ffsm() -> dict[str, Motion]:
    """The motion here, relative to the reference orbit."""
    with tempfile.TemporaryDirectory() as folder:
        run = ffsm_mj.run(_scenario(Path(folder)))
    assert all(check.passes for check in run.checks())
    motions = {}
    for name in CRAFTS:
        q = np.stack([run[f"state.q_{name}_free_{part}"] for part in ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")], axis=1)
        motions[name] = Motion(q[:, :3], np.array([rotation_matrix(row) for row in q[:, 3:]]))
    return motions


def _scenario(folder: Path) -> Path:
    for name, craft in CRAFTS.items():
        inertia = " ".join(map(str, craft.inertia_kg_m2))
        (folder / f"{name}.xml").write_text(
            f'<mujoco><option gravity="0 0 0"/><worldbody><body name="{name}"><freejoint name="free"/>'
            f'<inertial pos="0 0 0" mass="{craft.mass_kg}" diaginertia="{inertia}"/></body></worldbody></mujoco>'
        )
    data = {
        "name": "two-spacecraft",
        "duration_s": DURATION_S,
        "time_step_s": STEP_S,
        "control_period_s": STEP_S,
        "robot": {"mjcf": "robot.xml"},
        "objects": {"other": {"mjcf": "other.xml"}},
        "environment": {"orbit": ORBIT, "world_axes": "eci"},
        "initial": {
            "joints": {f"{name}/free": [*craft.position_m, *craft.quaternion] for name, craft in CRAFTS.items()},
            "rates": {f"{name}/free": [*craft.velocity_m_s, *craft.rate_rad_s] for name, craft in CRAFTS.items()},
        },
        "contacts": {"rules": []},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / "scenario.yaml"
    path.write_text(json.dumps(data))
    return path


def of_basilisk() -> dict[str, Motion]:
    """The motion in Basilisk, in inertial coordinates about the centre of the Earth."""
    from Basilisk.simulation import GravityGradientEffector, spacecraft, svIntegrators
    from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros, simIncludeGravBody

    simulation = SimulationBaseClass.SimBaseClass()
    task = "dynamics"
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask(task, macros.sec2nano(STEP_S)))
    bodies = simIncludeGravBody.gravBodyFactory()
    earth = bodies.createEarth()
    earth.isCentralBody, earth.mu = True, 1e9 * CENTRAL_BODIES["earth"].mu_km3_s2
    R, V = (state[0] for state in Orbit.of(OrbitConfig(**ORBIT), "eci").states(np.zeros(1)))
    recorders, kept = {}, []
    for name, craft in CRAFTS.items():
        vehicle = spacecraft.Spacecraft()
        vehicle.ModelTag = name
        vehicle.hub.mHub = craft.mass_kg
        vehicle.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        vehicle.hub.IHubPntBc_B = np.diag(craft.inertia_kg_m2).tolist()
        vehicle.hub.r_CN_NInit = (R + craft.position_m).tolist()
        vehicle.hub.v_CN_NInit = (V + craft.velocity_m_s).tolist()
        vehicle.hub.sigma_BNInit = [[x] for x in RigidBodyKinematics.C2MRP(rotation_matrix(np.array(craft.quaternion)).T)]
        vehicle.hub.omega_BN_BInit = [[x] for x in craft.rate_rad_s]
        integrator = svIntegrators.svIntegratorRKF78(vehicle)
        vehicle.setIntegrator(integrator)
        gradient = GravityGradientEffector.GravityGradientEffector()
        gradient.ModelTag = f"gradient of {name}"
        gradient.addPlanetName(earth.planetName)
        vehicle.addDynamicEffector(gradient)
        bodies.addBodiesTo(vehicle)
        recorders[name] = vehicle.scStateOutMsg.recorder()
        for model in (vehicle, gradient, recorders[name]):
            simulation.AddModelToTask(task, model)
        kept += [vehicle, gradient, integrator]  # Basilisk keeps pointers alone
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(DURATION_S))
    simulation.ExecuteSimulation()
    return {
        name: Motion(
            np.array(recorder.r_BN_N), np.array([RigidBodyKinematics.MRP2C(sigma).T for sigma in recorder.sigma_BN])
        )
        for name, recorder in recorders.items()
    }


def angle(one: FloatArray, other: FloatArray) -> float:
    """Angle between two attitudes, rad."""
    turned = one.T @ other
    axial = 0.5 * np.array((turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]))
    return float(np.arctan2(np.linalg.norm(axial), 0.5 * (np.trace(turned) - 1.0)))


def main() -> None:
    """Print the differences."""
    here, there = of_ffsm(), of_basilisk()
    apart = [motions["other"].position_m - motions["robot"].position_m for motions in (here, there)]
    print(f"{'time':>7} {'distance':>12} {'difference':>11} {'attitude of robot':>18} {'of other':>9}")
    for time_s in SHOWN_S:
        i = round(time_s / STEP_S)
        turns = [angle(here[name].attitude[i], there[name].attitude[i]) for name in CRAFTS]
        distance, difference = np.linalg.norm(apart[0][i]), np.linalg.norm(apart[0][i] - apart[1][i])
        print(f"{time_s:5.0f} s {distance:10.3f} m {difference:9.1e} m {turns[0]:14.1e} rad {turns[1]:5.1e} rad")


if __name__ == "__main__":
    main()
