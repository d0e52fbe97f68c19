"""Initial state of a scenario, and its validation."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.assembly.closed_start import close_loops
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.system import Joint, System
from ffsm_mj.scenario.scenario import JointValue, ScenarioConfig

_HUGE = 1e10
_LEAST_SHARE = 1e-10
"""Least eigenvalue of the mass matrix scaled to a diagonal of ones: below it, accelerations lose six digits to rounding."""


class InitialState(NamedTuple):
    """State at t = 0.

    Attributes:
        data: MuJoCo data with all derived quantities.
        notes: What a user should know about it, one line each.
    """

    data: Any
    notes: tuple[str, ...]


def initial_state(scenario: ScenarioConfig, system: System) -> InitialState:
    """State at t = 0, with the equality constraints closed.

    Raises:
        ScenarioFaults: An unknown joint, an invalid value, or a state from which no run can start.
    """
    data = mujoco.MjData(system.mj)
    faults: list[Fault] = []
    for key, target in (("joints", data.qpos), ("rates", data.qvel)):
        for name, value in getattr(scenario.initial, key).items():
            path = ("initial", key, name)
            try:
                joint = system.joint(name)
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), path))
                continue
            fault = _set_joint(joint, key, value, target)
            if fault:
                faults.append(Fault(fault, path))
    if faults:
        raise ScenarioFaults(faults)
    if fault := fault_of_start(system, data):
        raise ScenarioFaults([Fault(fault, ("initial",))])
    return InitialState(data, close_loops(system, data, scenario.initial.joints, scenario.initial.rates))


def fault_of_start(system: System, data: Any) -> str:
    """Compute derived quantities; return why no run can start from the state, empty if one can."""
    warnings: list[str] = []
    with collected_warnings(warnings):
        mujoco.mj_forward(system.mj, data)
    dof, share = _weakest_dof(system.mj, data)
    if not share > _LEAST_SHARE:
        joint = system.mj.joint(int(system.mj.dof_jntid[dof])).name
        how = f"singular to {share:.1g}" if share <= _LEAST_SHARE else "not finite"
        return f"the mass matrix is {how} at joint {joint!r}: what it moves here has next to no mass or inertia"
    return f"MuJoCo warns: {' '.join(warnings[0].split())}" if warnings else ""


def _set_joint(joint: Joint, key: str, value: JointValue, target: Any) -> str:
    """Set a joint's coordinates or rates; return what is wrong with them, empty if they are valid."""
    part = joint.qpos if key == "joints" else joint.dofs
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float64))
    size = part.stop - part.start
    if len(numbers) != size:
        return f"{joint.kind} joint {joint.name} takes {size} number{'s' if size > 1 else ''}, got {len(numbers)}"
    if np.any(np.abs(numbers) > _HUGE):
        return f"must stay below {_HUGE:g}, the largest value that MuJoCo takes for a state"
    if key == "joints" and joint.kind in ("free", "ball"):
        length = np.linalg.norm(numbers[-4:])
        if abs(length - 1.0) > 1e-3:
            return f"the quaternion (w, x, y, z) must have length 1, it has {length:.6g}"
        numbers[-4:] /= length
    target[part] = numbers
    return ""


def _weakest_dof(model: Any, data: Any) -> tuple[int, float]:
    """The degree of freedom with the least effective inertia, and the least eigenvalue of the scaled mass matrix.

    Args:
        model: The scene.
        data: MuJoCo data after ``mj_forward``.

    Returns:
        Index of the degree of freedom, and the eigenvalue: 1 if all are independent, NaN if the matrix is not finite.
    """
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    diagonal = np.diag(mass)
    bad = ~(np.isfinite(mass).all(axis=0) & (diagonal > 0.0))
    if bad.any():
        return int(np.argmax(bad)), float("nan")
    # Scaling removes units and sizes: what remains small is a combination of coordinates with almost no inertia.
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(mass * np.outer(scale, scale))
    return int(np.argmax(np.abs(vectors[:, 0]))), float(values[0])
