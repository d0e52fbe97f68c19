"""What a run of the case study came to, by the names of the printed numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord

Measures = dict[str, float]


def measure(run: Run, system: System) -> Measures:
    """Values by key, in SI units (``_mm`` in mm, ``error_by_path`` in %); those of an impact only where there is one.

    Args:
        run: A run of one of the paper's scenarios.
        system: Its model.
    """
    error = run.tip_error()
    closest = int(np.argmin(error))
    values = {
        "initial_error": float(error[0]),
        "smallest_error": float(error[closest]),
        "final_error": float(error[-1]),
        "final_error_mm": 1e3 * float(error[-1]),
        "error_by_path": 100.0 * float(error[closest]) / _path(run, closest),
    }
    if run.impacts:
        values |= _impact(run.impacts[0], system) | _after(run)
    return values


def state_at(system: System, qpos: Any, qvel: Any) -> Any:
    """MuJoCo data at a state, everything derived current."""
    data = mujoco.MjData(system.mj)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(system.mj, data)
    return data


def state_before(record: ImpactRecord, system: System) -> Any:
    """MuJoCo data at the instant of an impact, just before it."""
    return state_at(system, record.qpos, _qvel(record.qvel_before, system))


def _qvel(by_joint: Mapping[str, tuple[float, ...]], system: System) -> FloatArray:
    """Generalised velocities in the model's order; a log does not keep the order of names."""
    qvel = np.empty(system.mj.nv)
    for name, values in by_joint.items():
        qvel[system.joint(name).dofs] = values
    return qvel


def tip_state(system: System, data: Any) -> tuple[Any, Any]:
    """Position in m and velocity in m/s of the tip, in world axes."""
    site = system.index("site", "tip")
    jacobian = np.empty((3, system.mj.nv))
    mujoco.mj_jacSite(system.mj, data, jacobian, None, site)
    return data.site_xpos[site].copy(), jacobian @ data.qvel


def slope(system: System, data: Any) -> Any:
    """Velocities of the robot per unit of the paper's I_e,n, -M^-1 J^T e_x as in (35): its impulse acts on the object."""
    jacobian = np.empty((3, system.mj.nv))
    mujoco.mj_jacSite(system.mj, data, jacobian, None, system.index("site", "tip"))
    dofs = system.robot.dofs
    return -np.linalg.solve(mass_matrix(system.mj, data)[dofs, dofs], jacobian[0, dofs])


def _impact(record: ImpactRecord, system: System) -> Measures:
    after = _qvel(record.qvel_after, system)
    return {"impact_time": record.time_s} | impact_values(
        system, state_before(record, system), after, record.impulse_N_s * record.normal[0], record.angular_impulse_N_m_s[2]
    )


def impact_values(system: System, data: Any, after: Any, impulse: float, angular_impulse: float) -> Measures:
    """What the paper prints of an impact.

    Args:
        system: The model.
        data: The state before.
        after: Generalised velocities after, robot then object.
        impulse: On the object along +x, the paper's I_e,n, N s.
        angular_impulse: On the object about its centre of mass, N m s.
    """
    tip, velocity = tip_state(system, data)
    values = {
        "tip_x": tip[0],
        "tip_y": tip[1],
        "tip_vx": velocity[0],
        "tip_vy": velocity[1],
        "impulse": impulse,
        "angular_impulse": angular_impulse,
        "energy": kinetic_energy(mass_matrix(system.mj, data), data.qvel),
        "object_vx": after[6],
        "object_vy": after[7],
        "object_yaw_rate": after[8],
    }
    for key, numbers in (("before", data.qvel[:6]), ("slope", slope(system, data)), ("after", after[:6])):
        values |= {f"{key}_{i}": number for i, number in enumerate(numbers)}
    return {key: float(value) for key, value in values.items()}


def _after(run: Run) -> Measures:
    """The ways that object and base went over the whole run, and the momenta of the last phase."""
    last = run["phase.index"] == run["phase.index"][-1]
    momenta = [run[f"momentum.robot_{component}"][last] for component in ("P_x_N_s", "P_y_N_s", "L_z_N_m_s")]
    return {
        "object_way": float(run["state.q_object_x_m"][0] - run["state.q_object_x_m"][-1]),
        "base_way": float(run["state.q_robot_base_x_m"][-1] - run["state.q_robot_base_x_m"][0]),
        "P_after_pause": float(np.hypot(momenta[0][-1], momenta[1][-1])),
        "L_after_pause": float(momenta[2][-1]),
    }


def _path(run: Run, end: int) -> float:
    """Length of the tip's path up to a row, m."""
    steps = np.diff(np.column_stack([run[f"state.tip_{axis}_m"][: end + 1] for axis in "xy"]), axis=0)
    return float(np.linalg.norm(steps, axis=1).sum())
