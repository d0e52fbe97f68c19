"""Joints of a latch: the relative motion that a closed grasp leaves free, about and along an axis through the object's site.

The axis is fixed in the link of the robot's site: where the frames of the two sites are not aligned at the closing, they
stay as they are, and the axis is the robot's.

Plastic impulse that joins two bodies at their current pose: it stops the relative motions that a latch does not permit.

With the rows J of these components of the relative twist at one point of both bodies, u = J qdot, the impulse on the second
is lambda = -(J M^-1 J^T)^+ u and qdot+ = qdot + M^-1 J^T lambda. In mass-weighted velocities w = L^T qdot, M = L L^T, this
removes the component of w in the row space of A = J L^-T, so the energy loss is half the square of that component. Joints
that allow fewer relative motions than the latch stops, such as planar ones, make the rows dependent: an SVD determines
their rank.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing_condition import Sites
from ffsm_mj.dynamics.loops.closed_loops import MassWeightedRows, PlasticClosing
from ffsm_mj.dynamics.loops.latch import axes_about, stopped_along_axes
from ffsm_mj.dynamics.rigid_body import mass_matrix, rotation_matrix
from ffsm_mj.model.grasp import Grasp, LatchJoint
from ffsm_mj.model.system import Joint, System


def relative_twist_rows(model: Any, data: Any, first: int, second: int, point: FloatArray) -> FloatArray:
    """Jacobian of the relative twist of two bodies at a common point, (6, nv)."""
    of_first, of_second = np.empty((6, model.nv)), np.empty((6, model.nv))
    for rows, body in ((of_first, first), (of_second, second)):
        mujoco.mj_jac(model, data, rows[:3], rows[3:], point, body)
    # At one point of both bodies: the impulses on them are then opposite along one line, have no moment, and keep L.
    return of_second - of_first


def plastic_impulse(
    model: Any, data: Any, first: int, second: int, point: FloatArray, stopped: FloatArray | None = None
) -> PlasticClosing:
    """Compute the impulse that joins two bodies at the state in ``data``, which is not changed.

    Its ``impulses`` are the impulse on the second body in N s and its moment about the point in N m s, world axes, (6,).

    Args:
        model: MuJoCo model.
        data: Its data, positions and velocities current.
        first: Id of one body.
        second: Id of the other.
        point: Point of application, world axes, m, (3,).
        stopped: Orthonormal components of the relative twist that are stopped, (n, 6); None: all six.
    """
    J = relative_twist_rows(model, data, first, second, point)
    plastic = MassWeightedRows(mass_matrix(model, data), J if stopped is None else stopped @ J).plastic(data.qvel)
    return plastic if stopped is None else replace(plastic, impulses=plastic.impulses @ stopped)


_TURN = 2.0 * math.pi


def stopped_components(kind: str, axis: FloatArray) -> FloatArray:
    """Orthonormal components of the relative twist at the object's site that a latch stops, (n, 6).

    Args:
        kind: Kind of the latch; see :class:`~ffsm_mj.model.grasp.LatchJoint`.
        axis: Its axis, world axes, (3,); ignored for kinds without one.

    Raises:
        LookupError: There is no such kind.
    """
    axes = axes_about(axis.tolist() if np.any(axis) else ())
    return np.asarray((stopped_along_axes(kind).reshape(-1, 2, 3) @ axes.T).reshape(-1, 6))


def axis_angle_rad(data: Any, sites: Sites, joint: LatchJoint) -> float:
    """Angle between the axis of a latch and the same axis of the object's site; 0 for kinds without one."""
    if not joint.axis:
        return 0.0
    one, other = (_frame(data, site) @ joint.axis for site in (sites.robot, sites.object))
    # An angle near zero from its cosine alone would be known to 1e-8 only.
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


