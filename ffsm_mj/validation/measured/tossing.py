"""Tosses simulated: by this engine, and by MuJoCo's soft contact with parameters that others fitted to the same tosses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ffsm_mj.arrays import FloatArray
from ffsm_mj.validation.measured.tosses import HALF_WIDTH_M, RATE_HZ, SCALE, Toss
from ffsm_mj.validation.scene import body, model, rule, run_scene, states, touching, vector

MASS_KG = 0.37
INERTIA_KG_M2 = 0.00081
GRAVITY = 9.81
_STEPS_PER_FRAME = 4
_FLOOR_M = -0.0002
"""Height of the floor in the frame of the files: the cube at rest is there below half its scaled width."""
SOFT = {"stiffness": 3852.0, "damping": 63.2, "mu": 0.231}
"""MuJoCo's contact as Acosta, Yang & Posa 2022 fitted it to these tosses (DAIRLab/dairlib, contact_parameter_learning)."""


@dataclass(frozen=True)
class TossMotion:
    """Poses of the cube, one per frame from the start on.

    Attributes:
        positions: m, (n, 3).
        rotations: Orientations.
        failures: Checks of the run that fail, or its outcome if it ended early.
        impacts: Number of its impacts.
    """

    positions: FloatArray
    rotations: Rotation
    failures: tuple[str, ...] = ()
    impacts: int = 0


@dataclass(frozen=True)
class TossTask:
    """A toss to simulate.

    Attributes:
        start: State at the start, (13,).
        frames: How many, the start included.
        mu: Coefficient of friction.
        e: Coefficient of restitution.
    """

    start: FloatArray
    frames: int
    mu: float
    e: float


def simulate(task: TossTask) -> TossMotion:
    """TossMotion of a toss by this engine: a box on a fixed box, one contact rule, no controller."""
    half, inertia = SCALE * HALF_WIDTH_M, SCALE**2 * INERTIA_KG_M2
    gravity = (0.0, 0.0, -SCALE * GRAVITY)
    cube = body("cube", MASS_KG, [inertia] * 3, geom=f'type="box" size="{vector([half] * 3)}"')
    floor = f'<geom name="floor" type="box" size="5 5 0.2" pos="{vector((0.0, 0.0, _FLOOR_M - 0.2))}"/>'
    run = run_scene(
        model(cube, gravity=gravity),
        {"floor": model(floor, gravity=gravity)},
        conservative=False,
        initial={"joints": {"robot/free": task.start[:7].tolist()}, "rates": {"robot/free": task.start[7:].tolist()}},
        contacts=touching(rule("cube", "floor/floor", task.e, task.mu)),
        time_step_s=1.0 / (_STEPS_PER_FRAME * RATE_HZ),
        control_period_s=1.0 / RATE_HZ,
        duration_s=(task.frames - 1) / RATE_HZ,
    )
    poses = states(run, "q")[: task.frames]
    failures = [check.name for check in run.checks() if not check.passes]
    if len(poses) < task.frames:  # the run ended early: the cube stays where it was
        failures.append(run.outcome)
        poses = np.concatenate([poses, np.repeat(poses[-1:], task.frames - len(poses), axis=0)])
    return _motion(poses, tuple(failures), len(run.impacts))


def simulate_soft(task: TossTask, *, scale: float) -> TossMotion:
    """The same by MuJoCo at its frames' step, with the contact parameters of others; ``scale`` 1 is the nominal cube."""
    half, inertia = scale * HALF_WIDTH_M, scale**2 * INERTIA_KG_M2
    cube = body(
        "cube", MASS_KG, [inertia] * 3, geom=f'type="box" size="{vector([half] * 3)}" friction="{SOFT["mu"]} 0.005 0.0001"'
    )
    floor = (
        f'<geom name="floor" type="box" size="5 5 0.2" pos="0 0 -0.2" friction="{SOFT["mu"]} 0.005 0.0001"'
        f' solref="-{SOFT["stiffness"]} -{SOFT["damping"]}"/>'
    )
    options = f'<option timestep="{1.0 / RATE_HZ!r}" gravity="0 0 {-scale * GRAVITY!r}"><flag refsafe="disable"/></option>'
    soft: Any = mujoco.MjModel.from_xml_string(f"<mujoco>{options}<worldbody>{cube}{floor}</worldbody></mujoco>")
    data: Any = mujoco.MjData(soft)
    data.qpos[:], data.qvel[:] = task.start[:7], task.start[7:]
    poses = np.empty((task.frames, 7))
    for pose in poses:
        pose[:] = data.qpos
        mujoco.mj_step(soft, data)
    return _motion(poses)


def _motion(poses: FloatArray, failures: tuple[str, ...] = (), impacts: int = 0) -> TossMotion:
    return TossMotion(poses[:, :3], Rotation.from_quat(poses[:, 3:], scalar_first=True), failures, impacts)


def errors(motion: TossMotion, toss: Toss, first: int) -> tuple[FloatArray, FloatArray]:
    """Distances of the centre in widths of the nominal cube, and angles of rotation, deg, from the frame ``first`` on."""
    distances = np.linalg.norm(motion.positions - toss.positions[first:], axis=1) / (2.0 * HALF_WIDTH_M)
    angles = (motion.rotations * toss.rotations[first:].inv()).magnitude()
    return np.asarray(distances), np.degrees(angles)
