"""The table of ``docs/capture.md``: angular momentum of the scenario ``capture`` by carrier, and rates of rotation."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

import ffsm_mj


def _angular_momentum(system: Any, run: Any, row: int) -> tuple[float, float, float, float]:
    """|L| of the system about its centre of mass, |L| of the spin of the wheels, rates of the base and the fastest joint."""
    model, data = system.mj, mujoco.MjData(system.mj)
    data.qpos[:], data.qvel[:] = run.qpos[row], run.qvel[row]
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    wheels, spin = [system.joint(f"wheel_{axis}") for axis in "xyz"], np.zeros(3)
    for wheel in wheels:
        joint = model.joint(wheel.name).id
        spin += model.body_inertia[wheel.body].max() * data.qvel[wheel.dofs] * data.xaxis[joint]
    arm = [joint.dofs.start for joint in system.robot.joints if joint.kind == "hinge" and joint not in wheels]
    base = data.qvel[system.robot.base_dofs][3:]
    return (
        float(np.linalg.norm(data.subtree_angmom[0])),
        float(np.linalg.norm(spin)),
        float(np.linalg.norm(base)),
        float(np.abs(data.qvel[arm]).max()),
    )


if __name__ == "__main__":
    run = ffsm_mj.run("capture")
    system, (capture,) = ffsm_mj.Scenario.load("capture").system, run.grasps
    times = {
        "start": 0.0,
        "capture": capture.time_s,
        "arm stopped": run.phases[3].start_s,
        "release": capture.release_s,
        "end": run.time[-1],
    }
    print("| | t, s | total L, N m s | L in the wheels, N m s | base, rad/s | fastest joint, rad/s |")
    print("|---|---|---|---|---|---|")
    for name, time_s in times.items():
        found = _angular_momentum(system, run, int(np.searchsorted(run.time, time_s - 1e-9)))
        print(f"| {name} | {time_s:.2f} | {found[0]:.9f} | {found[1]:.3f} | {found[2]:.1e} | {found[3]:.1e} |")
    print(f"\nloss {capture.loss_J:.2e} J, peak {capture.peak_force_N:.1f} N, {capture.peak_torque_N_m:.1f} N m")
