"""What each actuator did in a run, gathered as its rows go past: effort, work, peak, time at a bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.signals import coordinate_keys, identifier, rate_keys

MEASURES = {
    "integral_u2": "integral of the applied effort squared, N^2 s or (N m)^2 s",
    "work_J": "work done by the applied effort, J",
    "peak": "greatest magnitude of the applied effort, N or N m",
    "at_bound": "share of the ticks at which the applied effort is at the least or greatest possible one",
}
"""By name, what is told of each actuator."""


class Effort:
    """Gathers what actuators did. An effort is held from one row to the next, so sums over rows are integrals.

    Work of an effort on a joint is effort times displacement, exact while the effort is held; that of one on a site is its
    power at the rows by the trapezoidal rule, since it moves with the site.
    """

    def __init__(self, system: System, keys: Mapping[str, Sequence[str]]) -> None:
        """Bind to a model; nothing was told yet.

        Args:
            system: What moves.
            keys: Columns of ``applied``, ``lower`` and ``upper`` by actuator, in MuJoCo's order.
        """
        self._system, self._keys = system, keys
        self._names = system.names("actuator")
        self._joint, self._gear = _drives(system.mj)
        n = len(self._names)
        self._square, self._work, self._peak, self._bounded, self._ticks = *np.zeros((4, n)), 0
        self._last: tuple[float, FloatArray, FloatArray, FloatArray] | None = None

    def open(self, header: RunHeader) -> None:
        """Begin a run."""
        layout, joints = header.layout, self._system.joints.values()
        self._time = layout.time
        self._applied, self._lower, self._upper = (layout.places(self._keys[what]) for what in ("applied", "lower", "upper"))
        self._qpos, self._qvel = layout.places(coordinate_keys(joints)), layout.places(rate_keys(joints))

    def rows(self, block: FloatArray) -> None:
        """Take the next rows."""
        applied, lower, upper = block[:, self._applied], block[:, self._lower], block[:, self._upper]
        self._ticks += len(block)
        self._peak = np.maximum(self._peak, np.abs(applied).max(axis=0, initial=0.0))
        self._bounded += (((applied <= lower) | (applied >= upper)) & (upper > lower)).sum(axis=0)
        length, power = self._driven(block[:, self._qpos], block[:, self._qvel], applied)
        times = block[:, self._time]
        if self._last is not None:
            t, held, at, rate = self._last
            times, applied = np.append(t, times), np.vstack([held, applied])
            length, power = np.vstack([at, length]), np.vstack([rate, power])
        steps, held = np.diff(times)[:, None], applied[:-1]
        self._square = _added(self._square, held**2 * steps)
        self._work = _added(self._work, held * np.diff(length, axis=0) + 0.5 * (power[1:] + power[:-1]) * steps)
        self._last = float(times[-1]), applied[-1].copy(), length[-1].copy(), power[-1].copy()

    def _driven(self, qpos: FloatArray, qvel: FloatArray, applied: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By row and actuator: displacement of the joint that it drives, and power of what drives no scalar joint."""
        model, scalar = self._system.mj, self._joint >= 0
        length, power = np.zeros_like(applied), np.zeros_like(applied)
        length[:, scalar] = qpos[:, model.jnt_qposadr[self._joint[scalar]]]
        if not scalar.all():
            data = self._data
            for row in range(len(qpos)):
                data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_transmission(model, data)
                mujoco.mj_fwdVelocity(model, data)
                power[row] = np.where(scalar, 0.0, applied[row] * data.actuator_velocity / self._gear)
        return length, power

    @cached_property
    def _data(self) -> Any:
        """Data for the kinematics of actuators that drive no scalar joint."""
        return mujoco.MjData(self._system.mj)

    def event(self, event: Event) -> None:
        """Nothing to do: efforts are told by rows."""

    def flush(self) -> None:
        """Nothing to do: memory does not survive a kill."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Nothing to do."""

    def told(self) -> dict[str, dict[str, float]]:
        """By actuator, its name as in the columns of a log: each of :data:`MEASURES`."""
        share = self._bounded / max(self._ticks, 1)
        by_actuator = np.column_stack([self._square, self._work, self._peak, share]).tolist()
        names = map(identifier, self._names)
        return {name: dict(zip(MEASURES, each, strict=True)) for name, each in zip(names, by_actuator, strict=True)}


def _added(total: FloatArray, terms: FloatArray) -> FloatArray:
    """One term after the other, so that the sum is the same bit by bit however the rows are cut into blocks."""
    return np.asarray(np.cumsum(np.vstack([total, terms]), axis=0)[-1])


def _drives(model: Any) -> tuple[IntArray, FloatArray]:
    """By actuator: the hinge or slide that it drives, -1 for none; and MuJoCo's actuator velocity over the joint's."""
    on_joint = np.asarray(model.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)
    joint = np.where(on_joint, np.asarray(model.actuator_trnid)[:, 0], -1).astype(np.intp)
    kinds = np.asarray(model.jnt_type)[joint]
    scalar = on_joint & np.isin(kinds, (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)))
    gear = np.where(on_joint, np.asarray(model.actuator_gear)[:, 0], 1.0)
    return np.where(scalar, joint, -1), gear
