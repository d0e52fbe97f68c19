"""Stability limit of damping gains at the control period: above it a joint velocity changes sign and grows every tick."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.controller_protocol import Damping, Damps
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import described
from ffsm_mj.model.system import System

# An effort -K qdot held for a period dt maps qdot to (1 - dt M_c^-1 K) qdot; position gains do not change this limit.
_LIMIT = 2.0


def unstable_damping(assembly: Assembly) -> Iterator[str]:
    """Messages for phases with unstable damping, with all degrees of freedom that the law does not damp left free.

    Args:
        assembly: Parts of one run, at the initial state.
    """
    for phase in assembly.controller.phases:
        if not isinstance(phase.controller, Damps):
            continue
        try:
            damping = phase.controller.damping_at(assembly.controller_data)
            message = (
                _instability(assembly.system, assembly.data, assembly.scenario.control_period_s, damping) if damping else ""
            )
        except Exception as error:  # noqa: BLE001 (a plugin's code: whatever it raises is no reason to refuse the scenario)
            message = f"its damping cannot be computed ({described(error)})"
        if message:
            yield f"phase {phase.name!r} ({phase.kind}): {message}"


def _instability(system: System, data: Any, period: float, damping: Damping) -> str:
    """Message for an unstable damping; empty if it is stable."""
    dofs = damping.dofs
    # This part of M^-1 is the inverse of M_c, the mass matrix of these dofs with all others floating.
    mobility = np.linalg.solve(mass_matrix(system.mj, data), np.eye(system.mj.nv)[:, dofs])[dofs]
    values, vectors = np.linalg.eig(period * mobility @ damping.matrix)
    worst = int(np.argmax(values.real))
    eigenvalue = float(values.real[worst])
    if eigenvalue <= _LIMIT:
        return ""
    motion = vectors[:, worst]
    dof = int(np.argmax(np.abs(motion.conj() * (damping.matrix @ motion))))  # by power: rad/s and m/s compare
    joint = next(joint.name for joint in system.joints.values() if joint.dofs.start <= dofs[dof] < joint.dofs.stop)
    gain = float(damping.gains[dof])
    alike = "" if np.all(damping.gains == gain) else ", with the others in proportion"
    return (
        f"{damping.key} is unstable at the control period of {period:g} s: dt M_c^-1 K_d has the eigenvalue "
        f"{eigenvalue:.3g} (stable up to {_LIMIT:g}), mostly of joint {joint!r}; {damping.key} = {gain:g} there is stable "
        f"up to {_rounded_down(gain * _LIMIT / eigenvalue):g}{alike}"
    )


def _rounded_down(value: float) -> float:
    """Round a positive number down to three digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / unit) * unit:.3g}")
