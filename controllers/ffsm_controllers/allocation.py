"""Shares of thrusters and wheels in what the base is to feel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import ControllerError, Fault, FloatArray, IntArray, ScenarioFaults, System

_SMALL_SHARES = 1e-7
_PASSES = 100


def actuators_by_name(system: System, names: Sequence[str], key: str) -> IntArray:
    """Ids of actuators.

    Raises:
        ScenarioFaults: An unknown actuator.
    """
    found, faults = [], []
    for i, name in enumerate(names):
        try:
            found.append(system.index("actuator", name))
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), (key, i)))
    if faults:
        raise ScenarioFaults(faults)
    return np.array(found, dtype=np.intp)


class ThrusterAllocation:
    """Efforts of thrusters that together come closest to a generalised force on the base, by non-negative least squares.

    A thruster whose ctrlrange starts at 0 only pushes; any other works both ways.
    """

    def __init__(self, system: System, thrusters: IntArray) -> None:
        """Find which thrusters push only."""
        model = system.mj
        self._model, self._thrusters, self._base = model, thrusters, system.robot.base_dofs
        one_way = model.actuator_ctrllimited[thrusters].astype(bool) & (model.actuator_ctrlrange[thrusters, 0] >= 0.0)
        self._both_ways = ~one_way

    def efforts(self, data: Any, force: FloatArray) -> FloatArray:
        """Effort of each thruster for a generalised force on the base dofs, at the pose in ``data``."""
        effect = moments(self._model, data)[self._thrusters][:, self._base].T
        columns = np.hstack((effect, -effect[:, self._both_ways]))
        shares = _shares(columns, force)
        efforts = shares[: len(self._thrusters)]
        efforts[self._both_ways] -= shares[len(self._thrusters) :]
        return efforts


def _shares(columns: FloatArray, force: FloatArray) -> FloatArray:
    """Non-negative shares of columns that together come closest to a force.

    Redundant columns can send the method round in circles. Where they do, small shares are asked for as well, with a weight
    that costs a millionth of the force: then no two sets of shares are equally good.

    Raises:
        ControllerError: It does not end even so.
    """
    from scipy.optimize import nnls  # a second to import, needed by runs that steer by thrusters

    try:
        return np.asarray(nnls(columns, force)[0])
    except RuntimeError:  # its iteration limit
        count = columns.shape[1]
    weight = _SMALL_SHARES * float(np.linalg.norm(columns, axis=0).max())
    stacked, wanted = np.vstack((columns, weight * np.eye(count))), np.append(force, np.zeros(count))
    try:
        return np.asarray(nnls(stacked, wanted, maxiter=_PASSES * count)[0])
    except RuntimeError as error:
        raise ControllerError("no shares of the thrusters in the force on the base were found") from error


class WheelAllocation:
    """Torques of wheel motors for a torque on the base; a motor on a base joint turns the base itself (an ideal wheel)."""

    def __init__(self, system: System, wheels: IntArray) -> None:
        """Find each wheel's joint, and whether the base feels its motor's torque or the reaction.

        Raises:
            ScenarioFaults: A wheel's actuator drives no hinge of the base or of a body mounted on it.
        """
        model = system.mj
        self._joints = []
        faults = []
        for i, wheel in enumerate(wheels):
            joint = int(model.actuator_trnid[wheel, 0])
            on_hinge = model.actuator_trntype[wheel] == mujoco.mjtTrn.mjTRN_JOINT
            if not on_hinge or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
                faults.append(Fault(f"{model.actuator(wheel).name!r} drives no hinge joint", ("wheels", i)))
            self._joints.append(joint)
        if faults:
            raise ScenarioFaults(faults)
        own = model.jnt_bodyid[self._joints] == system.robot.root
        self._sign = np.where(own, 1.0, -1.0)

    def efforts(self, data: Any, torque: FloatArray) -> FloatArray:
        """Torque of each wheel's motor for a torque on the base in world axes; least effort where wheels are redundant."""
        axes = data.xaxis[self._joints] * self._sign[:, None]
        return np.asarray(np.linalg.lstsq(axes.T, torque, rcond=None)[0])


def moments(model: Any, data: Any) -> FloatArray:
    """Generalised force per unit effort of each actuator, dense, (nu, nv)."""
    dense = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(dense, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    unit: FloatArray = model.actuator_gear[:, 0].copy()
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    return dense / np.where(on_joint & (unit != 0.0), unit, 1.0)[:, None]
