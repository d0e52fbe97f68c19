"""Columns of a run with the loads of its equality constraints: of pins, welds and couplings of a mechanism."""

from __future__ import annotations

from typing import Any

import mujoco

from ffsm_mj.dynamics.loops.equalities import Equality
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.records.signals import Signal, identifier

_AT_ROW = "under the efforts of this row; of least norm where the rows of constraints depend on each other"


def load_signals(model: Any, equality: Equality) -> tuple[Signal, ...]:
    """Signals of the load of a constraint: force, of a weld torque too, or the force along the one row of a coupling."""
    name = str(model.equality(equality.id).name)
    start, kind = identifier(name), mujoco.mjtEq(model.eq_type[equality.id])
    if isinstance(equality.source, LatchedBodies):
        second = model.body(equality.source.second).name
        forces = [(f"force_{x}_N", "N", f"force of {name} on {second}, world axes") for x in "xyz"]
        torques = [(f"torque_{x}_N_m", "N m", f"torque of {name} on {second} about its point, world axes") for x in "xyz"]
        columns = forces + (torques if kind == mujoco.mjtEq.mjEQ_WELD else [])
    else:
        joint = int(model.eq_obj1id[equality.id])
        turns = kind == mujoco.mjtEq.mjEQ_JOINT and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        follower = (model.joint if kind == mujoco.mjtEq.mjEQ_JOINT else model.tendon)(joint).name
        size, unit = ("torque_N_m", "N m") if turns else ("force_N", "N")
        columns = [(size, unit, f"{size.partition('_')[0]} of {name} on {follower}")]
    return tuple(Signal("contact", f"{start}_{key}", unit, f"{what}, {_AT_ROW}", name) for key, unit, what in columns)
