"""Output- and state-dependent Riccati equation control of the tip (paper section 3, design section 5).

The reduced dynamics are exact for any momentum; A comes in two parameterizations, because the paper prints one (30) and its
figures were made with the other. ``output_stack`` depends on where the world's origin is, ``velocity`` does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import mujoco
import numpy as np
from pydantic import Field

from controllers.joints import driven_joints
from controllers.riccati import RiccatiError, solve_care
from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import Command, ControllerContext, Observation
from ffsm_mj.dynamics import ReducedModel, reduced_model
from ffsm_mj.errors import ControllerError, Fault, ScenarioFaults
from ffsm_mj.model import FloatArray
from ffsm_mj.signals import Signal

Weight = tuple[float, ...] | tuple[tuple[float, ...], ...]


class OsdreConfig(StrictModel):
    """OSDRE regulation of the task's tip to its target."""

    kind: Literal["osdre"]
    joints: tuple[str, ...] | None = None
    """Joints to drive; left out: every motor-driven joint of the robot but those of the base."""
    Q: Weight
    """Weight of the output stack [y; ydot], 2p numbers for a diagonal or 2p rows; its position block must be regular."""
    R: Weight
    """Weight of the torques, positive definite: one number per joint for a diagonal, or rows."""
    parameterization: Literal["output_stack", "velocity"] = "output_stack"
    """Lower block of A: ``output_stack`` d z^+ (the paper's runs), ``velocity`` [0, d ydot^+] (the paper's print)."""
    null_space_damping: Annotated[float, Field(ge=0.0)] = 0.0
    """Damping of motions of a redundant arm that do not move the output, N m s/rad; the output does not feel it."""


class Osdre:
    """OSDRE law. Attributes of the last tick are in ``telemetry``."""

    Config = OsdreConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal("controller", "osdre_error_m", "m", "distance of the output from its target"),
        Signal("controller", "osdre_riccati_residual", "", "residual of the Riccati equation over its largest term"),
        Signal("controller", "osdre_riccati_fallback", "", "1 where the robust Riccati solver was needed"),
        Signal(
            "controller", "osdre_smallest_gain", "", "smallest singular value of alpha M_c^-1: condition 1 holds while > 0"
        ),
    )

    def __init__(self, config: OsdreConfig, context: ControllerContext) -> None:
        """Resolve joints and check the weights.

        Raises:
            ScenarioFaults: No task, an unknown joint, or weights that give no unique stabilising gain.
        """
        if context.task is None:
            raise ScenarioFaults([Fault("osdre needs a 'task' with tip, axes and target", ("kind",))])
        system, self._task = context.system, context.task
        self._model = system.mj
        self._joints = driven_joints(system, config.joints)
        robot = system.robot.dofs
        self._robot = robot
        self._a = self._joints.dofs - robot.start
        self._b = np.setdiff1d(np.arange(robot.stop - robot.start), self._a)
        self._axes = list(self._task.axes)
        self._tip_body = int(self._model.site_bodyid[self._task.tip_site])
        p = len(self._axes)
        if p > len(self._a):
            raise ScenarioFaults([Fault(f"{p} outputs need at least {p} joints, there are {len(self._a)}", ("joints",))])
        self._Q = _state_weight(config.Q, p)
        self._R_inverse = np.linalg.inv(_input_weight(config.R, len(self._a)))
        self._damping = config.null_space_damping
        self._whole_stack = config.parameterization == "output_stack"
        self._jacp, self._jac_dot = np.empty((3, self._model.nv)), np.empty((3, self._model.nv))
        self._M = np.empty((self._model.nv, self._model.nv))
        self._report = (np.nan,) * len(self.telemetry_signals)

    def start(self, observation: Observation) -> None:
        """The law has no memory."""

    def control(self, observation: Observation, command: Command) -> None:
        """Command u = -R^-1 B^T K [y - y_d; ydot], paper (32).

        Raises:
            ControllerError: The Riccati equation has no stabilising solution at this state.
        """
        data = observation.data
        p = len(self._axes)
        reduced, y, y_dot = self._output_dynamics(data)
        z = np.concatenate((y, y_dot))
        B_lower = np.linalg.solve(reduced.M_c, reduced.alpha.T).T  # alpha M_c^-1, M_c symmetric
        A = np.zeros((2 * p, 2 * p))
        A[:p, p:] = np.eye(p)
        if self._whole_stack:
            A[p:] = np.outer(reduced.drift, _pseudo_inverse(z))
        else:
            A[p:, p:] = np.outer(reduced.drift, _pseudo_inverse(y_dot))
        S = np.zeros((2 * p, 2 * p))
        S[p:, p:] = B_lower @ self._R_inverse @ B_lower.T
        try:
            solution = solve_care(A, S, self._Q)
        except RiccatiError as error:
            raise ControllerError(f"OSDRE at t = {observation.time_s:.6g} s: {error}") from error
        error_stack = np.concatenate((y - self._task.target_m, y_dot))
        u = -self._R_inverse @ (B_lower.T @ (solution.K[p:] @ error_stack))
        if self._damping > 0.0:
            brake = self._damping * data.qvel[self._joints.dofs]
            u -= brake - np.linalg.pinv(B_lower) @ (B_lower @ brake)
        command.drive(self._joints.actuators, u)
        smallest = float(np.linalg.svd(B_lower, compute_uv=False)[-1])
        distance = float(np.linalg.norm(error_stack[:p]))
        self._report = (distance, solution.residual, float(solution.fallback), smallest)

    def _output_dynamics(self, data: Any) -> tuple[ReducedModel, FloatArray, FloatArray]:
        """Reduced model, output y and its rate at the current state."""
        model, robot, axes, site = self._model, self._robot, self._axes, self._task.tip_site
        mujoco.mj_jacSite(model, data, self._jacp, None, site)
        point = np.array(data.site_xpos[site])
        mujoco.mj_jacDot(model, data, self._jac_dot, None, point, self._tip_body)
        mujoco.mj_fullM(model, data, self._M)
        qvel = data.qvel[robot]
        J = self._jacp[axes][:, robot]
        bias = data.qfrc_bias[robot] - data.qfrc_passive[robot]
        Jdot_qdot = self._jac_dot[axes][:, robot] @ qvel
        return reduced_model(self._M[robot, robot], bias, J, Jdot_qdot, self._a, self._b), point[axes], J @ qvel

    def telemetry(self) -> Sequence[float]:
        """Error, Riccati residual, fallback, smallest gain of the last tick."""
        return self._report


