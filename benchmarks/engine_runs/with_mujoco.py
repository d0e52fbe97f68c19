"""MuJoCo: its own contact, friction and weld, by the recipes of its documentation."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from engine_runs.mjcf import whole
from engine_runs.scene import Scene, initial_twists
from engine_runs.states import States

STIFF = "0.9999 0.9999 0.001 0.5 2"
SPRING_STEPS = 10


@dataclass(frozen=True)
class Recipe:
    """Attributes of <option>, <geom> and <weld>."""

    option: str
    geom: str = 'contype="0" conaffinity="0"'
    weld: str = ""


def damping_ratio(restitution: float) -> float:
    """Of a spring and damper that push only and give this restitution: e = exp(-2 z/s atan2(s, z)), s^2 = 1 - z^2."""
    from scipy.optimize import brentq

    def excess(z: float) -> float:
        s = math.sqrt(1.0 - z * z)
        return math.log(restitution) + 2.0 * z / s * math.atan2(s, z)

    return 0.0 if restitution == 1.0 else float(brentq(excess, 0.0, 0.999))


def spring(step_s: float, restitution: float) -> Recipe:
    """A contact spring whose half period is ten steps, damped for the restitution; RK4."""
    frequency, ratio = math.pi / (SPRING_STEPS * step_s), damping_ratio(restitution)
    solref = f"{-(frequency**2)} {-2 * ratio * frequency}"
    return Recipe('integrator="RK4"', f'condim="1" solref="{solref}" solimp="{STIFF}"')


def dashpot(step_s: float, restitution: float) -> Recipe:
    """A dashpot that changes the approach speed u into -e u within one step; Euler."""
    return Recipe('integrator="Euler"', f'condim="1" solref="0 {-((1.0 + restitution) / step_s - 1.0)}" solimp="{STIFF}"')


def default_contact() -> Recipe:
    """What a model has that states nothing."""
    return Recipe('integrator="RK4"', 'condim="1"')


def elliptic(impratio: float, integrator: str) -> Recipe:
    """Friction by the documentation's recipe against slip."""
    return Recipe(f'integrator="{integrator}" cone="elliptic" impratio="{impratio}"', 'friction="0.7 0 0"')


def no_slip(iterations: int) -> Recipe:
    """With the post-processing of slip."""
    return Recipe(
        f'integrator="implicitfast" cone="elliptic" impratio="10" noslip_iterations="{iterations}"', 'friction="0.7 0 0"'
    )


def free(integrator: str) -> Recipe:
    """Nothing touches."""
    return Recipe(f'integrator="{integrator}"')


def welded(step_s: float, integrator: str) -> Recipe:
    """A weld with the smallest time constant that the documentation allows, two steps."""
    return Recipe(f'integrator="{integrator}"', weld=f'solref="{2 * step_s} 1" solimp="{STIFF}"')


def default_weld(integrator: str) -> Recipe:
    """A weld with the default time constant of 20 ms."""
    return Recipe(f'integrator="{integrator}"')


def built(scene: Scene, recipe: Recipe, step_s: float) -> tuple[Any, Any]:
    """Model and data at the start."""
    import mujoco

    text = whole(scene, f'timestep="{step_s!r}" {recipe.option}', geom=recipe.geom, weld=recipe.weld)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    set_rates(scene, model, data)
    mujoco.mj_forward(model, data)
    return model, data


def set_rates(scene: Scene, model: Any, data: Any) -> None:
    """Velocities at the start."""
    twists = initial_twists(scene)
    for body in scene.bodies:
        address = int(model.joint(body.name).dofadr[0])
        if body.joint is None:
            data.qvel[address : address + 6] = np.concatenate(twists[body.name])
        else:
            data.qvel[address] = body.joint.rate


def states(scene: Scene, model: Any, data: Any) -> States:
    """Of every body at the state of ``data``."""
    import mujoco

    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    rows: list[list[np.ndarray]] = [[], [], [], []]
    twist, quaternion = np.empty(6), np.empty(4)
    for body in scene.bodies:
        number = model.body(body.name).id
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, number, twist, 0)
        mujoco.mju_mat2Quat(quaternion, data.ximat[number])
        rows[0].append(data.xipos[number].copy())
        rows[1].append(quaternion.copy())
        rows[2].append(twist[3:].copy())
        rows[3].append(twist[:3].copy())
    return States(*(np.array(row) for row in rows))


def run(scene: Scene, recipe: Recipe, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of the loop of ``mj_step``."""
    import mujoco

    model, data = built(scene, recipe, step_s)
    starts = [round(begin / step_s) for _, begin in scene.efforts.values()]
    efforts = [effort for effort, _ in scene.efforts.values()]
    marks, found, spent = {round(time_s / step_s) for time_s in scene.times_s}, [], 0.0
    changes = sorted({*starts, *marks, 0})
    for begin, end in pairwise(changes):
        data.ctrl[:] = [effort if begin >= start else 0.0 for effort, start in zip(efforts, starts, strict=True)]
        clock = time.process_time()
        for _ in range(end - begin):
            mujoco.mj_step(model, data)
        spent += time.process_time() - clock
        if end in marks:
            found.append(states(scene, model, data))
    return found, spent
