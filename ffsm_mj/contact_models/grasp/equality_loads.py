"""Columns of a run with the loads of its equality constraints: of pins, welds and couplings of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import Equality
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.records.signals import Signal, identifier

_AT_ROW = "under the efforts of this row; of least norm where the rows of constraints depend on each other"


class EqualityLoads:
    """Loads of the equality constraints of a model.

    Attributes:
        signals: Signals of the columns: force, of a weld torque too, or the force along the one row of a coupling.
        values: Their present values, (number of signals,).
    """

    def __init__(self, model: Any, equalities: Sequence[Equality]) -> None:
        """Bind to the constraints of the compiled scene, in the order in which they are sources of rows."""
        by_equality = [_signals(model, each) for each in equalities]
        self.signals = tuple(signal for signals in by_equality for signal in signals)
        self.values = np.zeros(len(self.signals))
        ends = np.cumsum([0, *(len(signals) for signals in by_equality)]).tolist()
        self._parts = [slice(start, end) for start, end in pairwise(ends)]

    def write(self, loops: ClosedLoops, forces: FloatArray) -> None:
        """Update the values.

        Args:
            loops: Rows of these constraints, and then of others, at the state in their data.
            forces: Forces of all rows, (n,).
        """
        for which, (part, source) in enumerate(zip(self._parts, loops.sources, strict=False)):
            if isinstance(source, LatchedBodies):
                wrench = np.concatenate(loops.wrench(which, forces)[1:])
                self.values[part] = wrench[: part.stop - part.start]
            else:
                self.values[part] = forces[loops.parts[which]]


def _signals(model: Any, equality: Equality) -> tuple[Signal, ...]:
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
