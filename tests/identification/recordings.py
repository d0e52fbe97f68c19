"""Recordings made by our own simulator: a puck on air bearings in a square frame, and a cube that falls on a slab."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ffsm_mj
from tests.scenes import scene

E, MU = 0.62, 0.15
"""Restitution and friction of both scenes."""

PUCK = """<mujoco><option gravity="0 0 0"/><worldbody><body name="puck">
  <inertial pos="0.01 0.005 0" mass="5" diaginertia="0.02 0.03 0.04"/>
  <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" axis="0 0 1"/>
  <geom name="puck" type="capsule" size="0.06" fromto="-0.1 0 0 0.1 0 0" mass="0"/></body></worldbody></mujoco>"""
BOX = PUCK.replace('type="capsule" size="0.06" fromto="-0.1 0 0 0.1 0 0"', 'type="box" size="0.12 0.08 0.03"')
WALLS = "".join(
    f'<geom name="wall_{k}" type="box" pos="{x} {y} 0" size="{a} {b} 0.1"/>'
    for k, (x, y, a, b) in enumerate(((0.6, 0, 0.1, 0.45), (-0.6, 0, 0.1, 0.45), (0, 0.6, 0.45, 0.1), (0, -0.6, 0.45, 0.1)))
)
FRAME = f"<mujoco><worldbody>{WALLS}</worldbody></mujoco>"
CUBE = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="cube"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="0.37" diaginertia="8.1e-4 8.1e-4 8.1e-4"/>
  <geom name="cube" type="box" size="0.05 0.05 0.05" mass="0"/></body></worldbody></mujoco>"""
SLAB = '<mujoco><worldbody><geom name="slab" type="box" pos="0 0 -0.1" size="2 2 0.1"/></worldbody></mujoco>'


def puck_scene(folder: Path, puck: str = PUCK, **scenario) -> Path:
    rule = {"between": ["puck", "frame"], "restitution": E, "mu": MU, "name": "frame"}
    keys = {"duration_s": 4.0, "time_step_s": 0.01, "control_period_s": 0.01, "contacts": {"rules": [rule]}}
    return scene(folder, puck, {"frame": FRAME}, fixed={"frame": {}}, **{**keys, **scenario})


def cube_scene(folder: Path, **scenario) -> Path:
    rule = {"between": ["cube", "slab"], "restitution": E, "mu": MU, "name": "floor"}
    keys = {
        "duration_s": 0.44,
        "control_period_s": 0.002,
        "conservative": False,
        "contacts": {"rules": [rule]},
        "initial": {"joints": {"robot/free": [0, 0, 0.4, 1, 0, 0, 0]}},
    }
    return scene(folder, CUBE, {"slab": SLAB}, fixed={"slab": {}}, **{**keys, **scenario})


def puck_runs(path: Path, count: int) -> list[np.ndarray]:
    """Times, coordinates and velocities of some throws of the puck, (n, 7) each: t, x, y, yaw, vx, vy, yaw rate."""
    random, runs = np.random.default_rng(5), []
    for _ in range(count):
        angle, spin = random.uniform(0.0, 2.0 * np.pi), random.uniform(-4.0, 4.0)
        rates = {"x": 1.5 * np.cos(angle), "y": 1.5 * np.sin(angle), "yaw": spin}
        runs.append(rows(ffsm_mj.run(path, {f"initial.rates.{name}": float(value) for name, value in rates.items()})))
    return runs


def cube_runs(path: Path, count: int) -> list[np.ndarray]:
    """Times, poses and velocities of some tosses of the cube, (n, 14) each."""
    random, runs = np.random.default_rng(1), []
    for _ in range(count):
        turn = random.normal(size=4)
        rates = [*random.uniform(-1.0, 1.0, 2), -0.5, *random.uniform(-8.0, 8.0, 3)]
        pose = [0.0, 0.0, 0.4, *(turn / np.linalg.norm(turn))]
        runs.append(
            rows(ffsm_mj.run(path, {"initial.joints": {"robot/free": pose}, "initial.rates": {"robot/free": rates}}))
        )
    return runs


def rows(run: ffsm_mj.Run) -> np.ndarray:
    """Time, coordinates and velocities of a run."""
    keys = [key for key in run.log.header.layout.index if key.startswith(("state.time", "state.q_", "state.v_"))]
    return np.column_stack([run.log.column(key) for key in keys])


def written(path: Path, names: str, tables: list[np.ndarray]) -> Path:
    """Write a file with a column ``run`` and some others."""
    lines = [",".join([str(k), *map(repr, row)]) for k, table in enumerate(tables) for row in table.tolist()]
    path.write_text("\n".join([f"run,{names}", *lines]) + "\n")
    return path
