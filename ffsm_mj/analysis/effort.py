"""Effort of each actuator in a run: integral of its square, work, peak, share of time at a bound."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.analysis.base_rotation import BaseRotation
from ffsm_mj.analysis.momentum_exchange import MomentumExchange
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.log.recorder import Sink
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.driven_joints import drives_rotation
from ffsm_mj.model.inputs import further_inputs
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.signals import coordinate_keys, identifier, rate_keys

MEASURES = {
    "integral_u2": "integral of the applied effort squared, N^2 s or (N m)^2 s",
    "work_J": "work done by the applied effort, J",
    "peak": "greatest magnitude of the applied effort, N or N m",
    "at_bound": "share of the ticks at which the applied effort is at the least or greatest possible one",
}
"""Statistics of each actuator, by name."""
SUMMED = ("integral_u2", "work_J")
"""Those whose value of several actuators is a sum; of the others it is the greatest."""


class Effort(Sink):
    """Accumulates the effort statistics. An effort is held from one row to the next, so sums over rows are integrals.

    That of a servo varies between two rows: its numbers are those of the force at the rows, held to the next. The work of an
    effort on a joint is effort times displacement, exact while the effort is held. The work of an effort at a
    site, whose direction moves with the site, is its power at the rows, integrated by the trapezoidal rule.

    Attributes:
        base_rotation: Rotation of the base, which a free-floating robot pays its motion with.
        momentum_exchange: Angular momentum by body and actuator, before and after.
    """

    def __init__(self, system: System) -> None:
        """Bind to robot and objects."""
        self._system = system
        self._actuators = np.flatnonzero(~further_inputs(system.mj))
        self._names = tuple(system.names("actuator")[i] for i in self._actuators.tolist())
        self.base_rotation, self.momentum_exchange = BaseRotation(system), MomentumExchange(system)
        self._joint, self._gear = (each[self._actuators] for each in _drives(system.mj))
        n = len(self._names)
        self._square, self._work, self._peak, self._bounded, self._ticks = *np.zeros((4, n)), 0
        self._last: tuple[float, FloatArray, FloatArray, FloatArray] | None = None

    def open(self, header: RunHeader) -> None:
        """Find the columns of a run.

        Raises:
            KeyError: The log lacks one of them.
        """
        layout, joints = header.layout, self._system.joints.values()
        suffixes = ["N_m" if drives_rotation(self._system.mj, i) else "N" for i in self._actuators.tolist()]
        units = list(zip(map(identifier, self._names), suffixes, strict=True))
        servos = servo_mask(self._system.mj)[self._actuators]
        self._time = layout.time
        self.base_rotation.open(layout)
        self.momentum_exchange.open(header)
        # A servo is at a bound where a limit of its model file changes its force.
        columns = (("applied", "force"), ("lower", "unclamped"), ("upper", "unclamped"))
        self._applied, self._lower, self._upper = (
            layout.places(
                f"actuators.{name}_{of_servo if servo else of_motor}_{suffix}"
                for (name, suffix), servo in zip(units, servos, strict=True)
            )
            for of_motor, of_servo in columns
        )
        self._servos = servos
        self._qpos, self._qvel = layout.places(coordinate_keys(joints)), layout.places(rate_keys(joints))

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        self.base_rotation.rows(block)
        self.momentum_exchange.rows(block)
        applied, lower, upper = block[:, self._applied], block[:, self._lower], block[:, self._upper]
        self._ticks += len(block)
        self._peak = np.maximum(self._peak, np.abs(applied).max(axis=0, initial=0.0))
        bounded = ((applied <= lower) | (applied >= upper)) & (upper > lower)
        self._bounded += np.where(self._servos, applied != lower, bounded).sum(axis=0)
        length, power = self._lengths_and_powers(block[:, self._qpos], block[:, self._qvel], applied)
        times = block[:, self._time]
        if self._last is not None:
            t, held, at, rate = self._last
            times, applied = np.append(t, times), np.vstack([held, applied])
            length, power = np.vstack([at, length]), np.vstack([rate, power])
        steps, held = np.diff(times)[:, None], applied[:-1]
        self._square = _added(self._square, held**2 * steps)
        self._work = _added(self._work, held * np.diff(length, axis=0) + 0.5 * (power[1:] + power[:-1]) * steps)
        self._last = float(times[-1]), applied[-1].copy(), length[-1].copy(), power[-1].copy()

    def _lengths_and_powers(self, qpos: FloatArray, qvel: FloatArray, applied: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates of driven scalar joints, and power of all other actuators, both (rows, actuators)."""
        model, scalar = self._system.mj, self._joint >= 0
        length, power = np.zeros_like(applied), np.zeros_like(applied)
        length[:, scalar] = qpos[:, model.jnt_qposadr[self._joint[scalar]]]
        if not scalar.all():
            data = self._data
            for row in np.flatnonzero(applied[:, ~scalar].any(axis=1)):
                data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_transmission(model, data)
                mujoco.mj_fwdVelocity(model, data)
                power[row] = np.where(scalar, 0.0, applied[row] * data.actuator_velocity[self._actuators] / self._gear)
        return length, power

    @cached_property
    def _data(self) -> Any:
        """Data for the kinematics of actuators that drive no scalar joint."""
        return mujoco.MjData(self._system.mj)

    def event(self, event: Event) -> None:
        """Note what is grasped; efforts are in the rows."""
        self.momentum_exchange.event(event)

    def summary(self) -> dict[str, Any]:
        """``effort``, ``base_rotation`` and ``angular_momentum`` of ``summary.json``; None for what is not finite."""
        effort = {
            name: {measure: value if math.isfinite(value) else None for measure, value in each.items()}
            for name, each in self.by_actuator().items()
        }
        return {
            "effort": effort,
            "base_rotation": self.base_rotation.summary(),
            "angular_momentum": self.momentum_exchange.summary(),
        }

    def by_actuator(self) -> dict[str, dict[str, float]]:
        """Each of :data:`MEASURES` by actuator, under its name in the columns of a log."""
        share = self._bounded / max(self._ticks, 1)
        rows = np.column_stack([self._square, self._work, self._peak, share]).tolist()
        names = map(identifier, self._names)
        return {name: dict(zip(MEASURES, each, strict=True)) for name, each in zip(names, rows, strict=True)}


def _added(total: FloatArray, terms: FloatArray) -> FloatArray:
    """Sum term by term, so that its bits do not depend on the division of the rows into blocks."""
    return np.asarray(np.cumsum(np.vstack([total, terms]), axis=0)[-1])


def _drives(model: Any) -> tuple[IntArray, FloatArray]:
    """Hinge or slide that each actuator drives, -1 for none; ratio of MuJoCo's actuator velocity to the joint's."""
    on_joint = np.asarray(model.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)
    joint = np.where(on_joint, np.asarray(model.actuator_trnid)[:, 0], -1).astype(np.intp)
    kinds = np.asarray(model.jnt_type)[joint]
    scalar = on_joint & np.isin(kinds, (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)))
    gear = np.where(on_joint, np.asarray(model.actuator_gear)[:, 0], 1.0)
    return np.where(scalar, joint, -1), gear
