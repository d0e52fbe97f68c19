"""Siconos by Debian's package, in the interpreter of the system: Moreau-Jean time stepping, Newton's impact law.

The package is built for an older NumPy than the other engines need, so this file runs there as a script and prints JSON.
``SICONOS_PYTHON`` names another interpreter than ``/usr/bin/python3``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from engine_runs.scene import Scene, collision, initial_twists
from engine_runs.states import States, rotation

PYTHON = os.environ.get("SICONOS_PYTHON", "/usr/bin/python3")


def _called(*arguments: str) -> Any:
    """What the script prints there; None: it has no Siconos."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL"))}
    environment["PYTHONPATH"] = str(Path(__file__).parents[1])
    command = [PYTHON, "-m", "engine_runs.with_siconos", *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else None


def version() -> str | None:
    """Version; None: not installed."""
    found = _called()
    return None if found is None else str(found)


def run(scene: Scene, step_s: float) -> tuple[list[States], float]:
    """States at the end of ``collision`` and CPU time in s of the loop of ``computeOneStep``."""
    parts, spent = _called(repr(scene.restitution), repr(step_s))
    return [States(*(np.array(part) for part in parts))], float(spent)


def _collided(scene: Scene, step_s: float) -> tuple[list[list[list[float]]], float]:
    """In the interpreter with Siconos. One contact point: the points that Bullet adds by perturbation shift the centre."""
    from siconos import kernel, numerics
    from siconos.mechanics.collision import RigidBodyDS, SiconosBox, SiconosContactor, SiconosSphere
    from siconos.mechanics.collision.bullet import SiconosBulletCollisionManager, SiconosBulletOptions

    system, bodies = kernel.NonSmoothDynamicalSystem(0.0, scene.duration_s), []
    for body, (v, w) in zip(scene.bodies, initial_twists(scene).values(), strict=True):
        place = [*body.position_m, 1.0, 0.0, 0.0, 0.0]
        bodies.append(RigidBodyDS(place, [*v, *w], body.mass_kg, np.diag(body.inertia_kg_m2)))
        shape = SiconosBox(*(2 * np.array(body.half_m))) if body.half_m else SiconosSphere(body.radius_m)
        shape.setInsideMargin(0.0)
        shape.setOutsideMargin(0.0)
        bodies[-1].contactors().push_back(SiconosContactor(shape))
        system.insertDynamicalSystem(bodies[-1])
    problem = kernel.FrictionContact(3, numerics.SICONOS_FRICTION_3D_NSGS)
    problem.numericsSolverOptions().dparam[0] = 1e-13
    options = SiconosBulletOptions()
    options.worldScale, options.perturbationIterations, options.minimumPointsPerturbationThreshold = 1.0, 0, 0
    manager = SiconosBulletCollisionManager(options)
    manager.insertNonSmoothLaw(kernel.NewtonImpactFrictionNSL(scene.restitution, 0.0, scene.mu, 3), 0, 0)
    simulation = kernel.TimeStepping(system, kernel.TimeDiscretisation(0.0, step_s))
    simulation.insertIntegrator(kernel.MoreauJeanOSI(0.5))
    simulation.insertNonSmoothProblem(problem)
    simulation.insertInteractionManager(manager)
    simulation.setNewtonOptions(kernel.SICONOS_TS_NONLINEAR)
    clock = time.process_time()
    while simulation.hasNextEvent():
        simulation.computeOneStep()
        simulation.nextStep()
    spent = time.process_time() - clock
    q, v = (np.array([getattr(body, what)() for body in bodies]) for what in ("q", "twist"))
    spin = np.einsum("nij,nj->ni", rotation(q[:, 3:]), v[:, 3:])
    return [part.tolist() for part in (q[:, :3], q[:, 3:], v[:, :3], spin)], spent


def main() -> None:
    """Print the version, or what came of a collision."""
    if len(sys.argv) == 1:
        from importlib.metadata import version

        print(json.dumps(version("siconos")))
        return
    print(json.dumps(_collided(collision(float(sys.argv[1])), float(sys.argv[2]))))


if __name__ == "__main__":
    main()