def _pseudo_inverse(v: FloatArray) -> FloatArray:
    """v^+ = v^T / |v|^2, zero at zero."""
    square = float(v @ v)
    return v / square if square > 0.0 else np.zeros_like(v)


def _matrix(weight: Weight, size: int, key: str, of: str) -> FloatArray:
    """Weight as a symmetric matrix.

    Raises:
        ScenarioFaults: Wrong size, or not symmetric.
    """
    rows = [row if isinstance(row, tuple) else (row,) for row in weight]
    flat = not any(isinstance(row, tuple) for row in weight)
    if len(rows) != size or (not flat and any(len(row) != size for row in rows)):
        raise ScenarioFaults([Fault(f"must be {size} numbers (a diagonal) or {size} rows of {size}, {of}", (key,))])
    matrix = np.diag(np.array(weight)) if flat else np.array(rows)
    if not np.array_equal(matrix, matrix.T):
        raise ScenarioFaults([Fault("must be symmetric", (key,))])
    return np.asarray(matrix, dtype=np.float64)


def _state_weight(weight: Weight, p: int) -> FloatArray:
    Q = _matrix(weight, 2 * p, "Q", f"for {p} outputs and their rates")
    eigenvalues = np.linalg.eigvalsh(Q)
    if eigenvalues[0] < -1e-12 * max(eigenvalues[-1], 0.0):
        raise ScenarioFaults(
            [Fault(f"must be positive semidefinite; its smallest eigenvalue is {eigenvalues[0]:.3g}", ("Q",))]
        )
    position = np.linalg.eigvalsh(Q[:p, :p])
    if position[0] <= 1e-12 * position[-1] or position[-1] <= 0.0:
        message = (
            "its position block must be regular, or no gain brings the tip to the target; raise its first diagonal entries"
        )
        raise ScenarioFaults([Fault(message, ("Q",))])
    return Q


def _input_weight(weight: Weight, count: int) -> FloatArray:
    R = _matrix(weight, count, "R", "one per driven joint")
    smallest = np.linalg.eigvalsh(R)[0]
    if smallest <= 0.0:
        raise ScenarioFaults([Fault(f"must be positive definite; its smallest eigenvalue is {smallest:.3g}", ("R",))])
    return R
