"""The table of ``docs/capture.md``: where the angular momentum of the scenario ``capture`` is, and what turns how fast."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

import ffsm_mj


def _told(system: Any, run: Any, row: int) -> tuple[float, float, float, float]:
    """|L| of all about their centre of mass, that of the wheels' own spin, rates of the base and the fastest joint."""
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
    system, (held,) = ffsm_mj.prepare("capture").system, run.captures
    times = {
        "start": 0.0,
        "capture": held.time_s,
        "arm stopped": run.phases[3].start_s,
        "let go": held.release_s,
        "end": run.time[-1],
    }
    print("| | t, s | total L, N m s | of it in the wheels, N m s | base, rad/s | fastest joint, rad/s |")
    print("|---|---|---|---|---|---|")
    for name, time_s in times.items():
        told = _told(system, run, int(np.searchsorted(run.time, time_s - 1e-9)))
        print(f"| {name} | {time_s:.2f} | {told[0]:.9f} | {told[1]:.3f} | {told[2]:.1e} | {told[3]:.1e} |")
    print(f"\nloss {held.loss_J:.2e} J, peak {held.peak_force_N:.1f} N, {held.peak_torque_N_m:.1f} N m")