class LatchJoints:
    """Joints of a latch in the system in which it is closed; none if it is rigid.

    A slide has the coordinate 0 where the object's site is beside the robot's, hinge and ball where the axes of their frames
    are aligned. Any later state of a closed grasp therefore gives the same joints as the state at the closing.

    Attributes:
        dofs: Their degrees of freedom in that system.
    """

    def __init__(self, free: System, grasped: System, grasp: Grasp) -> None:
        """Look up sites and joints.

        Args:
            free: The system without the grasp.
            grasped: The system in which it is closed.
            grasp: The grasp.
        """
        self._free, self._joint, self._sites = free.mj, grasp.joint, Sites(free, grasp)
        self._joints: list[tuple[Joint, int]] = [
            (grasped.joints[name], grasped.index("joint", name)) for name in map(grasp.joint_name, grasp.joint.joints)
        ]
        self._root = grasped.index("body", grasp.root)
        self.dofs = np.array([d for joint, _ in self._joints for d in range(joint.dofs.start, joint.dofs.stop)], dtype=int)

    def axis(self, data: Any) -> FloatArray:
        """The axis, world axes, (3,); zeros for kinds without one."""
        return np.asarray(_frame(data, self._sites.robot) @ self._joint.axis) if self._joint.axis else np.zeros(3)

    def stopped(self, data: Any) -> FloatArray | None:
        """Components of the relative twist at the object's site that it stops, (n, 6); None: all, it is rigid."""
        return stopped_components(self._joint.kind, self.axis(data)) if self._joints else None

    def rate_rows(self, data: Any) -> FloatArray:
        """Rates of the joints as linear functions of ``qvel`` of the system without the grasp, (number of dofs, nv)."""
        axis, free = self.axis(data), []
        for kind in self._joint.joints:
            # Rows of the relative twist: velocity of the site first, then angular velocity.
            part = np.zeros((3 if kind == "ball" else 1, 6))
            # Rates of a ball joint are along the axes of the object.
            part[:, slice(0, 3) if kind == "slide" else slice(3, 6)] = (
                data.xmat[self._sites.root].reshape(3, 3).T if kind == "ball" else axis
            )
            free.append(part)
        sites = self._sites
        rows = relative_twist_rows(self._free, data, sites.link, sites.root, sites.point(data))
        return np.concatenate([np.empty((0, 6)), *free]) @ rows

    def fasten(self, data: Any, model: Any, qpos: FloatArray) -> None:
        """Attach the object where it is.

        Args:
            data: State of the system without the grasp.
            model: Model of the system with it: the pose of the object on the link, and point and axis of the joints, are
                written.
            qpos: Its coordinates, of which those of the joints are written.
        """
        body = data.xmat[self._sites.root].reshape(3, 3)
        for joint, number in self._joints:
            qpos[joint.qpos] = 0.0
            model.jnt_pos[number] = body.T @ (self._sites.point(data) - data.xpos[self._sites.root])
            if self._joint.axis:
                model.jnt_axis[number] = body.T @ self.axis(data)
        self.write_coordinates(data, qpos)
        self._write_reference(data, model, [qpos[joint.qpos] for joint, _ in self._joints])

    def write_coordinates(self, data: Any, qpos: FloatArray) -> None:
        """Write the coordinates of the joints for a state of the system without the grasp.

        Hinges keep their full turns, and balls their sign, from the coordinates before.
        """
        for (joint, _), value in zip(self._joints, self._coordinates(data), strict=True):
            if joint.kind == "hinge":
                # A hinge counts full turns, which poses do not show: its coordinate continues, and springs or servos see no
                # jump.
                qpos[joint.qpos] = value + _TURN * np.round((qpos[joint.qpos] - value) / _TURN)
            elif joint.kind == "ball" and value.dot(qpos[joint.qpos]) < 0.0:
                # q and -q are one rotation. A conversion from a matrix gives w >= 0; a motion past half a turn does not, and
                # the coordinates of the object follow from these.
                qpos[joint.qpos] = -value
            else:
                qpos[joint.qpos] = value

    def _pose(self, data: Any) -> FloatArray:
        """Orientation of the object's base in the frame of the link, (4,)."""
        back, pose = np.empty(4), np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[self._sites.link])
        mujoco.mju_mulQuat(pose, back, data.xquat[self._sites.root])
        # The compiler would normalise body_quat; a model that is written to has to be given a unit quaternion.
        mujoco.mju_normalize4(pose)
        return pose

    def _coordinates(self, data: Any) -> list[FloatArray]:
        """Coordinates of the joints, in their order."""
        one, other = (_frame(data, site) for site in (self._sites.robot, self._sites.object))
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, (one.T @ other).ravel())
        coordinates = []
        for kind in self._joint.joints:
            if kind == "slide":
                offset = data.site_xpos[self._sites.object] - data.site_xpos[self._sites.robot]
                coordinates.append(np.array([offset @ self.axis(data)]))
            elif kind == "hinge":
                # The rotation about the axis that brings the frames closest.
                coordinates.append(np.array([2.0 * math.atan2(float(turn[1:] @ self._joint.axis), float(turn[0]))]))
            else:
                body = data.xmat[self._sites.root].reshape(3, 3)  # the same rotation in the axes of the object
                mujoco.mju_mat2Quat(turn, (body.T @ other @ one.T @ body).ravel())
                coordinates.append(turn)
        return coordinates

    def _write_reference(self, data: Any, model: Any, coordinates: list[FloatArray]) -> None:
        """Write the pose that the object has on the link where the coordinates of the joints are zero."""
        pose, position, turned = self._pose(data), data.xpos[self._sites.root], np.empty(4)
        link = data.xmat[self._sites.link].reshape(3, 3)
        if self._joints:
            position = self._sites.point(data)
            # MuJoCo applies joints from the reference pose on: it is the present pose with their motion taken back.
            for kind, value in zip(self._joint.joints, coordinates, strict=True):
                if kind == "slide":
                    position = position - value * self.axis(data)
                    continue
                back = np.empty(4)
                if kind == "ball":
                    mujoco.mju_negQuat(back, value)
                else:
                    mujoco.mju_axisAngle2Quat(back, model.jnt_axis[self._joints[-1][1]], -float(value[0]))
                mujoco.mju_mulQuat(turned, pose, back)
                pose = turned
            position = position - link @ rotation_matrix(pose) @ model.jnt_pos[self._joints[0][1]]
        model.body_pos[self._root], model.body_quat[self._root] = link.T @ (position - data.xpos[self._sites.link]), pose


def _frame(data: Any, site: int) -> FloatArray:
    return np.asarray(data.site_xmat[site].reshape(3, 3))
