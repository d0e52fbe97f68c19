"""Stability limit of damping gains at the control period: above it a joint velocity changes sign and grows every tick."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ffsm_controllers.parts import Parts
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.controller_model import SharedJoints
from ffsm_mj.assembly.spring_modes import rounded_down
from ffsm_mj.controller_protocol import Controller, Damps, FloatArray, IntArray
from ffsm_mj.dynamics.loops.equalities import ConstrainedModel
from ffsm_mj.errors import described

# An effort -K qdot held for a period dt maps qdot to (1 - dt M_c^-1 K) qdot; position gains do not change this limit.
_LIMIT = 2.0


class _Damping(NamedTuple):
    """Damping of all laws of a phase: key and gain of each dof, dofs of the model, and the matrix, block by block."""

    keys: list[str]
    dofs: IntArray
    gains: FloatArray
    matrix: FloatArray


def unstable_damping(assembly: Assembly) -> Iterator[str]:
    """Messages for phases with unstable damping, with all degrees of freedom that the law does not damp left free.

    Args:
        assembly: Parts of one run, at the initial state.
    """
    for phase in assembly.controller.phases:
        try:
            damping = _damping(phase.controller, assembly.controller_data)
            message = _instability(assembly, damping) if damping else ""
        except Exception as error:  # noqa: BLE001 (a plugin's code: whatever it raises is no reason to refuse the scenario)
            message = f"its damping cannot be computed ({described(error)})"
        if message:
            yield f"phase {phase.name!r} ({phase.kind}): {message}"


def _damping(law: Controller, data: Any) -> _Damping | None:
    """Damping of a law or of all parts of a phase; None without any."""
    laws = {f"{part.name}.": part.law for part in law.parts} if isinstance(law, Parts) else {"": law}
    given = {prefix: each.damping_at(data) for prefix, each in laws.items() if isinstance(each, Damps)}
    found = {prefix: damping for prefix, damping in given.items() if damping is not None}
    if not found:
        return None
    matrix = np.zeros((sum(len(each.dofs) for each in found.values()),) * 2)
    keys: list[str] = []
    for prefix, each in found.items():
        block = slice(len(keys), len(keys) + len(each.dofs))
        matrix[block, block] = each.matrix
        keys += [prefix + each.key] * len(each.dofs)
    dofs, gains = (np.concatenate([getattr(each, name) for each in found.values()]) for name in ("dofs", "gains"))
    return _Damping(keys, dofs, gains, matrix)


def _instability(assembly: Assembly, damping: _Damping) -> str:
    """Message for an unstable damping; empty if it is stable."""
    system, data, period = assembly.system, assembly.data, assembly.scenario.control_period_s
    dofs = damping.dofs
    if assembly.controller_system is not None:  # a law may not know all joints of the plant
        dofs = SharedJoints(system.mj, assembly.controller_system.mj).dofs[dofs]
    # This part of M^-1 is the inverse of M_c, the mass matrix of these dofs with all others floating.
    answers = np.empty((len(dofs), system.mj.nv))
    ConstrainedModel(system.mj).respond(data, np.eye(system.mj.nv)[dofs], answers)
    mobility = answers[:, dofs]
    values, vectors = np.linalg.eig(period * mobility @ damping.matrix)
    worst = int(np.argmax(values.real))
    eigenvalue = float(values.real[worst])
    if eigenvalue <= _LIMIT:
        return ""
    motion = vectors[:, worst]
    dof = int(np.argmax(np.abs(motion.conj() * (damping.matrix @ motion))))  # by power: rad/s and m/s compare
    joint = next(joint.name for joint in system.joints.values() if joint.dofs.start <= dofs[dof] < joint.dofs.stop)
    gain = float(damping.gains[dof])
    key = damping.keys[dof]
    alike = "" if np.all(damping.gains == gain) else ", with the others in proportion"
    return (
        f"{key} is unstable at the control period of {period:g} s: dt M_c^-1 K_d has the eigenvalue "
        f"{eigenvalue:.3g} (stable up to {_LIMIT:g}), mostly of joint {joint!r}; {key} = {gain:g} there is stable "
        f"up to {rounded_down(gain * _LIMIT / eigenvalue):g}{alike}"
    )
