"""The robot as a control law sees it: its driven joints, with everything else of it floating, and an output of them.

In the words of the paper: M qdd + c is u on the driven joints a and zero on all other dofs b. G = M_b^-1 M_ba,
M_c = M_a - M_ba^T G, c_c = c_a - M_ba^T M_b^-1 c_b. The output's rates are alpha qd_a + v_h, with alpha = J_a - J_b G, the
generalised Jacobian. Equality constraints of the model hold: accelerations are those of the mechanism, in coordinates
qdot = N qd of the independent joints and the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.controller_protocol import (
    ConstrainedModel,
    ControllerContext,
    ControllerError,
    Fault,
    ScenarioFaults,
    SiteMotion,
    TargetMotion,
    driven_joints,
)
from ffsm_mj.errors import faults_below

_SINGULAR = 1e10
"""Condition of the mobility of the driven joints from which on they depend on each other: rows are known to 1e-10."""


class JointModel:
    """Dynamics of the driven joints at the state of the last ``update``, exact for any momentum.

    Attributes:
        joints: Names, dofs and actuators of the driven joints (:class:`~ffsm_mj.controller_protocol.DrivenJoints`).
        qd: Their rates, rad/s or m/s, (n,).
        M_c: Reduced mass matrix in kg m^2 (hinges), (n, n): M_c qdd_a + c_c = u.
        c_c: Reduced bias in N m, (n,).
        mobility: Accelerations of all dofs per unit effort at each driven joint, (n, nv).
        coasting: Accelerations of all dofs where nothing pushes but external fields, also of floating objects, (nv,).
    """

    def __init__(self, context: ControllerContext, joints: Sequence[str] | None = None) -> None:
        """Bind to the system of a control law.

        Args:
            context: What the law is made for.
            joints: Names of the driven joints; None: every motor-driven joint of the robot but those of the base and of
                other parts of the phase.

        Raises:
            ScenarioFaults: A joint that there is not; path ``joints``.
        """
        self.joints = driven_joints(context.system, joints, reserved=context.reserved)
        self._model = context.system.mj
        n, nv = len(self.joints.dofs), self._model.nv
        self._constrained, self._closed = ConstrainedModel(self._model), bool(context.system.equalities)
        # One solve by the factors of M: for unit efforts at the driven joints, and for what acts without any.
        self._forces, self._answers = np.zeros((n + 1, nv)), np.zeros((n + 1, nv))
        self._forces[range(n), self.joints.dofs] = 1.0
        self._pushed, self._field = np.empty((1, nv)), context.external_field

    def update(self, data: Any, pushed: FloatArray | None = None) -> None:
        """Work everything out at the state in ``data``, whose derived quantities must be current.

        Args:
            data: MuJoCo data.
            pushed: Generalised force of other actuators, (nv,), which ``coasting``, ``c_c`` and ``drift`` then account for.
        """
        dofs = self.joints.dofs
        np.subtract(data.qfrc_passive, data.qfrc_bias, out=self._forces[-1])
        if self._field is not None:
            self._field.add_to(data, self._forces[-1])
        if pushed is not None:
            self._forces[-1] += pushed
        self._constrained.respond(data, self._forces, self._answers)
        self.mobility, self.coasting = self._answers[:-1], self._answers[-1]
        if self._closed:
            self.coasting = self.coasting + self._constrained.acceleration()
        self.qd = data.qvel[dofs]
        driven = self.mobility[:, dofs]
        if self._closed and np.linalg.cond(driven) > _SINGULAR:
            raise ControllerError(self._dependent(driven))
        self.M_c = np.linalg.inv(driven)
        self.c_c = -self.M_c.dot(self.coasting[dofs])

    def _dependent(self, mobility: FloatArray) -> str:
        """Sentence for joints that depend on each other: which of them can be driven, by pivoting of their mobility."""
        names, chosen = np.array(self.joints.names), list[int]()
        for i in range(len(mobility)):
            of_these = [*chosen, i]
            if np.linalg.cond(mobility[np.ix_(of_these, of_these)]) <= _SINGULAR:
                chosen = of_these
        alone = f"drive {', '.join(names[chosen])} alone" if chosen else "drive others"
        return f"{', '.join(names)} depend on each other through equality constraints; {alone}, by 'joints'"

    def start_faults(self, data: Any) -> list[Fault]:
        """Why joints cannot be driven from a state: they depend on each other."""
        try:
            self.update(data)
        except ControllerError as error:
            return [Fault(str(error), ("joints",))]
        return []

    def close(self, data: Any) -> None:
        """Let all other joints follow the driven ones in position, as equality constraints have them.

        Args:
            data: State with positions of the driven joints; positions are current after it.

        Raises:
            ControllerError: They cannot.
        """
        if not self._constrained.close(data, self.joints.dofs):
            where = " ".join(f"{value:.6g}" for value in data.qpos[self.joints.qpos])
            names = ", ".join(self.joints.names)
            raise ControllerError(f"the equality constraints cannot be closed with {names} at {where}")

    def accelerations(self, data: Any, force: FloatArray) -> FloatArray:
        """Accelerations of all dofs that a generalised force on them adds, (nv,), at the state last updated."""
        self._constrained.respond(data, force[None, :], self._pushed)
        return np.asarray(self._pushed[0])


class OutputModel(JointModel):
    """A :class:`JointModel` with an output.

    The output is the position of a site along some world axes, by default the task's, and with ``attitude`` its attitude:
    p rows in m, then three of them in rad, rates and accelerations likewise, all in world axes. n joints are driven.

    Attributes:
        site: The output's :class:`~ffsm_mj.controller_protocol.SiteMotion`: point, frame, Jacobian over all dofs.
        yd: Rates of the output in m/s and rad/s, (p,).
        alpha: Generalised Jacobian, (p, n): yd = alpha qd + v_h.
        B: alpha M_c^-1, accelerations of the output per effort, (p, n): ydd = drift + B u.
        drift: Accelerations of the output where the driven joints are without effort and nothing else pushes, (p,).
    """

    def __init__(
        self,
        context: ControllerContext,
        joints: Sequence[str] | None = None,
        *,
        site: str | None = None,
        axes: Sequence[int] | None = None,
        attitude: bool = False,
    ) -> None:
        """Bind to the system of a control law; see :class:`TaskModel`."""
        super().__init__(context, joints)
        system, task = context.system, context.task
        if site is None and task is None:
            raise ScenarioFaults([Fault("a 'task' with tip, axes and target is needed", ("kind",))])
        with faults_below("site"):
            index = task.tip_site if site is None else system.index("site", site)  # type: ignore[union-attr]
        if axes is None:
            axes = task.axes if site is None and task is not None else (0, 1, 2)
        self._axes = list(axes)
        self.site = SiteMotion(self._model, index, axes, attitude)

    def update(self, data: Any, pushed: FloatArray | None = None) -> None:
        """Work everything out at the state in ``data``; see :meth:`JointModel.update`."""
        site = self.site
        site.update(data)
        super().update(data, pushed)
        self.yd = site.rates
        self.B = site.J.dot(self.mobility.T)
        self.alpha = self.B.dot(self.M_c)
        self.drift = site.acceleration(self.coasting)


class TaskModel(OutputModel):
    """An :class:`OutputModel` with a target.

    Attributes:
        target_m: Where the site is to be along its axes, m; that of the task at first, to be written to, (number of axes,).
        target_frame: The attitude it is to have, axes as columns in world axes, to be written to; first the world's, (3, 3).
        y: Place of the site along its axes, m, (number of axes,).
        motion: How the target of the task moves, which then writes ``target_m``, ``target_rates`` and
            ``target_accelerations`` at every update; None: it does not.
        target_rates: Rates of the target in m/s and rad/s, to be written to; zero at first, (p,).
        target_accelerations: Accelerations of the target, to be written to; zero at first, (p,).
        e: y - target_m in m; with ``attitude`` then the rotation vector from ``target_frame`` to the site's in rad, (p,).
        ed: yd - target_rates, (p,).
        v_h: Rates of the output that the momentum alone gives it, (p,); zero without momentum.
        W: Angular velocity of the base per rate of the driven joints where there is no momentum, rad/s in world axes,
            (number of base axes, n).
    """

    def __init__(
        self,
        context: ControllerContext,
        joints: Sequence[str] | None = None,
        base_axes: Sequence[int] = (0, 1, 2),
        *,
        site: str | None = None,
        axes: Sequence[int] | None = None,
        attitude: bool = False,
    ) -> None:
        """Bind to the system of a control law.

        Args:
            context: What the law is made for.
            joints: Names of the driven joints; see :class:`JointModel`.
            base_axes: World axes of the base's angular velocity that ``W`` has, of 0, 1, 2.
            site: Name of the site that is the output; None: the task's.
            axes: World axes of its position; None: those of the task, all three where a site is named.
            attitude: Whether its attitude is output too.

        Raises:
            ScenarioFaults: A joint or site that there is not, or neither a site nor a task; paths ``joints`` and ``site``.
        """
        super().__init__(context, joints, site=site, axes=axes, attitude=attitude)
        task = context.task
        self._root, self._base_axes, self._attitude = context.system.robot.root, list(base_axes), attitude
        self.target_m = task.target_m.copy() if site is None and task is not None else np.zeros(len(self._axes))
        self.motion = task.motion if site is None and task is not None else None
        self.target_frame = np.eye(3)
        self.target_rates, self.target_accelerations = np.zeros(self.site.size), np.zeros(self.site.size)
        self._base_rates = np.empty((3, self._model.nv))
        self._quaternion, self._turn = np.empty(4), np.empty(3)

    def update(self, data: Any, pushed: FloatArray | None = None) -> None:
        """Work everything out at the state in ``data``; see :meth:`JointModel.update`."""
        super().update(data, pushed)
        mujoco.mj_jacBody(self._model, data, None, self._base_rates, self._root)
        if self.motion is not None:
            self._follow(self.motion, data)
        self.ed = self.yd - self.target_rates
        self.v_h = self.yd - self.alpha.dot(self.qd)
        self.W = self._base_rates[self._base_axes].dot(self.mobility.T).dot(self.M_c)
        self.y = self.site.point[self._axes]
        self.e = self.y - self.target_m
        if self._attitude:
            self.e = np.concatenate((self.e, self._attitude_error()))

    def _follow(self, motion: TargetMotion, data: Any) -> None:
        """Write the target's position, rates and accelerations as its motion has them."""
        motion.update(data.time, data)
        k = len(self._axes)
        self.target_m = motion.position_m
        self.target_rates[:k], self.target_accelerations[:k] = motion.rates_m_s, motion.accelerations(self.coasting)

    def _attitude_error(self) -> FloatArray:
        """Rotation vector from the target's frame to the site's, world axes, rad, (3,)."""
        turn = self.site.frame.dot(self.target_frame.T)
        mujoco.mju_mat2Quat(self._quaternion, turn.ravel())
        mujoco.mju_quat2Vel(self._turn, self._quaternion, 1.0)
        return self._turn

    def response(self, data: Any, force: FloatArray) -> FloatArray:
        """Accelerations (p,) that a generalised force on all dofs (nv,) adds to the output, at the state last updated."""
        return np.asarray(self.site.J.dot(self.accelerations(data, force)))
