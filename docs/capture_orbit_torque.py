"""The table of ``docs/missions.md``: what the gravity gradient does to the stack that the wheels keep in LVLH.

No jet fires in the phase ``keep``: only the gravity gradient changes the angular momentum about the stack's mass centre.
"""

from __future__ import annotations

import mujoco
import numpy as np

import ffsm_mj
from ffsm_mj.arrays import FloatArray


def about_mass_centre(run: ffsm_mj.Run, time_s: float) -> tuple[FloatArray, FloatArray]:
    """Angular momentum of the stack about its mass centre, N m s, and axes of the base as columns, world axes, at a time."""
    model = ffsm_mj.Scenario.load("capture-orbit").system.mj
    data, row = mujoco.MjData(model), int(np.searchsorted(run.time, time_s))
    data.qpos[:], data.qvel[:] = run.qpos[row], run.qvel[row]
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return data.subtree_angmom[0].copy(), data.body("robot/bus").xmat.reshape(3, 3).copy()


if __name__ == "__main__":
    run = ffsm_mj.run("capture-orbit", rerun=False)
    start_s = run.phases[-1].start_s
    (before, axes), (after, _) = about_mass_centre(run, start_s), about_mass_centre(run, run.time[-1])
    torque = axes.T @ (after - before) / (run.time[-1] - start_s)
    print(f"from {start_s:.0f} s to {run.time[-1]:.0f} s, mean, in axes of the base at the start: {torque} N m")
    print(f"angular impulse {np.linalg.norm(after - before):.4f} N m s")
    wheels = [run["state.v_robot_wheel_" + axis + "_rad_s"] for axis in "xyz"]
    print("wheels, rad/s:", [f"{w[np.searchsorted(run.time, start_s)]:.2f} to {w[-1]:.2f}" for w in wheels])
