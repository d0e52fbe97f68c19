"""Shares of thrusters and wheels in what the base is to feel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.controller_protocol import (
    ControllerError,
    Faults,
    FloatArray,
    IntArray,
    System,
    driven_bodies,
    site_actuators,
    site_wrench,
)

_SMALL_SHARES = 1e-7
_PASSES = 100
_PREFERRED = 1e-9
"""Of two columns that pull alike, to so much of their pull per place in the list, the first counts; far above rounding."""
_NO_SHARE = 1e-12
"""Of the largest share: below, a share is rounding."""


def actuators_by_name(system: System, names: Sequence[str], key: str) -> IntArray:
    """Ids of actuators of the robot, or of the object that a law drives in its place.

    Raises:
        ScenarioFaults: An unknown actuator, or one of another model.
    """
    actuators = []
    with Faults() as faults:
        for i, name in enumerate(names):
            with faults.below(key, i):
                actuators.append(system.index("actuator", name))
                full = system.names("actuator")[actuators[-1]]
                if any(one.name == full for one in system.magnetorquers):
                    faults.add(f"{name} is a magnetorquer, whose torque depends on the magnetic field", key, i)
                if not any(body in system.robot.bodies for body in driven_bodies(system.mj, actuators[-1])):
                    message = (
                        f"{full} is no actuator of {system.robot.name!r}; a part that drives an object is a part of "
                        "'controllers', with its object in the 'drives' of the phase"
                    )
                    faults.add(message, key, i)
    return np.array(actuators, dtype=np.intp)


class ThrusterAllocation:
    """Efforts of thrusters that together come closest to a wrench on the base, by non-negative least squares on its dofs.

    A thruster whose ctrlrange starts at 0 only pushes; any other works both ways.
    """

    def __init__(self, system: System, thrusters: IntArray) -> None:
        """Find which thrusters push only, and the wrenches of those that sit on the base, which turn with it."""
        model = system.mj
        self._model, self._thrusters = model, thrusters
        self._root, self._base = system.robot.root, system.robot.base_dofs
        one_way = model.actuator_ctrllimited[thrusters].astype(bool) & (model.actuator_ctrlrange[thrusters, 0] >= 0.0)
        self._both_ways = ~one_way
        self._unit = unit_moments(model)
        self._wrenches: FloatArray | None = None
        at_site, sites = site_actuators(model)[thrusters], model.actuator_trnid[thrusters, 0]
        if at_site.all() and np.all(model.site_bodyid[sites] == self._root):
            wrenches = np.array([site_wrench(model, i) for i in thrusters]).reshape(-1, 6).T
            self._wrenches = self._signed(wrenches).reshape(2, 3, -1)
        self._jacobian = np.empty((6, model.nv))

    def efforts(self, data: Any, force: FloatArray, torque: FloatArray) -> FloatArray:
        """Effort of each thruster for a wrench on the base.

        Args:
            data: The pose.
            force: In world axes, N.
            torque: About the origin of the base's frame in world axes, N m.
        """
        mujoco.mj_jacBody(self._model, data, self._jacobian[:3], self._jacobian[3:], self._root)
        on_dofs = self._jacobian[:, self._base].T
        if self._wrenches is None:
            columns = self._signed(moments(self._model, data, self._unit)[self._thrusters][:, self._base].T)
        else:
            axes = data.xmat[self._root].reshape(3, 3)
            columns = on_dofs.dot((axes @ self._wrenches).reshape(6, -1))
        shares = nonnegative_shares(columns, on_dofs[:, :3] @ force + on_dofs[:, 3:] @ torque)
        efforts = shares[: len(self._thrusters)]
        efforts[self._both_ways] -= shares[len(self._thrusters) :]
        return efforts

    def _signed(self, effect: FloatArray) -> FloatArray:
        """Columns of what the thrusters do, and of what those that work both ways do backwards."""
        return np.hstack((effect, -effect[:, self._both_ways]))


def nonnegative_shares(columns: FloatArray, force: FloatArray) -> FloatArray:
    """Non-negative shares of columns that together come closest to a force.

    Where columns tie, as those of jets that are mirror images do, rounding would decide which of them gets a share. So which
    columns have one is decided with columns that are longer the earlier they are in the list, each by the same small step:
    of columns that pull alike the first is taken. The shares are then those of the columns as they are.

    Redundant columns can send the method round in circles. Where they do, small shares are asked for as well, with a weight
    that costs a millionth of the force: then no two sets of shares are equally good.

    Raises:
        ControllerError: It does not end even so.
    """
    from scipy.optimize import nnls  # a second to import, needed by runs that steer by thrusters

    try:
        shares = np.asarray(nnls(columns, force)[0])
        used = _used(nnls(columns * (1.0 + _PREFERRED * np.arange(columns.shape[1], 0.0, -1.0)), force)[0])
        if (used != _used(shares)).any():
            shares = np.zeros(len(shares))
            shares[used] = nnls(columns[:, used], force)[0]
        return shares
    except RuntimeError:  # its iteration limit
        count = columns.shape[1]
    weight = _SMALL_SHARES * float(np.linalg.norm(columns, axis=0).max())
    stacked, wanted = np.vstack((columns, weight * np.eye(count))), np.append(force, np.zeros(count))
    try:
        return np.asarray(nnls(stacked, wanted, maxiter=_PASSES * count)[0])
    except RuntimeError as error:
        raise ControllerError("no shares of the thrusters in the force on the base were found") from error


def _used(shares: FloatArray) -> npt.NDArray[np.bool_]:
    """Which columns have a share."""
    return np.asarray(shares > _NO_SHARE * shares.max(initial=0.0))


class WheelAllocation:
    """Torques of wheel motors for a torque on the base; a motor on a base joint turns the base itself (an ideal wheel)."""

    def __init__(self, system: System, wheels: IntArray) -> None:
        """Find each wheel's joint, and whether the base feels its motor's torque or the reaction.

        Raises:
            ScenarioFaults: A wheel's actuator drives no hinge of the base or of a body mounted on it.
        """
        model = system.mj
        self._joints = []
        with Faults() as faults:
            for i, wheel in enumerate(wheels):
                joint = int(model.actuator_trnid[wheel, 0])
                on_hinge = model.actuator_trntype[wheel] == mujoco.mjtTrn.mjTRN_JOINT
                if not on_hinge or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
                    faults.add(f"{model.actuator(wheel).name!r} drives no hinge joint", "wheels", i)
                self._joints.append(joint)
        self._root, bodies = system.robot.root, model.jnt_bodyid[self._joints]
        self._sign = np.where(bodies == self._root, 1.0, -1.0)
        self._inverse: FloatArray | None = None
        # The axis of a body's first joint is fixed in the body that this one is mounted on.
        if np.all((model.body_parentid[bodies] == self._root) & (model.body_jntadr[bodies] == self._joints)):
            columns = [
                _rotated(model.body_quat[body], model.jnt_axis[joint])
                for body, joint in zip(bodies, self._joints, strict=True)
            ]
            self._inverse = np.asarray(np.linalg.lstsq(-np.array(columns).reshape(-1, 3).T, np.eye(3), rcond=None)[0])

    def efforts(self, data: Any, torque: FloatArray) -> FloatArray:
        """Torque of each wheel's motor for a torque on the base in world axes; least effort where wheels are redundant."""
        if self._inverse is not None:
            return np.asarray(self._inverse.dot(torque.dot(data.xmat[self._root].reshape(3, 3))))
        axes = data.xaxis[self._joints] * self._sign[:, None]
        return np.asarray(np.linalg.lstsq(axes.T, torque, rcond=None)[0])


def _rotated(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, vector, quaternion)
    return turned


def unit_moments(model: Any) -> FloatArray:
    """Gear of the actuators at joints, which their moments have and their efforts have too; 1 for all others, (nu, 1)."""
    gear: FloatArray = model.actuator_gear[:, 0].copy()
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    return np.where(on_joint & (gear != 0.0), gear, 1.0)[:, None]


def moments(model: Any, data: Any, unit: FloatArray) -> FloatArray:
    """Generalised force per unit effort of each actuator, dense, (nu, nv).

    Args:
        model: MuJoCo model.
        data: The pose.
        unit: From :func:`unit_moments`.
    """
    dense = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(dense, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return dense / unit
